#pragma once

#include <pi_slam/imu_sample.h>
#include <pi_slam/stereo_calibration.h>
#include <pi_slam/trajectory_file.h>

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <variant>

namespace pi_slam
{

struct StereoPair
{
  int64_t stamp_ns = 0;  ///< of the left picture; of the right one where the left is missing
  cv::Mat left;          ///< CV_8UC1; empty: missing
  cv::Mat right;         ///< likewise
};

/// What a recording holds, one at a time.
using SequenceItem = std::variant<ImuSample, StereoPair>;

struct SequenceReaderOptions
{
  double start_s = 0.0;             ///< to leave out, counted from the first picture; >= 0
  double duration_s = 0.0;          ///< from there on; 0: to the end; >= 0
  double pair_tolerance_s = 0.002;  ///< between the stamps of a pair's pictures; in [0, 0.1]
  int read_ahead = 8;               ///< pairs that are loaded before they are asked for; in [1, 1000]

  /// @throws std::invalid_argument that names field, value and bound.
  void validate() const;
};

/// IMU samples are handed out from this long before the first pair to as long after the last one [s].
constexpr double IMU_MARGIN_S = 1.0;

/// Faults of a recording that can be used nevertheless.
struct SequenceDefects
{
  size_t single = 0;      ///< pairs handed out with one picture, the other is missing or damaged
  size_t unreadable = 0;  ///< pictures listed whose file is missing or damaged
  size_t dropped = 0;     ///< pairs without any picture left: not handed out
  size_t unsorted = 0;    ///< pictures and samples that came too late: put in order, or left out if that was too late
  size_t repeated = 0;    ///< pictures and samples with the stamp of the one before: left out
  std::string first;      ///< one sentence about the first unreadable picture

  bool any() const { return single + unreadable + dropped + unsorted + repeated > 0; }
};

struct SequenceDescription
{
  std::string name;                              ///< of the folder or file
  size_t pairs = 0;                              ///< to be expected, about
  int64_t first_ns = 0;                          ///< stamp of the first pair within the span asked for
  std::optional<StereoCalibration> calibration;  ///< if the recording has one
  std::optional<ImuModel> imu;                   ///< likewise: rate and noise
  std::string ground_truth;                      ///< a file of poses within the recording; empty: there is none
};

/// Where a recording comes from: one implementation per format. Used by one thread at a time.
class SequenceSource
{
public:
  virtual ~SequenceSource() = default;
  /// Does not change any more: any thread may read it.
  const SequenceDescription& description() const { return description_; }
  /// The next sample or pair in order of time (IMU first at equal stamps); nullopt at the end. Loads pictures.
  /// @throws RecordingError
  virtual std::optional<SequenceItem> next() = 0;
  /// So far.
  const SequenceDefects& defects() const { return defects_; }

protected:
  /// Counts a picture that cannot be read. @param sentence  about it.
  void countUnreadable(const std::string& sentence)
  {
    ++defects_.unreadable;
    defects_.first = defects_.first.empty() ? sentence : defects_.first;
  }
  /// Counts a pair without both pictures. @return false if it has none.
  bool hasPicture(const StereoPair& pair)
  {
    const bool none = pair.left.empty() && pair.right.empty();
    defects_.dropped += none ? 1 : 0;
    defects_.single += !none && (pair.left.empty() || pair.right.empty()) ? 1 : 0;
    return !none;
  }

  SequenceDescription description_;
  SequenceDefects defects_;
};

/// Opens a recording in the layout of the EuRoC MAV data set: mav0/{cam0,cam1}/{data.csv,data/,sensor.yaml} and
/// mav0/imu0/{data.csv,sensor.yaml}; sensor.yaml and ground truth may be missing.
/// @param folder  with mav0 in it, or mav0 itself.
/// @throws RecordingError for a missing or unreadable csv, a line that cannot be read, nothing within the span, or
///         pictures without any pair; CalibrationError for a sensor.yaml that cannot be used;
///         std::invalid_argument for options out of range.
std::unique_ptr<SequenceSource> openEuroc(const std::string& folder, const SequenceReaderOptions& options = {});

/// Reads a source ahead on a thread of its own, so that loading pictures takes no time from the one who uses them.
/// Used by one thread.
class SequenceReader
{
public:
  /// @param read_ahead  pairs that wait at most, >= 1.
  explicit SequenceReader(std::unique_ptr<SequenceSource> source, int read_ahead = 8);
  /// Ends the thread; what was read ahead is lost.
  ~SequenceReader();
  SequenceReader(const SequenceReader&) = delete;
  SequenceReader& operator=(const SequenceReader&) = delete;

  const SequenceDescription& description() const;
  /// As SequenceSource::next(); waits for pictures that are not loaded yet. Throws in its turn what the source threw.
  std::optional<SequenceItem> next();
  /// Of what was read so far.
  SequenceDefects defects() const;
  /// CPU time that reading has taken so far [s], to be left out of measurements.
  double cpuSeconds() const;

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_slam
