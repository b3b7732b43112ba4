// Whole photographs predicted in lanes, against the reference site by site.
#include "engine/fourier/photo_prediction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "engine/fourier/point_model.h"
#include "tests/fourier/rig.h"

namespace patina::test {
namespace {

constexpr double kWidthMm = 60, kHeightMm = 40;

/// Sites over a sheet with lobes from mirror to satin, and measurements that are the model's with a little
/// error.
struct Sheet {
  Rig rig;
  std::vector<FrequencyGroup> groups;
  std::vector<SvbrdfParameters> parameters;
  std::vector<Eigen::Vector2f> pointMm;
  std::vector<float> z, even, black, window;
  std::vector<std::vector<std::uint16_t>> dropped;
  NoiseModel noise{2e-5, 2e-4};
  PredictionSums expected, expectedWindow;

  /// `skew` of the light, at every site; lobes with terms of their own.
  std::vector<LobeTerms> terms;
  float skew = 0;

  SiteGeometry geometryOf(std::size_t s) const {
    SiteGeometry geometry = rig.site(pointMm[s].x(), pointMm[s].y());
    geometry.lightPrecisionXY = skew;
    if (!terms.empty()) geometry.lobe = terms[s % terms.size()];
    return geometry;
  }

  explicit Sheet(int count, LobeMapping lobe, std::vector<LobeTerms> lobeTerms = {}, float lightSkew = 0)
      : terms(std::move(lobeTerms)), skew(lightSkew) {
    for (const int k : {1, 2, 3, 4, 6, 10, 20, 40})
      for (const Eigen::Vector2i& axis : {Eigen::Vector2i(1, 0), {0, 1}, {1, 1}, {1, -1}})
        groups.push_back({k * axis, {}});
    std::mt19937 random(7);
    std::uniform_real_distribution<float> unit(0, 1);
    const auto compare = [&](PredictionSums& sums, float measured, float predicted) {
      sums.error += std::pow(static_cast<double>(predicted) - measured, 2);
      sums.signal += static_cast<double>(measured) * measured;
      sums.noise += noise.variance(measured);
    };
    const DiffuseMethod method =
        lobe == LobeMapping::PaperAffine ? DiffuseMethod::PaperMixture : DiffuseMethod::Quadrature;
    std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
    for (const auto& group : groups)
      for (const int h : {1, 2, 4, 6, 8, 10, 12, 14, 16})
        frequencies.push_back((h * group.frequency).cast<double>());
    const DiffuseTransform diffuse(rig.frame, {kWidthMm, kHeightMm}, frequencies, method);
    std::vector<float> v(frequencies.size() * 6);
    for (int s = 0; s < count; ++s) {
      SvbrdfParameters p;
      p.sigma = 0.01f * std::pow(30.0f, unit(random));
      p.kurtosis = 1 + 0.5f * unit(random);
      p.normal = Eigen::Vector3f(0.1f * (unit(random) - 0.5f), 0.1f * (unit(random) - 0.5f), 1).normalized();
      for (int c = 0; c < 3; ++c) p.diffuse[c] = 0.4f * unit(random), p.specular[c] = 0.1f * unit(random);
      pointMm.emplace_back((unit(random) - 0.5f) * kWidthMm, (unit(random) - 0.5f) * kHeightMm);
      const SiteGeometry geometry = geometryOf(static_cast<std::size_t>(s));
      const SiteLobe siteLobeHere = siteLobe(rig.frame, geometry, p, lobe);
      const Eigen::Vector3f n = normalOnScreen(rig.frame, p.normal);
      diffuse.at(pointMm.back().cast<double>(), v.data());
      float dark[3];
      for (auto& value : dark) black.push_back(value = 0.01f * unit(random));
      dropped.emplace_back();
      if (s % 5 == 0) dropped.back() = {3, 10, 11};
      std::array<std::complex<float>, 2 + kEvenHarmonics> d, l;
      const auto at = [&](std::size_t f) {
        return std::complex<float>(n.x() * v[f * 6] + n.y() * v[f * 6 + 2] + n.z() * v[f * 6 + 4],
                                   n.x() * v[f * 6 + 1] + n.y() * v[f * 6 + 3] + n.z() * v[f * 6 + 5]);
      };
      d[0] = at(0);
      l[0] = siteLobeHere.transform(Eigen::Vector2f::Zero());
      for (int c = 0; c < 3; ++c) {
        const float model = dark[c] + p.diffuse[c] * d[0].real() + p.specular[c] * l[0].real();
        window.push_back(model * (1 + 0.05f * (unit(random) - 0.5f)));
        compare(expectedWindow, window.back(), model);
      }
      for (std::size_t g = 0; g < groups.size(); ++g) {
        for (std::size_t h = 0; h < 9; ++h) {
          d[1 + h] = at(1 + g * 9 + h);
          l[1 + h] = siteLobeHere.transform(frequencies[1 + g * 9 + h].cast<float>());
        }
        float photo[4][3];
        for (int k = 0; k < 4; ++k) {
          // I1 and I3 make row 2 g, I0 and I2 row 2 g + 1
          const auto row = 2 * g + (k % 2 == 1 ? 0 : 1);
          const bool left = std::ranges::binary_search(dropped.back(), row);
          for (int c = 0; c < 3; ++c) {
            const float model =
                dark[c] + p.diffuse[c] * patternRadiance(d, k) + p.specular[c] * patternRadiance(l, k);
            photo[k][c] = model * (1 + 0.05f * (unit(random) - 0.5f));
            if (!left) compare(expected, photo[k][c], model);
            if (left) photo[k][c] = 100;  // saturated: must not be looked at
          }
        }
        for (int c = 0; c < 3; ++c) z.push_back(photo[1][c] - photo[3][c]);
        for (int c = 0; c < 3; ++c) z.push_back(photo[2][c] - photo[0][c]);
        for (int c = 0; c < 3; ++c) even.push_back(photo[0][c] + photo[2][c]);
        for (int c = 0; c < 3; ++c) even.push_back(photo[1][c] + photo[3][c]);
      }
      parameters.push_back(p);
    }
  }

