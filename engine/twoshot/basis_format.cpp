#include "engine/twoshot/basis_format.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "engine/capture/json_reader.h"

namespace patina {

HalfDiffAngles foldedCentre(std::size_t cell) {
  const int phi = static_cast<int>(cell % kFoldedPhiD);
  const int thetaD = static_cast<int>(cell / kFoldedPhiD % MerlGrid::kThetaD);
  return MerlGrid::centre(static_cast<int>(cell / (kFoldedPhiD * MerlGrid::kThetaD)), thetaD, phi);
}

CellCosines foldedCosines(std::size_t cell) {
  const HalfDiffAngles angles = foldedCentre(cell);
  const double same = std::cos(angles.thetaHRad) * std::cos(angles.thetaDRad);
  const double other = std::sin(angles.thetaHRad) * std::sin(angles.thetaDRad) * std::cos(angles.phiDRad);
  return {same - other, same + other};
}

bool foldedCellReachable(std::size_t cell) {
  const CellCosines cosines = foldedCosines(cell);
  return cosines.light > 0 && cosines.view > 0;
}

bool foldedCellTrusted(std::size_t cell) {
  const double least = std::cos(kTrustedAngleDeg * M_PI / 180);
  const CellCosines cosines = foldedCosines(cell);
  return cosines.light > least && cosines.view > least;
}

BasisLayout basisLayout(const BasisHeader& header, std::size_t dataStart) {
  const std::size_t k = header.components, m = header.columns, n = header.cells;
  std::size_t at = dataStart;
  const auto place = [&at](std::size_t bytes) {
    at = (at + kBasisAlignment - 1) / kBasisAlignment * kBasisAlignment;
    const std::size_t start = at;
    at += bytes;
    return start;
  };
  BasisLayout layout{};
  layout.singularValues = place(k * sizeof(double));
  layout.coefficients = place(k * m * sizeof(double));
  layout.trustedGram = place(k * k * sizeof(double));
  layout.scales = place(k * sizeof(float));
  layout.cells = place(n * sizeof(std::uint32_t));
  layout.mean = place(n * sizeof(float));
  layout.lnReference = place(n * sizeof(float));
  layout.components = place(n * k * sizeof(std::int16_t));
  layout.end = at;
  return layout;
}

std::uint64_t contentChecksum(std::string_view bytes) {
  return XXH3_64bits(bytes.data(), bytes.size());
}

ContentChecksum::ContentChecksum() : state_(XXH3_createState()) {
  XXH3_64bits_reset(static_cast<XXH3_state_t*>(state_));
}
ContentChecksum::~ContentChecksum() {
  XXH3_freeState(static_cast<XXH3_state_t*>(state_));
}
void ContentChecksum::add(const void* bytes, std::size_t count) {
  XXH3_64bits_update(static_cast<XXH3_state_t*>(state_), bytes, count);
}
std::uint64_t ContentChecksum::value() const {
  return XXH3_64bits_digest(static_cast<const XXH3_state_t*>(state_));
}

std::string checksumText(std::uint64_t checksum) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(checksum));
  return text;
}

namespace {

std::uint64_t checksumFromText(JsonObject& object, const std::string& key) {
  const std::string text = object.text(key);
  if (text.size() != 16 || text.find_first_not_of("0123456789abcdef") != std::string::npos) {
    object.fail(ErrorCode::Malformed, key, "A checksum has 16 hexadecimal digits");
  }
  return std::stoull(text, nullptr, 16);
}

}  // namespace

std::string basisHeaderJson(const BasisHeader& header) {
  nlohmann::ordered_json json;
  json["format"] = "patina-basis";
  json["version"] = 1;
  json["name"] = header.name;
  json["source"] = header.source;
  json["mapping"] = "ln((f w + 0.001) / (median f w + 0.001)), w = max(cos light, cos view)";
  json["components"] = header.components;
  json["columns"] = header.columns;
  json["cells"] = header.cells;
  json["trusted_cells"] = header.trustedCells;
  json["checksum"] = checksumText(header.dataChecksum);
  json["materials"] = nlohmann::ordered_json::array();
  for (const BasisMaterial& material : header.materials) {
    json["materials"].push_back({{"name", material.name},
                                 {"format", material.format},
                                 {"note", material.note},
                                 {"checksum", checksumText(material.checksum)},
                                 {"bytes", material.bytes}});
  }
  // Names come from files of others: what is not UTF-8 in them is replaced rather than refused.
  return json.dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<BasisHeader> parseBasisHeader(std::string_view text, const std::string& where) {
  try {
    const nlohmann::json json = parseJson(text, where);
    JsonObject object(json, where, "");
    if (object.text("format") != "patina-basis") {
      object.fail(ErrorCode::Malformed, "format", "This is not a basis of Patina's");
    }
    if (object.integer("version", 1, 1000000) != 1) {
      object.fail(ErrorCode::Unsupported, "version", "This basis was written by a later version",
                  "build it again with this version: patina-cli basis build");
    }
    BasisHeader header;
    header.name = object.text("name");
    header.source = object.text("source");
    header.components = object.integer("components", 1, 30000);
    header.columns = object.integer("columns", 2, 30000);
    header.cells = object.integer("cells", 1, kFoldedCells);
    header.trustedCells = object.integer("trusted_cells", 1, static_cast<int>(header.cells));
    header.dataChecksum = checksumFromText(object, "checksum");
    const nlohmann::json& materials = object.list("materials", 1, 30000);
    for (std::size_t i = 0; i < materials.size(); ++i) {
      JsonObject item(materials[i], where, "materials[" + std::to_string(i) + "]");
      BasisMaterial material;
      material.name = item.text("name");
      material.format = item.text("format");
      material.note = item.text("note", "");
      material.checksum = checksumFromText(item, "checksum");
      material.bytes = static_cast<std::uint64_t>(item.number("bytes", 0, 1e15));
      header.materials.push_back(std::move(material));
    }
    if (header.columns != 3 * static_cast<int>(header.materials.size())) {
      object.fail(ErrorCode::Malformed, "columns", "A material has three columns");
    }
    if (header.components > header.columns) {
      object.fail(ErrorCode::Malformed, "components", "There can't be more components than columns");
    }
    return header;
  } catch (const JsonFault& fault) {
    return fault.error;
  }
}

}  // namespace patina
