#include "engine/brdf/neural_brdf.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/neural_kernel.h"

namespace patina {

namespace embedded {  // made by embed_networks.cmake
extern const std::uint32_t kNetworkWords[];
extern const std::size_t kNetworkWordCount;
extern const char* const kNetworkNames[];
extern const std::size_t kNetworkNameCount;
}  // namespace embedded

namespace {

static_assert(NeuralShape::kCount == kNeuralBrdfWeights);

constexpr float kLargestWeight =
    1e4f;                              // fits have weights of some tens; products of three layers stay finite
constexpr double kLargestOutput = 80;  // as the kernel's
constexpr std::size_t kMostNetworks = 100000;  // 270 MB of weights
constexpr std::uint64_t kLongestNames = 16u << 20;

bool sensible(std::span<const float> weights) {
  for (const float weight : weights) {
    if (!(std::abs(weight) <= kLargestWeight)) return false;
  }
  return true;
}

class NeuralBrdf final : public Brdf {
 public:
  NeuralBrdf(std::span<const float> weights, BrdfOrigin origin) : Brdf(std::move(origin)) {
    std::copy(weights.begin(), weights.end(), weights_.begin());
  }

  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (toLight.z() < 0 || toView.z() < 0) {
      return Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
    }
    const HalfDiffAngles a = halfDiffFromDirections(toLight, toView);
    const double x = std::sin(a.thetaDRad) * std::cos(a.phiDRad);
    const double y = std::sin(a.thetaDRad) * std::sin(a.phiDRad);
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    for (const double signX : {1.0, -1.0}) {
      for (const double signY : {1.0, -1.0}) {
        sum += network(
            {std::sin(a.thetaHRad), 0, std::cos(a.thetaHRad), signX * x, signY * y, std::cos(a.thetaDRad)});
      }
    }
    return sum / 4;
  }

  void evaluateMany(std::span<const HalfDiffAngles> angles, std::span<Eigen::Array3f> out) const override {
    evaluateNetwork(weights_, angles, out);
  }

 private:
  /// One direction, double precision: the plain text of what the kernel does in lanes.
  Eigen::Array3d network(const std::array<double, NeuralShape::kInputs>& input) const {
    using Shape = NeuralShape;
    std::array<double, Shape::kHidden> first, second;
    layer(Shape::kWeights0, Shape::kBias0, input, first);
    layer(Shape::kWeights1, Shape::kBias1, first, second);
    Eigen::Array3d result;
    for (int o = 0; o < Shape::kOutputs; ++o) {
      double sum = weights_[Shape::kBias2 + o];
      for (int k = 0; k < Shape::kHidden; ++k) {
        sum += second[k] * weights_[Shape::kWeights2 + k * Shape::kOutputs + o];
      }
      result[o] = std::max(std::expm1(std::min(sum, kLargestOutput)), 0.0);
    }
    return result;
  }

  template <std::size_t Inputs>
  void layer(int weights, int bias, const std::array<double, Inputs>& input,
             std::array<double, NeuralShape::kHidden>& output) const {
    for (int o = 0; o < NeuralShape::kHidden; ++o) {
      double sum = weights_[bias + o];
      for (std::size_t k = 0; k < Inputs; ++k)
        sum += input[k] * weights_[weights + k * NeuralShape::kHidden + o];
      output[o] = std::max(sum, 0.0);
    }
  }

  std::array<float, kNeuralBrdfWeights> weights_;
};

constexpr const char* kBuiltInNote =
    "neural fit of a MERL measurement (Sztrajman et al. 2021, MIT licence); averaged over the four "
    "equivalent phi_d";

std::vector<std::string> lines(const std::string& text) {
  std::vector<std::string> result;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (!line.empty()) result.push_back(line);
  }
  return result;
}

}  // namespace

BrdfPtr makeNeuralBrdf(std::span<const float> weights, std::string name) {
  if (weights.size() != kNeuralBrdfWeights) throw std::invalid_argument("a neural BRDF has 675 weights");
  if (!sensible(weights))
    throw std::invalid_argument("a neural BRDF's weights must be finite and within 10^4");
  return std::make_shared<NeuralBrdf>(
      weights, BrdfOrigin{std::move(name), "neural", "", "averaged over the four equivalent phi_d"});
}

Result<std::vector<BrdfPtr>> readNeuralBrdfs(const std::filesystem::path& weightsFile,
                                             const std::filesystem::path& namesFile) {
  constexpr std::size_t kRowBytes = kNeuralBrdfWeights * sizeof(float);
  Result<std::string> bytes = readFile(weightsFile, kMostNetworks * kRowBytes);
  if (!bytes) return bytes.error();
  Result<std::string> text = readFile(namesFile, kLongestNames);
  if (!text) return text.error();
  const std::string hint = "fetch the weights and their names again";
  if (bytes->empty() || bytes->size() % kRowBytes != 0) {
    return Error{ErrorCode::Malformed,
                 "networks have " + std::to_string(kNeuralBrdfWeights) +
                     " weights of 4 bytes each, which doesn't divide the file's " +
                     std::to_string(bytes->size()) + " bytes",
                 weightsFile.string(), hint};
  }
  const std::size_t count = bytes->size() / kRowBytes;
  const std::vector<std::string> names = lines(*text);
  if (names.size() != count) {
    return Error{ErrorCode::Malformed,
                 "there are " + counted(count, "network") + " but " + counted(names.size(), "name"),
                 namesFile.string(), hint};
  }
  std::vector<BrdfPtr> result;
  for (std::size_t i = 0; i < count; ++i) {
    std::array<float, kNeuralBrdfWeights> weights;
    static_assert(std::endian::native == std::endian::little);
    std::memcpy(weights.data(), bytes->data() + i * kRowBytes, kRowBytes);
    if (!sensible(weights)) {
      return Error{ErrorCode::Malformed,
                   "the weights of " + inQuotes(names[i]) + " are not all sensible numbers",
                   weightsFile.string(), hint};
    }
    result.push_back(std::make_shared<NeuralBrdf>(
        weights,
        BrdfOrigin{names[i], "neural", weightsFile.string(), "averaged over the four equivalent phi_d"}));
  }
  return result;
}

namespace {

const std::vector<float>& builtInWeights() {
  static const std::vector<float> weights = [] {
    std::vector<float> floats;
    floats.reserve(embedded::kNetworkWordCount);
    for (std::size_t i = 0; i < embedded::kNetworkWordCount; ++i) {
      floats.push_back(std::bit_cast<float>(embedded::kNetworkWords[i]));
    }
    return floats;
  }();
  return weights;
}

}  // namespace

std::span<const std::byte> builtInNeuralWeights() {
  return std::as_bytes(std::span<const float>(builtInWeights()));
}

const std::vector<std::string>& builtInNeuralNames() {
  static const std::vector<std::string> names(embedded::kNetworkNames,
                                              embedded::kNetworkNames + embedded::kNetworkNameCount);
  return names;
}

const std::vector<BrdfPtr>& builtInNeuralBrdfs() {
  static const std::vector<BrdfPtr> brdfs = [] {
    const std::span<const float> weights(builtInWeights());
    std::vector<BrdfPtr> all;
    for (std::size_t i = 0; i < builtInNeuralNames().size(); ++i) {
      all.push_back(
          std::make_shared<NeuralBrdf>(weights.subspan(i * kNeuralBrdfWeights, kNeuralBrdfWeights),
                                       BrdfOrigin{builtInNeuralNames()[i], "neural", "", kBuiltInNote}));
    }
    return all;
  }();
  return brdfs;
}

const char* neuralBrdfTarget() {
  return networkTarget();
}

}  // namespace patina