  std::vector<PredictionSite> sites(bool withWindow) const {
    std::vector<PredictionSite> out;
    const std::size_t stride = groups.size() * 6;
    for (std::size_t s = 0; s < parameters.size(); ++s)
      out.push_back({.geometry = geometryOf(s),
                     .pointMm = pointMm[s],
                     .parameters = &parameters[s],
                     .z = z.data() + s * stride,
                     .even = even.data() + s * stride,
                     .black = black.data() + s * 3,
                     .window = withWindow ? window.data() + s * 3 : nullptr,
                     .pixelCount = 1,
                     .droppedRows = dropped[s]});
    return out;
  }
};

// Sums of squares of a 2.5 % gap: a float's rounding of the prediction, 1e-6, is 1e-4 of the gap and
// averages out.
constexpr double kRelative = 1e-5;

class PredictionOf : public testing::TestWithParam<LobeMapping> {};

TEST_P(PredictionOf, InLanesIsThatOfTheReference) {
  for (const int count : {1, 7, 300}) {
    const Sheet sheet(count, GetParam());
    const DiffuseMethod method =
        GetParam() == LobeMapping::PaperAffine ? DiffuseMethod::PaperMixture : DiffuseMethod::Quadrature;
    const PhotoPrediction prediction(sheet.rig.frame, {kWidthMm, kHeightMm}, sheet.groups, GetParam(), method,
                                     sheet.noise);
    PredictionSums expected = sheet.expected;
    const PredictionSums without = prediction.compare(sheet.sites(false));
    EXPECT_NEAR(std::sqrt(without.error / without.signal) / std::sqrt(expected.error / expected.signal), 1,
                kRelative * (count < 100 ? 10 : 1))
        << count;
    EXPECT_NEAR(without.signal / expected.signal, 1, kRelative) << count;
    EXPECT_NEAR(without.noise / expected.noise, 1, kRelative) << count;
    expected += sheet.expectedWindow;
    const PredictionSums with = prediction.compare(sheet.sites(true));
    EXPECT_NEAR(with.signal / expected.signal, 1, kRelative) << count;
    EXPECT_NEAR(with.error / expected.error, 1, kRelative * (count < 100 ? 10 : 1)) << count;
    EXPECT_NEAR(with.noise / expected.noise, 1, kRelative) << count;
  }
}

TEST(Prediction, OfLobesWithTermsIsThatOfTheReference) {
  const std::vector<LobeTerms> terms = {
      {{0.3f, 0.1f}, 0, 1}, {{0, 0}, 0.2f, 3}, {{-0.1f, 0.2f}, 0.1f, 2}, {}};
  for (const auto& [some, skew] :
       {std::pair{terms, 0.1f}, {terms, 0.0f}, {std::vector<LobeTerms>{}, 0.15f}}) {
    const Sheet sheet(90, LobeMapping::ExactMoments, some, skew);
    PhotoPrediction prediction(sheet.rig.frame, {kWidthMm, kHeightMm}, sheet.groups,
                               LobeMapping::ExactMoments, DiffuseMethod::Quadrature, sheet.noise);
    prediction.variant = {skew != 0, !some.empty(), !some.empty()};
    const PredictionSums sums = prediction.compare(sheet.sites(false));
    EXPECT_NEAR(sums.error / sheet.expected.error, 1, 2 * kRelative);
    prediction.variant = {};
    EXPECT_GT(prediction.compare(sheet.sites(false)).error / sheet.expected.error, 1.05);
  }
}

INSTANTIATE_TEST_SUITE_P(BothLobes, PredictionOf,
                         testing::Values(LobeMapping::ExactMoments, LobeMapping::PaperAffine),
                         [](const auto& info) {
                           return info.param == LobeMapping::ExactMoments ? "Exact" : "Paper";
                         });

}  // namespace
}  // namespace patina::test
