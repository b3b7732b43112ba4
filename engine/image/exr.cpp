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
    for (const std::string& name : channels) {
      const Imf::Channel* channel = file.header().channels().findChannel(name);
      if (!channel) {
        return Error{
            ErrorCode::Malformed,
            "the image has no channel " + inQuotes(name) + "; it has " + listed(channelNames(file.header())),
            where, "save it with the channels " + listed(channels)};
      }
      if (channel->xSampling != 1 || channel->ySampling != 1) {
        return malformed("the image's channel " + inQuotes(name) + " is stored at a lower resolution", where);
      }
    }

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

Status requireFinite(const Image& image, const std::string& where) {
  const std::span<const float> samples = image.samples();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (std::isfinite(samples[i])) continue;
    const std::size_t pixel = i / static_cast<std::size_t>(image.channels());
    const std::size_t width = static_cast<std::size_t>(image.width());
    return Error{ErrorCode::Invalid,
                 std::string("the image holds ") + (std::isnan(samples[i]) ? "a NaN" : "an infinite value") +
                     " at pixel (" + std::to_string(pixel % width) + ", " + std::to_string(pixel / width) +
                     "), channel " + std::to_string(i % static_cast<std::size_t>(image.channels())),
                 where, "photograph or convert this image again; every pixel must be a finite number"};
  }
  return Done{};
}

}  // namespace patina
