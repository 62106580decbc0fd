#include "client/picture_encoder.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace pi_offload
{
namespace
{

constexpr int MAX_SIDE_PX = 16384;
constexpr double SMOOTHING = 0.2;          ///< weight of the newest picture
constexpr double LEAST_RATE_MBPS = 0.001;  ///< lower rates count as this

size_t channels(Encoding encoding)
{
  return encoding == Encoding::MONO8 ? 1 : 3;
}

double megapixels(const PictureData& picture)
{
  return 1e-6 * picture.width * picture.height;
}

}  // namespace

void PictureData::validate() const
{
  if (encoding != Encoding::BGR8 && encoding != Encoding::RGB8 && encoding != Encoding::MONO8)
  {
    throw std::invalid_argument("encoding " + std::to_string(static_cast<int>(encoding)) +
                                " is no picture, must be BGR8, RGB8 or MONO8");
  }
  if (data == nullptr || width < 1 || height < 1 || width > MAX_SIDE_PX || height > MAX_SIDE_PX)
  {
    throw std::invalid_argument("picture of " + std::to_string(width) + "x" + std::to_string(height) +
                                " pixels, must be 1x1 to 16384x16384");
  }
  if (stride < static_cast<size_t>(width) * channels(encoding))
  {
    throw std::invalid_argument("stride = " + std::to_string(stride) + ", must be at least " +
                                std::to_string(static_cast<size_t>(width) * channels(encoding)));
  }
}

size_t PictureData::bytes() const
{
  return static_cast<size_t>(width) * static_cast<size_t>(height) * channels(encoding);
}

const char* toString(PictureMode mode)
{
  switch (mode)
  {
    case PictureMode::AUTO:
      return "auto";
    case PictureMode::JPEG:
      return "jpeg";
    case PictureMode::RAW:
      return "raw";
  }
  return "unknown";
}

void PictureEncoder::Options::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("jpeg_quality", jpeg_quality, 1, 100);
  check.range<size_t>("max_raw_bytes", max_raw_bytes, 0, MAX_PAYLOAD);
  check.positive("first_jpeg_s_per_mpixel", first_jpeg_s_per_mpixel);
  check.positive("first_jpeg_bytes_per_pixel", first_jpeg_bytes_per_pixel);
  check.range("retry_after", retry_after, 1, 1000000);
}

PictureEncoder::PictureEncoder(const Options& options)
  : options_(options)
  , jpeg_s_per_mpixel_(options.first_jpeg_s_per_mpixel)
  , jpeg_bytes_per_pixel_(options.first_jpeg_bytes_per_pixel)
{
  options_.validate();
}

Encoding PictureEncoder::choose(const PictureData& picture, const Situation& situation) const
{
  if (options_.mode == PictureMode::JPEG || (picture.bytes() > options_.max_raw_bytes))
  {
    return Encoding::JPEG;
  }
  if (options_.mode == PictureMode::RAW)
  {
    return picture.encoding;
  }
  double jpeg_s = 0.0;
  double jpeg_bytes = 0.0;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (raw_in_row_ >= options_.retry_after)
    {
      return Encoding::JPEG;
    }
    jpeg_s = jpeg_s_per_mpixel_ * megapixels(picture);
    jpeg_bytes = 1e6 * jpeg_bytes_per_pixel_ * megapixels(picture);
  }
  const auto sending = [&situation](double bytes)
  {
    const double time_s = 8e-6 * bytes / std::max(LEAST_RATE_MBPS, situation.rate_mbps);
    return Cost{time_s, situation.transmit_w * time_s};
  };
  Cost jpeg = sending(jpeg_bytes);
  jpeg.time_s += jpeg_s;
  jpeg.energy_j += situation.busy_w * jpeg_s;
  const Cost raw = sending(static_cast<double>(picture.bytes()));
  const auto cost = [&situation](const Cost& of)
  { return normalisedCost(of, situation.deadline_s, situation.local_energy_j, situation.eta); };
  return cost(jpeg) <= cost(raw) ? Encoding::JPEG : picture.encoding;
}

size_t PictureEncoder::expectedBytes(const PictureData& picture, Encoding encoding) const
{
  if (encoding != Encoding::JPEG)
  {
    return picture.bytes();
  }
  std::lock_guard<std::mutex> lock(mutex_);
  return static_cast<size_t>(std::lround(1e6 * jpeg_bytes_per_pixel_ * megapixels(picture)));
}

std::vector<uint8_t> PictureEncoder::encode(const PictureData& picture, Encoding encoding)
{
  picture.validate();
  if (encoding != Encoding::JPEG && encoding != picture.encoding)
  {
    throw std::invalid_argument("a picture is sent as JPEG or as it is");
  }
  std::vector<uint8_t> bytes;
  if (encoding != Encoding::JPEG)
  {
    const size_t row = static_cast<size_t>(picture.width) * channels(encoding);
    bytes.resize(picture.bytes());
    for (int y = 0; y < picture.height; ++y)
    {
      std::memcpy(bytes.data() + static_cast<size_t>(y) * row, picture.data + static_cast<size_t>(y) * picture.stride,
                  row);
    }
    std::lock_guard<std::mutex> lock(mutex_);
    ++raw_in_row_;
    return bytes;
  }
  const auto begin = std::chrono::steady_clock::now();
  // cv::Mat takes no pointer to const.
  cv::Mat mat(picture.height, picture.width, picture.encoding == Encoding::MONO8 ? CV_8UC1 : CV_8UC3,
              const_cast<uint8_t*>(picture.data), picture.stride);
  if (picture.encoding == Encoding::RGB8)
  {
    cv::Mat bgr;
    cv::cvtColor(mat, bgr, cv::COLOR_RGB2BGR);
    mat = bgr;
  }
  if (!cv::imencode(".jpg", mat, bytes, {cv::IMWRITE_JPEG_QUALITY, options_.jpeg_quality}))
  {
    throw std::runtime_error("OpenCV cannot encode the picture as JPEG");
  }
  const double took_s = pi_node::secondsSince(begin);
  std::lock_guard<std::mutex> lock(mutex_);
  const double weight = measured_ ? SMOOTHING : 1.0;
  jpeg_s_per_mpixel_ += weight * (took_s / megapixels(picture) - jpeg_s_per_mpixel_);
  jpeg_bytes_per_pixel_ +=
      weight * (1e-6 * static_cast<double>(bytes.size()) / megapixels(picture) - jpeg_bytes_per_pixel_);
  measured_ = true;
  raw_in_row_ = 0;
  return bytes;
}

double PictureEncoder::jpegSecondsPerMpixel() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return jpeg_s_per_mpixel_;
}

double PictureEncoder::jpegBytesPerPixel() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return jpeg_bytes_per_pixel_;
}

}  // namespace pi_offload
