#pragma once

#include <pi_bringup/euroc_dataset.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace pi_bringup
{

enum class Stream
{
  IMU,
  GROUND_TRUTH,
  LEFT,
  RIGHT
};

struct TimelineItem
{
  int64_t stamp_ns = 0;  ///< recorded time
  Stream stream = Stream::IMU;
  size_t index = 0;  ///< into the samples of the stream
};

struct TimelineOptions
{
  bool start_at_first_image = false;  ///< drop what was recorded before the first left picture
  double start_s = 0.0;               ///< dropped at the start [s], >= 0; on top of start_at_first_image
  double duration_s = 0.0;            ///< recorded time to keep [s]; 0: all
};

/// The samples of all streams of a recording in the order in which they are due. At equal stamps: IMU, ground truth,
/// left, right, so that who gets a picture already has the inertial data up to it.
struct Timeline
{
  int64_t start_ns = 0;   ///< recorded time at which playback starts
  int64_t period_ns = 0;  ///< recorded time from one lap to the next when looping
  std::vector<TimelineItem> items;

  /// @throws std::invalid_argument if an option is out of range or nothing is left to play.
  static Timeline build(const EurocDataset& dataset, const TimelineOptions& options);
};

}  // namespace pi_bringup
