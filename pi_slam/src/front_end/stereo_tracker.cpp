#include "front_end/stereo_tracker.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <unordered_set>

#include <pi_node/option_check.h>
#include "front_end/picture_statistics.h"
#include "front_end/stereo_tracker_impl.h"

namespace pi_slam
{

namespace
{

namespace kernels = pi_runtime::kernels;
using front_end::Pixel;
using front_end::Pyramid;
using front_end::Track;

constexpr int64_t LONGEST_WAIT_NS = 1000000000;       ///< over which features are looked for again after blank pictures
constexpr int64_t LONGEST_REFERENCE_NS = 2000000000;  ///< light changes
constexpr int SLOW_PAIRS = 4;                         ///< of slow_px, which features may go
constexpr double LEAST_KEPT = 0.8;                    ///< of the features that the reference pictures had
constexpr double MOTION_PART = 2.0 / 3.0;   ///< of epipolar_px: the motion is estimated, the calibration is as it is
constexpr double MOST_GAIN = 4.0;           ///< between two exposures that can be made up for
constexpr double LEAST_GAIN_CHANGE = 0.01;  ///< smaller ones are left

class Clock
{
public:
  /// Milliseconds since the last call.
  double lap()
  {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

void StereoTrackerOptions::validate() const
{
  const pi_node::OptionCheck check("tracker");
  check.range("max_features", max_features, 20, 2000);
  check.range("cell_px", cell_px, 8, 200);
  check.range("min_distance_px", min_distance_px, 2.0, 100.0);
  check.range("fast_threshold", fast_threshold, 1, 100);
  check.range("levels", levels, 1, kernels::MAX_PYRAMID_LEVELS);
  check.range("window_px", window_px, 5, kernels::MAX_TRACK_WINDOW);
  check.range("max_iterations", max_iterations, 1, 100);
  check.range("epsilon_px", epsilon_px, 0.001, 1.0);
  check.range("slow_px", slow_px, 0.0, 5.0);
  check.range("max_residual", max_residual, 1.0, 255.0);
  check.range("epipolar_px", epipolar_px, 0.1, 20.0);
  check.range("min_depth_m", min_depth_m, 0.01, 10.0);
  if (window_px % 2 == 0)
  {
    throw std::invalid_argument("tracker/window_px = " + std::to_string(window_px) + ", must be odd");
  }
}

StereoTracker::Impl::Impl(const StereoCalibration& calibration, const StereoTrackerOptions& tracker_options,
                          std::shared_ptr<pi_runtime::Runtime> runtime)
  : options(tracker_options)
  , geometry(calibration)
  , pictures(calibration.left.model.width, calibration.left.model.height, tracker_options.levels,
             {tracker_options.window_px, tracker_options.max_iterations, tracker_options.epsilon_px},
             tracker_options.kernel_tasks ? std::move(runtime) : nullptr)
  , search(geometry, tracker_options.min_depth_m, std::min(1, tracker_options.levels - 1))
  , motion_check(geometry, MOTION_PART * tracker_options.epipolar_px)
{
  for (int c = LEFT; c <= RIGHT; ++c)
  {
    reference[c] = pictures.makePyramid();
    now[c] = pictures.makePyramid();
  }
}

void StereoTracker::Impl::forget()
{
  tracks.clear();
  has_last = false;
  R_last_now.setIdentity();
  velocity.setZero();
  fast_threshold[LEFT] = fast_threshold[RIGHT] = options.fast_threshold;
}

void StereoTracker::Impl::takePictures(const std::array<const cv::Mat*, 2>& images, TrackerReport* report)
{
  std::array<const cv::Mat*, 2> present = images;
  for (size_t c = 0; c < 2; ++c)
  {
    present[c] = images[c]->empty() ? nullptr : images[c];
  }
  pictures.build(present, {now[LEFT], now[RIGHT]});
  for (size_t c = 0; c < 2; ++c)
  {
    front_end::PictureStatistics statistics;
    if (present[c] != nullptr)
    {
      statistics = front_end::describePicture(pictures.view(now[c], std::min(2, pictures.levels() - 1)));
    }
    report->mean_grey[c] = statistics.mean;
    report->contrast[c] = statistics.contrast;
    report->blank[c] = front_end::isBlank(statistics);
    usable[c] = !report->blank[c];
  }
  mean_ratio = usable[LEFT] && usable[RIGHT] ? report->mean_grey[LEFT] / report->mean_grey[RIGHT] : 1.0;
}

/// Makes `changed` as bright as the other pyramid where both show the points in pairs_at.
void StereoTracker::Impl::equalise(const Pyramid& like, const Pyramid& changed, double fallback)
{
  const int level = std::min(2, pictures.levels() - 1);
  const float scale = 1.0F / static_cast<float>(1 << level);
  for (auto& [a, b] : same_places)
  {
    a = Pixel{a.x * scale, a.y * scale};
    b = Pixel{b.x * scale, b.y * scale};
  }
  const double measured =
      front_end::brightnessRatio(pictures.view(like, level), pictures.view(changed, level), same_places)
          .value_or(fallback);
  const double gain = std::min(std::max(measured, 1.0 / MOST_GAIN), MOST_GAIN);
  if (std::abs(gain - 1.0) > LEAST_GAIN_CHANGE)
  {
    front_end::multiplyPyramid(changed, gain);
  }
}

/// A feature that is followed from picture to picture lags behind a slow motion, by some percent: its patch is cut out
/// anew each time, where the last search ended. So patches stay those of one picture until they have moved.
bool StereoTracker::Impl::referenceDue(int64_t stamp_ns) const
{
  if (!has_last || threshold_falls || stamp_ns - reference_ns > LONGEST_REFERENCE_NS ||
      usable[LEFT] != reference_usable[LEFT] || usable[RIGHT] != reference_usable[RIGHT] ||
      static_cast<double>(tracks.size()) < LEAST_KEPT * static_cast<double>(reference_tracks))
  {
    return true;
  }
  std::vector<float> ways;
  for (const Track& track : tracks)
  {
    const int c = homeOf(track);
    if (track.referenced[c])
    {
      const Eigen::Vector2f& pixel = track.seen.pixel[c];
      ways.push_back(std::hypot(pixel.x() - track.reference[c].x, pixel.y() - track.reference[c].y));
    }
  }
  const auto middle = ways.begin() + static_cast<std::ptrdiff_t>(ways.size() / 2);
  std::nth_element(ways.begin(), middle, ways.end());
  const double most_px = options.slow_px * std::min(reference_pairs, SLOW_PAIRS);
  return ways.empty() || *middle >= static_cast<float>(most_px);
}

void StereoTracker::Impl::renewReference(int64_t stamp_ns)
{
  for (int c = LEFT; c <= RIGHT; ++c)
  {
    std::swap(reference[c], now[c]);
    reference_usable[c] = usable[c];
    for (Track& track : tracks)
    {
      track.referenced[c] = track.seen.seen[c];
      track.reference[c] = front_end::toPixel(track.seen.pixel[c]);
    }
  }
  reference_ns = stamp_ns;
  reference_tracks = tracks.size();
  reference_pairs = 0;
}

FrameFeatures StereoTracker::Impl::process(int64_t stamp_ns, const std::array<const cv::Mat*, 2>& images,
                                           const TrackerPrediction& prediction, size_t max_features,
                                           TrackerReport* report)
{
  Clock clock;
  FrameFeatures result;
  result.stamp_ns = stamp_ns;
  takePictures(images, report);
  report->pyramid_ms = clock.lap();
  R_last_now = (R_last_now * prediction.R_last_now).normalized();
  if (!usable[LEFT] && !usable[RIGHT])
  {
    if (has_last && stamp_ns - last_ns > LONGEST_WAIT_NS)
    {
      forget();
    }
    return result;
  }
  if (has_last)
  {
    followTracks(prediction, std::abs(static_cast<double>(stamp_ns - last_ns)) * 1e-9, report);
  }
  tracks.resize(std::min(tracks.size(), max_features));  // the oldest ones are known best
  report->track_ms = clock.lap();
  matchKnown();
  report->stereo_ms = clock.lap();
  const size_t before = tracks.size();
  dropUnpaired();
  report->lost += static_cast<int>(before - tracks.size());
  const size_t old_count = tracks.size();
  const bool renew = referenceDue(stamp_ns);
  if (renew)
  {
    addCorners(max_features);
  }
  report->detect_ms = clock.lap();
  matchUnknown();
  chooseNew(old_count, max_features, report);
  report->stereo_ms += clock.lap();

  result.features.reserve(tracks.size());
  for (const Track& track : tracks)
  {
    result.features.push_back(track.seen);
    report->stereo += track.seen.seen[LEFT] && track.seen.seen[RIGHT] ? 1 : 0;
  }
  if (renew)
  {
    renewReference(stamp_ns);
  }
  ++reference_pairs;
  has_last = true;
  last_ns = stamp_ns;
  R_last_now.setIdentity();
  return result;
}

StereoTracker::StereoTracker(const StereoCalibration& calibration, const StereoTrackerOptions& options,
                             std::shared_ptr<pi_runtime::Runtime> runtime)
{
  options.validate();
  calibration.left.model.validate();
  calibration.right.model.validate();
  const CameraModel& left = calibration.left.model;
  const CameraModel& right = calibration.right.model;
  if (left.width != right.width || left.height != right.height)
  {
    throw std::invalid_argument("StereoTracker: the left camera has " + std::to_string(left.width) + " x " +
                                std::to_string(left.height) + " px, the right one " + std::to_string(right.width) +
                                " x " + std::to_string(right.height) + "; both must be of the same size");
  }
  const double baseline_m =
      (calibration.left.T_body_camera.translation() - calibration.right.T_body_camera.translation()).norm();
  if (!(baseline_m >= 0.001 && baseline_m <= 100.0))
  {
    throw std::invalid_argument("StereoTracker: the cameras are " + std::to_string(baseline_m) +
                                " m apart, must be in [0.001, 100]; check T_body_camera of both");
  }
  if (options.kernel_tasks && !runtime)
  {
    throw std::invalid_argument("StereoTracker: tracker/kernel_tasks is set, but there is no runtime");
  }
  impl_ = std::make_unique<Impl>(calibration, options, std::move(runtime));
}

StereoTracker::~StereoTracker() = default;

FrameFeatures StereoTracker::process(int64_t stamp_ns, const cv::Mat& left, const cv::Mat& right,
                                     const TrackerPrediction& prediction, int max_features, TrackerReport* report)
{
  const std::array<const cv::Mat*, 2> images{&left, &right};
  for (int c = LEFT; c <= RIGHT; ++c)
  {
    const cv::Mat& image = *images[static_cast<size_t>(c)];
    const CameraModel& camera = impl_->geometry.camera(c);
    if (!image.empty() && (image.type() != CV_8UC1 || image.cols != camera.width || image.rows != camera.height))
    {
      throw std::invalid_argument("StereoTracker: the " + std::string(c == LEFT ? "left" : "right") + " picture is " +
                                  std::to_string(image.cols) + " x " + std::to_string(image.rows) + " of type " +
                                  cv::typeToString(image.type()) + ", must be " + std::to_string(camera.width) + " x " +
                                  std::to_string(camera.height) + " of type CV_8UC1, as calibrated");
    }
  }
  const Eigen::Quaterniond& q = prediction.R_last_now;
  if (!q.coeffs().allFinite() || std::abs(q.norm() - 1.0) > 1e-3)
  {
    throw std::invalid_argument("StereoTracker: R_last_now is no rotation (norm " + std::to_string(q.norm()) + ")");
  }
  TrackerReport unused;
  TrackerReport& filled = report != nullptr ? *report : unused;
  filled = TrackerReport();
  const int most = std::min(std::max(max_features, 0), impl_->options.max_features);
  return impl_->process(stamp_ns, images, prediction, static_cast<size_t>(most), &filled);
}

void StereoTracker::drop(const std::vector<int64_t>& ids)
{
  const std::unordered_set<int64_t> dropped(ids.begin(), ids.end());
  std::vector<Track>& tracks = impl_->tracks;
  tracks.erase(std::remove_if(tracks.begin(), tracks.end(),
                              [&dropped](const Track& track) { return dropped.count(track.seen.id) > 0; }),
               tracks.end());
}

void StereoTracker::reset()
{
  impl_->forget();
}

}  // namespace pi_slam
