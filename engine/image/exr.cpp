#include "engine/image/exr.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <mutex>
#include <stdexcept>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/image/exr_header.h"

namespace patina {
namespace {

/// Bytes in memory as OpenEXR's stream. A read past the end throws, as OpenEXR expects.
class MemoryInput : public Imf::IStream {
 public:
  MemoryInput(std::string_view bytes, const std::string& name) : IStream(name.c_str()), bytes_(bytes) {}

  bool read(char target[], int count) override {
    if (count < 0 || static_cast<std::size_t>(count) > bytes_.size() - at_) {
      throw std::runtime_error("the file ends too early");
    }
    std::memcpy(target, bytes_.data() + at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::size_t>(count);
    return at_ < bytes_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t position) override {
    if (position > bytes_.size()) throw std::runtime_error("the file ends too early");
    at_ = static_cast<std::size_t>(position);
  }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

class MemoryOutput : public Imf::OStream {
 public:
  MemoryOutput() : OStream("memory") {}

  void write(const char source[], int count) override {
    const std::size_t size = static_cast<std::size_t>(count);
    if (bytes_.size() < at_ + size) bytes_.resize(at_ + size);
    std::memcpy(bytes_.data() + at_, source, size);
    at_ += size;
  }
  std::uint64_t tellp() override { return at_; }
  void seekp(std::uint64_t position) override { at_ = static_cast<std::size_t>(position); }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  std::size_t at_ = 0;
};

/// A file as OpenEXR's stream, never in memory as a whole.
class FileInput : public Imf::IStream {
 public:
  FileInput(const RandomAccessFile& file, const std::string& name) : IStream(name.c_str()), file_(file) {}

  bool read(char target[], int count) override {
    if (count < 0 || static_cast<std::uint64_t>(count) > file_.size() - at_ ||
        !file_.read(at_, target, static_cast<std::size_t>(count))) {
      throw std::runtime_error("the file ends too early");
    }
    at_ += static_cast<std::uint64_t>(count);
    return at_ < file_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t position) override {
    if (position > file_.size()) throw std::runtime_error("the file ends too early");
    at_ = position;
  }

 private:
  const RandomAccessFile& file_;
  std::uint64_t at_ = 0;
};

/// A second fence behind `checkExrHeader`.
void limitOpenExrOnce() {
  static std::once_flag once;
  std::call_once(once, [] {
    Imf::Header::setMaxImageSize(kMaxImageSide, kMaxImageSide);
    Imf::Header::setMaxTileSize(kMaxImageSide, kMaxImageSide);
  });
}

Error malformed(const std::string& what, const std::string& where) {
  return {ErrorCode::Malformed, what, where, "save or copy the image again"};
}

std::vector<std::string> channelNames(const Imf::Header& header) {
  std::vector<std::string> names;
  for (auto it = header.channels().begin(); it != header.channels().end(); ++it)
    names.emplace_back(it.name());
  std::sort(names.begin(), names.end());
  return names;
}

std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kShown = 12;  // a message, not an inventory
  std::string text;
  for (std::size_t i = 0; i < names.size() && i < kShown; ++i) text += (i ? ", " : "") + inQuotes(names[i]);
  return names.size() > kShown ? text + ", ..." : text;
}

/// Runs `body`, with everything that OpenEXR throws made an Error.
template <typename T, typename Body>
Result<T> guarded(const std::string& where, Body&& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::Malformed, "there is not enough memory for this image", where,
                 "close other programs, or use a smaller image"};
  } catch (const std::exception& failure) {
    return malformed("the OpenEXR image is truncated or damaged: " + inQuotes(failure.what()), where);
  }
}

}  // namespace

