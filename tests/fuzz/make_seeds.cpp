// make_seeds FOLDER: inputs that the fuzz targets of basis files and plans begin with, below FOLDER/basis and
// FOLDER/plan. Made when the targets are built, so that they are what this version writes.
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/near_field.h"
#include "engine/twoshot/plan.h"

namespace {

namespace fs = std::filesystem;
using namespace patina;

bool write(const fs::path& file, const std::string& bytes) {
  std::ofstream out(file, std::ios::binary);
  return static_cast<bool>(out << bytes << std::flush);
}

/// A whole basis file of two materials over a few cells.
std::string smallBasis(int components, std::size_t cells) {
  BasisHeader header;
  header.name = "seed";
  header.source = "made for the fuzz targets";
  for (const char* name : {"one", "two"}) header.materials.push_back({name, "merl", "", 1, 2});
  header.columns = 6;
  header.components = components;
  header.cells = cells;
  header.trustedCells = cells / 2;
  const std::size_t start = 32 + basisHeaderJson(header).size();
  const BasisLayout layout = basisLayout(header, start);
  std::string data(layout.end - start, '\0');
  const auto fill = [&](std::size_t from, std::size_t count, auto value) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto v = value(i);
      data.replace(from - start + i * sizeof v, sizeof v, reinterpret_cast<const char*>(&v), sizeof v);
    }
  };
  const auto k = static_cast<std::size_t>(components);
  fill(layout.singularValues, k, [](std::size_t i) { return 10.0 / static_cast<double>(1 + i); });
  fill(layout.coefficients, k * 6, [](std::size_t i) { return std::sin(static_cast<double>(i)); });
  fill(layout.trustedGram, k * k, [k](std::size_t i) { return i % (k + 1) == 0 ? 5.0 : 0.1; });
  fill(layout.scales, k, [](std::size_t) { return 1e-4f; });
  fill(layout.cells, cells, [](std::size_t i) { return static_cast<std::uint32_t>(i * 97); });
  fill(layout.mean, cells, [](std::size_t) { return 0.1f; });
  fill(layout.lnReference, cells, [](std::size_t) { return -1.0f; });
  fill(layout.components, cells * k, [](std::size_t i) { return static_cast<std::int16_t>(i * 7919); });
  header.dataChecksum = contentChecksum(data);
  const std::string text = basisHeaderJson(header);
  const std::uint64_t length = text.size(), checksum = contentChecksum(text);
  std::string file(kBasisMagic, 16);
  file.append(reinterpret_cast<const char*>(&length), 8);
  file += text;
  file.append(reinterpret_cast<const char*>(&checksum), 8);
  return file + data;
}

Plan smallPlan(int shots) {
  constexpr double kDegree = 3.14159265358979323846 / 180;
  Plan plan;
  plan.options.shots = shots;
  for (int i = 0; i < shots; ++i) {
    const ShotDirections to = shotFromHalfDiff({(6 + 4 * i) * kDegree, (38 + i) * kDegree, 90 * kDegree});
    plan.shots.push_back({to, to.centre()});
    plan.errorAfterShot.push_back(0.3);
  }
  plan.materials = {"one", "two"};
  plan.expected.unseenMaterial = {0.2, 0.3};
  plan.basisName = "seed";
  return plan;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const fs::path basis = fs::path(argv[1]) / "basis", plan = fs::path(argv[1]) / "plan";
  fs::create_directories(basis), fs::create_directories(plan);
  Plan given = smallPlan(2);
  given.options.given = {given.shots[0].directions};
  const bool written = write(basis / "small.basis", smallBasis(2, 40)) &&
                       write(basis / "whole_rank.basis", smallBasis(6, 9)) &&
                       write(plan / "one.json", planJson(smallPlan(1))) &&
                       write(plan / "given.json", planJson(given));
  return written ? 0 : 1;
}
