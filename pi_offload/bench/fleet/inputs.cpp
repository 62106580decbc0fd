#include <pi_speech/audio.h>

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <system_error>

#include "inputs.h"

namespace pi_offload_bench
{
namespace
{

namespace fs = std::filesystem;

constexpr int JPEG_QUALITY = 85;
constexpr size_t MOST_PICTURES = 32;

}  // namespace

std::vector<std::vector<uint8_t>> loadPictures(const std::string& folder)
{
  std::error_code error;
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
  {
    if (entry.path().extension() == ".jpg" || entry.path().extension() == ".jpeg")
    {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<std::vector<uint8_t>> pictures;
  for (size_t i = 0; i < files.size() && pictures.size() < MOST_PICTURES; ++i)
  {
    const cv::Mat picture = cv::imread(files[i].string(), cv::IMREAD_COLOR);
    if (!picture.empty())
    {
      cv::Mat scaled;
      cv::resize(picture, scaled, {PICTURE_WIDTH, PICTURE_HEIGHT}, 0.0, 0.0, cv::INTER_AREA);
      pictures.emplace_back();
      cv::imencode(".jpg", scaled, pictures.back(), {cv::IMWRITE_JPEG_QUALITY, JPEG_QUALITY});
    }
  }
  if (pictures.empty())
  {
    throw std::runtime_error(folder + ": no JPEG picture can be read there; give --pictures FOLDER");
  }
  return pictures;
}

std::vector<uint8_t> loadSound(const std::string& path)
{
  std::vector<uint8_t> bytes;
  for (const int16_t sample : pi_speech::readAudioFile(path))
  {
    bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) & 0xFFU));
    bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) >> 8U));
  }
  return bytes;
}

}  // namespace pi_offload_bench
