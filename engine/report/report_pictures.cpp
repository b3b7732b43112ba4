// The report's pictures: residuals with a wipe, where they sit in the camera's picture, maps of effects.
#include <algorithm>
#include <cmath>

#include "engine/report/explanation_words.h"
#include "engine/report/html.h"
#include "engine/report/report_sections.h"
#include "engine/report/residual_pictures.h"

namespace patina::report {
namespace {

using html::escaped;

/// Pixels; a few pictures of noise at this size make a page of some megabytes.
constexpr int kLongestSide = 300;
constexpr std::size_t kMostPictures = 6;
constexpr double kPlaceLow = 0.7;

std::string image(const Image& picture, const char* kind, const std::string& described) {
  const auto uri = html::pictureUri(picture);
  if (!uri) return {};  // no memory for a picture: the page is worth having without it
  return "<img class=\"" + std::string(kind) + "\" src=\"" + *uri + "\" width=\"" +
         std::to_string(picture.width()) + "\" height=\"" + std::to_string(picture.height()) + "\" alt=\"" +
         escaped(described) + "\"/>";
}

std::string plain(const Image& picture, const std::string& caption) {
  if (picture.empty()) return {};
  return "<figure>" + image(picture, "under", caption) + "<figcaption>" + escaped(caption) +
         "</figcaption></figure>";
}

std::string wipe(const Image& left, const Image& right, const char* leftName, const char* rightName,
                 const std::string& caption) {
  if (left.empty()) return plain(right, caption);
  if (right.empty()) return plain(left, caption);
  return "<figure><div class=\"wipe\">" + image(left, "under", caption + ": " + leftName) +
         image(right, "over", caption + ": " + rightName) +
         "<span class=\"rule\"></span><span class=\"left\">" + leftName + "</span><span class=\"right\">" +
         rightName +
         "</span></div><input class=\"wipe-range\" type=\"range\" min=\"0\" max=\"100\" value=\"50\" "
         "aria-label=\"" +
         escaped(caption + ": wipe between " + leftName + " and " + rightName) + "\"/><figcaption>" +
         escaped(caption) + "</figcaption></figure>";
}

std::string inNoise(double rms) {
  return rms >= 0 ? shortNumber(rms) + " times the noise" : "not known";
}

std::string photograph(const ResidualPicture& picture, const std::string& what, std::uint64_t seed,
                       bool added) {
  const ResidualView view = residualView(picture, kLongestSide, seed);
  if (view.empty()) return {};
  std::string residual = "Photograph minus prediction: " + inNoise(view.rmsBefore) + " before";
  if (added && !view.after.empty()) residual += ", " + inNoise(view.rmsAfter) + " after";
  const Image& prediction =
      added && !view.predictedAfter.empty() ? view.predictedAfter : view.predictedBefore;
  return "<div class=\"shot panel\"><h3>" + escaped(picture.file + (what.empty() ? "" : ": " + what)) +
         "</h3><div class=\"pictures\">" +
         wipe(view.before, added ? view.after : Image(), "before", "after", residual) +
         plain(view.expected, "What noise alone would look like") +
         wipe(view.captured, prediction, "photograph", "prediction", "The photograph and its prediction") +
         "</div></div>";
}

std::string places(const Explanation& explanation) {
  double most = 2;
  for (const Image* place : {&explanation.placeBefore, &explanation.placeAfter})
    for (const float value : place->samples())
      if (std::isfinite(value)) most = std::max(most, std::min(double{value}, 1e6));
  const Image before = placePicture(explanation.placeBefore, kLongestSide, kPlaceLow, most);
  const Image after = explanation.effects.empty()
                          ? Image()
                          : placePicture(explanation.placeAfter, kLongestSide, kPlaceLow, most);
  if (before.empty() && after.empty()) return {};
  const bool alike = before.width() == after.width() && before.height() == after.height();
  const std::string caption = "Where in the picture: mean square residual over all photographs, black " +
                              shortNumber(kPlaceLow) + " (noise is 1) to cream " + shortNumber(most);
  return "<div class=\"shot panel\"><h3>All photographs together</h3><div class=\"pictures\">" +
         (alike ? wipe(before, after, "before", "after", caption)
                : plain(before, caption + ", before") + plain(after, caption + ", after")) +
         "</div></div>";
}

std::string maps(const Explanation& explanation) {
  std::string figures;
  for (const EffectFinding& effect : explanation.effects)
    for (const auto& [stem, map] : effect.maps) {
      double low = 0, high = 1;
      const Image shown = mapPicture(map, kLongestSide, &low, &high);
      if (shown.empty()) continue;
      std::string caption = stem;
      std::ranges::replace(caption, '_', ' ');
      if (map.channels() == 1) caption += ": violet " + shortNumber(low) + " to yellow " + shortNumber(high);
      figures += plain(shown, caption);
    }
  if (figures.empty()) return {};
  return "<div class=\"shot panel\"><h3>Maps that the added effects bring</h3><div class=\"pictures\">" +
         figures + "</div></div>";
}

}  // namespace

std::string photographPictures(const Explanation& explanation) {
  std::string body;
  std::size_t shown = 0;
  for (const ResidualPicture& picture : explanation.pictures) {
    if (shown == kMostPictures) break;
    const auto photo = std::ranges::find_if(explanation.photos, [&](const PhotoResidual& one) {
      return one.bundle == picture.bundle && one.photo == picture.photo;
    });
    std::string what = photo != explanation.photos.end() ? photo->what : "";
    if (photo != explanation.photos.end() && photo->holdout) what += what.empty() ? "held out" : ", held out";
    const std::string html = photograph(picture, what, shown + 1, !explanation.effects.empty());
    if (html.empty()) continue;
    body += html;
    ++shown;
  }
  body += places(explanation) + maps(explanation);
  if (body.empty()) return {};
  return "<section id=\"pictures\"><h2>What is left of the photographs</h2><p class=\"lead\">" +
         escaped(
             "Residuals are photograph minus prediction in standard deviations of the noise: grey is as "
             "predicted, "
             "brighter is a photograph brighter than its prediction, a colour is a channel of its own; black "
             "and "
             "white are " +
             shortNumber(kResidualRangeSigmas) +
             " standard deviations. A perfect model leaves what stands beside it: noise.") +
         "</p>" + body + "</section>\n";
}

}  // namespace patina::report