namespace {

Status checkChannels(const Imf::Header& header, const std::vector<std::string>& channels,
                     const std::string& where) {
  for (const std::string& name : channels) {
    const Imf::Channel* channel = header.channels().findChannel(name);
    if (!channel) {
      return Error{ErrorCode::Malformed,
                   "the image has no channel " + inQuotes(name) + "; it has " + listed(channelNames(header)),
                   where, "save it with the channels " + listed(channels)};
    }
    if (channel->xSampling != 1 || channel->ySampling != 1) {
      return malformed("the image's channel " + inQuotes(name) + " is stored at a lower resolution", where);
    }
  }
  return Done{};
}

/// The header's check on the file's beginning; more of it where the header is longer.
Status checkBeginning(const RandomAccessFile& file, const std::string& where, ImageSize expected) {
  constexpr std::uint64_t kFirst = 1 << 16, kMost = 1 << 26;
  std::string beginning;
  for (std::uint64_t length = kFirst;; length *= 8) {
    beginning.resize(static_cast<std::size_t>(std::min(length, file.size())));
    if (!file.read(0, beginning.data(), beginning.size())) return malformed("the file can't be read", where);
    const Result<ImageSize> checked = checkExrHeader(beginning, where, expected, file.size());
    if (checked) return Done{};
    if (beginning.size() == file.size() || length >= kMost || checked.error().code != ErrorCode::Malformed)
      return checked.error();
  }
}

}  // namespace

Status readExrRows(const std::filesystem::path& path, const std::string& where,
                   const std::vector<std::string>& channels, ImageSize expected, int firstRow, int rowCount,
                   std::span<float> out) {
  if (firstRow < 0 || rowCount < 1 || firstRow + rowCount > expected.height || channels.empty() ||
      out.size() != static_cast<std::size_t>(rowCount) * expected.width * channels.size()) {
    throw std::invalid_argument("readExrRows: rows of the picture, and room for them");
  }
  const Result<RandomAccessFile> file = RandomAccessFile::open(path, kMaxImageFileBytes);
  if (!file) return file.error();
  if (Status checked = checkBeginning(*file, where, expected); !checked) return checked;
  limitOpenExrOnce();
  const Result<Done> read = guarded<Done>(where, [&]() -> Result<Done> {
    FileInput stream(*file, where);
    Imf::InputFile input(stream, 0);
    const Imath::Box2i window = input.header().dataWindow();
    const ImageSize size{window.max.x - window.min.x + 1, window.max.y - window.min.y + 1};
    if (size != expected) return malformed("the image's header contradicts itself", where);
    if (Status wanted = checkChannels(input.header(), channels, where); !wanted) return wanted.error();
    const Imath::Box2i rows(Imath::V2i(window.min.x, window.min.y + firstRow),
                            Imath::V2i(window.max.x, window.min.y + firstRow + rowCount - 1));
    Imf::FrameBuffer frame;
    const std::size_t pixelBytes = channels.size() * sizeof(float);
    for (std::size_t c = 0; c < channels.size(); ++c) {
      frame.insert(channels[c], Imf::Slice::Make(Imf::FLOAT, out.data() + c, rows, pixelBytes,
                                                 pixelBytes * static_cast<std::size_t>(size.width)));
    }
    input.setFrameBuffer(frame);
    input.readPixels(rows.min.y, rows.max.y);
    return Done{};
  });
  if (!read) return read.error();
  return Done{};
}

Result<Image> readExrBytes(std::string_view bytes, const std::string& where,
                           const std::vector<std::string>& channels, std::optional<ImageSize> expected) {
  const Result<ImageSize> checked = checkExrHeader(bytes, where, expected);
  if (!checked) return checked.error();
  limitOpenExrOnce();
  return guarded<Image>(where, [&]() -> Result<Image> {
    MemoryInput stream(bytes, where);
    Imf::InputFile file(stream, 0);
    const Imath::Box2i window = file.header().dataWindow();
    const ImageSize size{window.max.x - window.min.x + 1, window.max.y - window.min.y + 1};
    if (size != *checked) return malformed("the image's header contradicts itself", where);
    if (Status wanted = checkChannels(file.header(), channels, where); !wanted) return wanted.error();

    Image image(size.width, size.height, static_cast<int>(channels.size()));
    if (channels.empty()) return image;
    Imf::FrameBuffer frame;
    const std::size_t pixelBytes = channels.size() * sizeof(float);
    for (std::size_t c = 0; c < channels.size(); ++c) {
      frame.insert(channels[c], Imf::Slice::Make(Imf::FLOAT, image.samples().data() + c, window, pixelBytes,
                                                 pixelBytes * static_cast<std::size_t>(size.width)));
    }
    file.setFrameBuffer(frame);
    file.readPixels(window.min.y, window.max.y);
    return image;
  });
}

