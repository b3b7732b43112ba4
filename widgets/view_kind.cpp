#include "widgets/view_kind.h"

namespace patina {

const std::array<ViewKindInfo, kViewKindCount>& viewKinds() {
  static const std::array<ViewKindInfo, kViewKindCount> kinds{{
      {ViewKind::Photo, "photo", "Photo", "of full white",
       "The selected photograph, linear radiance in units of the screen's full white", ToneStyle::LinearRgb},
      {ViewKind::Diffuse, "diffuse", "Diffuse", "albedo",
       "Diffuse albedo (R, G, B), relative to the screen's white", ToneStyle::LinearRgb},
      {ViewKind::Specular, "specular", "Specular", "albedo",
       "Albedo of the specular lobe at normal incidence (R, G, B)", ToneStyle::LinearRgb},
      {ViewKind::Normal, "normal", "Normal", "",
       "Surface normal, unit vector in the world frame: X in red, Y in green; the range exaggerates it",
       ToneStyle::Normal},
      {ViewKind::Sigma, "sigma", "Sigma", "slope",
       "Width of the lobe: standard deviation of the half-vector's slope; smaller is glossier",
       ToneStyle::Scalar},
      {ViewKind::Kurtosis, "kurtosis", "Kurtosis", "",
       "The paper's gamma: 1 is a Gaussian lobe, larger has a sharper peak and heavier tails",
       ToneStyle::Scalar},
      {ViewKind::Residual, "residual", "Residual", "relative RMS",
       "What the model leaves unexplained: relative RMS over the fitted frequencies and channels",
       ToneStyle::Scalar},
      {ViewKind::Status, "status", "Status", "", "What became of each texel in the fit", ToneStyle::Status},
      {ViewKind::DiffuseSd, "diffuse-sd", "Diffuse \u00b1", "albedo",
       "Standard deviation of the diffuse albedo, from the photographs' noise alone", ToneStyle::LinearRgb},
      {ViewKind::SpecularSd, "specular-sd", "Specular \u00b1", "albedo",
       "Standard deviation of the specular albedo, from the photographs' noise alone", ToneStyle::LinearRgb},
      {ViewKind::NormalSd, "normal-sd", "Normal \u00b1", "\u00b0",
       "Standard deviation of the normal's direction, from the photographs' noise alone", ToneStyle::Scalar},
      {ViewKind::SigmaSd, "sigma-sd", "Sigma \u00b1", "slope",
       "Standard deviation of the lobe's width, from the photographs' noise alone", ToneStyle::Scalar},
      {ViewKind::KurtosisSd, "kurtosis-sd", "Kurtosis \u00b1", "",
       "Standard deviation of gamma, from the photographs' noise alone", ToneStyle::Scalar},
  }};
  return kinds;
}

const ViewKindInfo& info(ViewKind kind) {
  return viewKinds()[static_cast<std::size_t>(kind)];
}

namespace {
constexpr std::array<std::pair<ViewKind, ViewKind>, 5> kPairs{{{ViewKind::Diffuse, ViewKind::DiffuseSd},
                                                               {ViewKind::Specular, ViewKind::SpecularSd},
                                                               {ViewKind::Normal, ViewKind::NormalSd},
                                                               {ViewKind::Sigma, ViewKind::SigmaSd},
                                                               {ViewKind::Kurtosis, ViewKind::KurtosisSd}}};
}

bool isUncertainty(ViewKind kind) {
  return static_cast<int>(kind) >= kTabCount;
}

ViewKind parameterOf(ViewKind kind) {
  for (const auto& [parameter, sd] : kPairs)
    if (sd == kind) return parameter;
  return kind;
}

std::optional<ViewKind> uncertaintyOf(ViewKind kind) {
  for (const auto& [parameter, sd] : kPairs)
    if (parameter == kind) return sd;
  return std::nullopt;
}

const Image* mapOf(const SvbrdfMaps& maps, ViewKind kind) {
  switch (kind) {
    case ViewKind::Photo:
      return nullptr;
    case ViewKind::Diffuse:
      return &maps.diffuse;
    case ViewKind::Specular:
      return &maps.specular;
    case ViewKind::Normal:
      return &maps.normal;
    case ViewKind::Sigma:
      return &maps.sigma;
    case ViewKind::Kurtosis:
      return &maps.kurtosis;
    case ViewKind::Residual:
      return &maps.residual;
    case ViewKind::Status:
      return &maps.status;
    default:
      break;
  }
  const Image* sd = kind == ViewKind::DiffuseSd    ? &maps.diffuseSd
                    : kind == ViewKind::SpecularSd ? &maps.specularSd
                    : kind == ViewKind::NormalSd   ? &maps.normalSd
                    : kind == ViewKind::SigmaSd    ? &maps.sigmaSd
                                                   : &maps.kurtosisSd;
  return sd->empty() ? nullptr : sd;
}

unsigned unmeasuredStates(ViewKind kind) {
  const auto bit = [](TexelStatus status) { return 1u << static_cast<unsigned>(status); };
  switch (kind) {
    case ViewKind::Photo:
    case ViewKind::Status:
      return 0;
    case ViewKind::Specular:
    case ViewKind::Sigma:
    case ViewKind::Kurtosis:
    case ViewKind::SpecularSd:
    case ViewKind::SigmaSd:
    case ViewKind::KurtosisSd:
      return bit(TexelStatus::NotMeasured) | bit(TexelStatus::MirrorOffScreen);
    default:
      return bit(TexelStatus::NotMeasured);
  }
}

QString valueText(ViewKind kind, std::span<const float> pixel) {
  if (pixel.empty()) return {};
  if (kind == ViewKind::Status) return statusName(static_cast<int>(std::lround(pixel[0])));
  QStringList numbers;
  for (const float sample : pixel) {
    if (kind == ViewKind::Normal)
      numbers << QString::asprintf("%+.4f", sample);
    else if (isUncertainty(kind))
      numbers << QString::asprintf("%.2g", sample);
    else if (kind == ViewKind::Kurtosis)
      numbers << QString::asprintf("%.3f", sample);
    else
      numbers << QString::asprintf("%.4f", sample);
  }
  QString text = numbers.join(QStringLiteral("  "));
  if (*info(kind).unit) text += QStringLiteral(" ") + QString::fromUtf8(info(kind).unit);
  return text;
}

}  // namespace patina
