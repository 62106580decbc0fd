#include "pictures/jpeg_encoder.h"

#include <turbojpeg.h>

#include <algorithm>
#include <stdexcept>

namespace pi_web
{
namespace
{

/// Reads the fields of a serialised message one by one.
class FieldReader
{
public:
  explicit FieldReader(const Bytes& bytes) : at_(reinterpret_cast<const char*>(bytes.data())), end_(at_ + bytes.size())
  {
  }

  uint32_t number() { return readUint32(take(4)); }
  uint8_t byte() { return static_cast<uint8_t>(*take(1)); }
  std::string_view text()
  {
    const uint32_t length = number();
    return {take(length), length};
  }

private:
  const char* take(size_t bytes)
  {
    if (static_cast<size_t>(end_ - at_) < bytes)
    {
      throw std::invalid_argument("a picture ends too early");
    }
    return std::exchange(at_, at_ + bytes);
  }
  const char* at_;
  const char* end_;
};

struct PixelFormat
{
  const char* encoding;
  int turbo;
  int bytes;      ///< of a pixel
  int high_byte;  ///< offset of the byte that counts, of mono16
};

constexpr PixelFormat PIXEL_FORMATS[] = {
    {"mono8", TJPF_GRAY, 1, 0}, {"8UC1", TJPF_GRAY, 1, 0}, {"mono16", TJPF_GRAY, 2, 1}, {"bgr8", TJPF_BGR, 3, 0},
    {"8UC3", TJPF_BGR, 3, 0},   {"rgb8", TJPF_RGB, 3, 0},  {"bgra8", TJPF_BGRX, 4, 0},  {"rgba8", TJPF_RGBX, 4, 0}};

const PixelFormat& formatOf(std::string_view encoding)
{
  for (const PixelFormat& format : PIXEL_FORMATS)
  {
    if (encoding == format.encoding)
    {
      return format;
    }
  }
  throw std::invalid_argument("encoding " + std::string(encoding.substr(0, 20)) +
                              ", must be mono8, mono16, bgr8, rgb8, bgra8 or rgba8");
}

void appendText(std::string_view text, std::string* bytes)
{
  appendUint32(static_cast<uint32_t>(text.size()), bytes);
  bytes->append(text);
}

/// Means of factor x factor pixels.
void shrink(const PictureView& picture, const PixelFormat& format, uint32_t factor, std::vector<uint8_t>* small)
{
  const uint32_t width = picture.width / factor;
  const uint32_t height = picture.height / factor;
  const auto channels = static_cast<uint32_t>(format.turbo == TJPF_GRAY ? 1 : format.bytes);
  const auto stride = static_cast<uint32_t>(format.bytes);
  small->resize(static_cast<size_t>(width) * height * channels);
  std::vector<uint32_t> sums(static_cast<size_t>(width) * channels);
  const uint32_t area = factor * factor;
  for (uint32_t y = 0; y < height; ++y)
  {
    std::fill(sums.begin(), sums.end(), area / 2);
    for (uint32_t row = 0; row < factor; ++row)
    {
      const uint8_t* pixel = picture.pixels + static_cast<size_t>(y * factor + row) * picture.step + format.high_byte;
      for (uint32_t x = 0; x < width; ++x)
      {
        for (uint32_t column = 0; column < factor; ++column, pixel += stride)
        {
          for (uint32_t c = 0; c < channels; ++c)
          {
            sums[x * channels + c] += pixel[c];
          }
        }
      }
    }
    uint8_t* out = small->data() + static_cast<size_t>(y) * sums.size();
    std::transform(sums.begin(), sums.end(), out, [area](uint32_t sum) { return static_cast<uint8_t>(sum / area); });
  }
}

}  // namespace

PictureView::PictureView(const Bytes& message)
{
  FieldReader reader(message);
  seq = reader.number();
  stamp_sec = reader.number();
  stamp_nsec = reader.number();
  frame_id = reader.text();
  height = reader.number();
  width = reader.number();
  encoding = reader.text();
  reader.byte();  // is_bigendian
  step = reader.number();
  const std::string_view data = reader.text();
  pixels = reinterpret_cast<const uint8_t*>(data.data());
  constexpr uint32_t most = 16384;
  if (width == 0 || height == 0 || width > most || height > most ||
      step < static_cast<uint64_t>(width) * static_cast<uint32_t>(formatOf(encoding).bytes) ||
      data.size() < static_cast<uint64_t>(step) * height)
  {
    throw std::invalid_argument(std::to_string(width) + "x" + std::to_string(height) + " with " +
                                std::to_string(data.size()) + " bytes, must be that many pixels");
  }
}

JpegEncoder::JpegEncoder(int max_width, int quality)
  : max_width_(max_width), quality_(quality), compressor_(tjInitCompress())
{
  if (compressor_ == nullptr)
  {
    throw std::runtime_error(std::string("turbojpeg: ") + tjGetErrorStr2(nullptr));
  }
}

JpegEncoder::~JpegEncoder()
{
  tjFree(buffer_);
  tjDestroy(compressor_);
}

Payload JpegEncoder::encode(const Bytes& image)
{
  const PictureView picture(image);
  const PixelFormat& format = formatOf(picture.encoding);
  const auto most = static_cast<uint32_t>(max_width_);
  const uint32_t factor = std::min((picture.width + most - 1) / most, std::min(picture.width, picture.height));
  const bool as_it_is = factor == 1 && format.high_byte == 0;
  if (!as_it_is)
  {
    shrink(picture, format, factor, &small_);
  }
  const auto width = static_cast<int>(picture.width / factor);
  const auto height = static_cast<int>(picture.height / factor);
  const int sampling = format.turbo == TJPF_GRAY ? TJSAMP_GRAY : TJSAMP_420;
  if (const unsigned long bound = tjBufSize(width, height, sampling); bound > capacity_)
  {
    tjFree(buffer_);
    buffer_ = tjAlloc(static_cast<int>(bound));
    capacity_ = bound;
  }
  unsigned long size = capacity_;
  if (tjCompress2(compressor_, as_it_is ? picture.pixels : small_.data(), width,
                  as_it_is ? static_cast<int>(picture.step) : 0, height, format.turbo, &buffer_, &size, sampling,
                  quality_, TJFLAG_FASTDCT | TJFLAG_NOREALLOC) != 0)
  {
    throw std::invalid_argument(std::string("no JPEG of it: ") + tjGetErrorStr2(compressor_));
  }
  std::string head;
  for (const uint32_t number : {picture.seq, picture.stamp_sec, picture.stamp_nsec})
  {
    appendUint32(number, &head);
  }
  appendText(picture.frame_id, &head);
  appendText("jpeg " + std::to_string(picture.width) + "x" + std::to_string(picture.height), &head);
  appendUint32(static_cast<uint32_t>(size), &head);
  auto result = std::make_shared<Bytes>();
  result->reserve(head.size() + size);
  result->assign(head.begin(), head.end());
  result->insert(result->end(), buffer_, buffer_ + size);
  return result;
}

}  // namespace pi_web