Result<Image> readExr(const std::filesystem::path& file, const std::vector<std::string>& channels,
                      std::optional<ImageSize> expected) {
  Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  return readExrBytes(*bytes, file.string(), channels, expected);
}

Result<std::vector<std::string>> exrChannels(const std::filesystem::path& file) {
  Result<std::string> bytes = readFile(file, kMaxImageFileBytes);
  if (!bytes) return bytes.error();
  const Result<ImageSize> checked = checkExrHeader(*bytes, file.string(), std::nullopt);
  if (!checked) return checked.error();
  limitOpenExrOnce();
  return guarded<std::vector<std::string>>(file.string(), [&]() -> Result<std::vector<std::string>> {
    MemoryInput stream(*bytes, file.string());
    return channelNames(Imf::InputFile(stream, 0).header());
  });
}

Status writeExr(const std::filesystem::path& file, const Image& image,
                const std::vector<std::string>& channels,
                const std::map<std::string, std::string>& attributes, bool half) {
  if (image.empty() || static_cast<int>(channels.size()) != image.channels()) {
    throw std::invalid_argument("writeExr: one name for each channel of a picture that isn't empty");
  }
  std::string bytes;
  try {
    Imf::Header header(image.width(), image.height());
    header.compression() = Imf::ZIP_COMPRESSION;
    for (const auto& [name, value] : attributes) header.insert(name, Imf::StringAttribute(value));

    // OpenEXR converts nothing when it writes, so that halves are made here.
    std::vector<Imath::half> halves;
    if (half) halves.assign(image.samples().begin(), image.samples().end());
    const std::size_t sampleBytes = half ? sizeof(Imath::half) : sizeof(float);
    const char* first = half ? reinterpret_cast<const char*>(halves.data())
                             : reinterpret_cast<const char*>(image.samples().data());
    const Imf::PixelType type = half ? Imf::HALF : Imf::FLOAT;
    Imf::FrameBuffer frame;
    const std::size_t pixelBytes = sampleBytes * channels.size();
    for (std::size_t c = 0; c < channels.size(); ++c) {
      header.channels().insert(channels[c], Imf::Channel(type));
      frame.insert(channels[c], Imf::Slice(type, const_cast<char*>(first + c * sampleBytes), pixelBytes,
                                           pixelBytes * static_cast<std::size_t>(image.width())));
    }
    MemoryOutput stream;
    {
      Imf::OutputFile output(stream, header, 0);  // its destructor writes the table of offsets
      output.setFrameBuffer(frame);
      output.writePixels(image.height());
    }
    bytes = stream.bytes();
  } catch (const std::exception& failure) {
    return Error{ErrorCode::WriteFailed, std::string("the image can't be made: ") + failure.what(),
                 file.string(), "free some memory"};
  }
  return writeFileAtomically(file, bytes);
}

Error notFinite(float value, std::size_t x, std::size_t y, std::size_t channel, const std::string& where) {
  return {ErrorCode::Invalid,
          std::string("the image holds ") + (std::isnan(value) ? "a NaN" : "an infinite value") +
              " at pixel (" + std::to_string(x) + ", " + std::to_string(y) + "), channel " +
              std::to_string(channel),
          where, "photograph or convert this image again; every pixel must be a finite number"};
}

Status requireFinite(const Image& image, const std::string& where) {
  const std::span<const float> samples = image.samples();
  const auto channels = static_cast<std::size_t>(image.channels());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (std::isfinite(samples[i])) continue;
    const std::size_t pixel = i / channels, width = static_cast<std::size_t>(image.width());
    return notFinite(samples[i], pixel % width, pixel / width, i % channels, where);
  }
  return Done{};
}

}  // namespace patina
