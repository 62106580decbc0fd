#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

/// A made-up EuRoC recording for tests: 64x48 pictures at 20 Hz, IMU and ground truth at 200 Hz. Every value can be
/// computed from its index.
struct TinyRecording
{
  static constexpr int WIDTH = 64;
  static constexpr int HEIGHT = 48;
  static constexpr int PICTURES = 10;
  static constexpr int SAMPLES = 110;  ///< of IMU and ground truth; they begin 50 ms before the first picture
  static constexpr int64_t FIRST_SAMPLE_NS = 1500000000000000000LL;
  static constexpr int64_t FIRST_PICTURE_NS = FIRST_SAMPLE_NS + 50000000LL;
  static constexpr int64_t PICTURE_PERIOD_NS = 50000000LL;
  static constexpr int64_t SAMPLE_PERIOD_NS = 5000000LL;
  static constexpr double BASELINE_M = 0.1;

  /// Grey value of all pixels of a picture. The right one is brighter by 100.
  static uint8_t grey(bool left, int index) { return static_cast<uint8_t>((left ? 10 : 110) + index); }
  static int64_t pictureStamp(int index) { return FIRST_PICTURE_NS + index * PICTURE_PERIOD_NS; }
  static int64_t sampleStamp(int index) { return FIRST_SAMPLE_NS + index * SAMPLE_PERIOD_NS; }
  static std::string pictureName(int index) { return std::to_string(pictureStamp(index)) + ".png"; }

  /// Writes mav0 and groundtruth_tum.txt below `folder`, which is created.
  static void write(const std::filesystem::path& folder);
};

/// A folder that lives as long as the object.
class TemporaryFolder
{
public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
};

/// Replaces the content of a file.
void writeText(const std::filesystem::path& file, const std::string& text);
