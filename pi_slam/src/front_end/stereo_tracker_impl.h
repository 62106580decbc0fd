#pragma once

#include "front_end/stereo_tracker.h"

#include <cmath>
#include <utility>
#include <vector>

#include "front_end/curve_search.h"
#include "front_end/motion_check.h"
#include "front_end/picture_kernels.h"
#include "front_end/stereo_geometry.h"

namespace pi_slam
{

namespace front_end
{

constexpr float BORDER_PX = 2.0F;  ///< features nearer to the border are lost
constexpr int NEAR_LEVELS = 2;     ///< of the pyramid, where the start is about right

struct Track
{
  FeatureObservation seen;
  bool referenced[2] = {false, false};      ///< seen in the reference pictures
  Pixel reference[2] = {};                  ///< where
  double inverse_distance[2] = {0.0, 0.0};  ///< from each camera [1/m], by the last stereo match
  bool has_depth = false;
  int missed = 0;  ///< pairs in a row without a stereo match although both cameras ought to see it
};

/// A feature on its way from the last pair to this one.
struct Step
{
  size_t track;
  int camera;
  size_t slot;  ///< in the batch of its camera
  Pixel by_rotation;
  Eigen::Vector3d bearing;
};

inline Pixel toPixel(const Eigen::Vector2d& p)
{
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

inline Pixel toPixel(const Eigen::Vector2f& p)
{
  return {p.x(), p.y()};
}

}  // namespace front_end

/// process() goes through the stages from top to bottom; they hand over by `tracks`, and use `steps`, `batches` and
/// `back` for what belongs to one stage.
struct StereoTracker::Impl
{
  Impl(const StereoCalibration& calibration, const StereoTrackerOptions& tracker_options,
       std::shared_ptr<pi_runtime::Runtime> runtime);

  FrameFeatures process(int64_t stamp_ns, const std::array<const cv::Mat*, 2>& images,
                        const TrackerPrediction& prediction, size_t max_features, TrackerReport* report);
  void takePictures(const std::array<const cv::Mat*, 2>& images, TrackerReport* report);
  void followTracks(const TrackerPrediction& prediction, double dt_s, TrackerReport* report);
  void planSteps(const TrackerPrediction& prediction, double dt_s);
  bool planStep(size_t index, int camera, const TrackerPrediction& prediction);
  void keepConsistent(const TrackerPrediction& prediction, double dt_s, TrackerReport* report);
  void matchKnown();
  void matchUnknown();
  void addCorners(size_t max_features);
  void chooseNew(size_t old_count, size_t max_features, TrackerReport* report);
  void dropUnpaired();
  bool acceptMatch(front_end::Track* track, int from, const front_end::Pixel& pixel);
  bool referenceDue(int64_t stamp_ns) const;
  void renewReference(int64_t stamp_ns);
  void equaliseReference();
  void equalisePair();
  void equalise(const front_end::Pyramid& bright, const front_end::Pyramid& changed, double fallback);
  void forget();

  bool inside(const front_end::Pixel& p, int camera, float border) const
  {
    const CameraModel& model = geometry.camera(camera);
    return p.x >= border && p.y >= border && p.x <= static_cast<float>(model.width) - 1.0F - border &&
           p.y <= static_cast<float>(model.height) - 1.0F - border;
  }
  /// True if a point was found in the picture of `camera`.
  bool found(const front_end::PointBatch& batch, size_t i, int camera) const
  {
    return batch.status[i] != 0 && batch.residual[i] <= static_cast<float>(options.max_residual) &&
           inside(batch.to[i], camera, front_end::BORDER_PX);
  }
  static bool cameBack(const front_end::PointBatch& there, const front_end::PointBatch& again, size_t i,
                       double tolerance_px)
  {
    return again.status[i] != 0 &&
           std::hypot(again.to[i].x - there.from[i].x, again.to[i].y - there.from[i].y) <= tolerance_px;
  }
  /// Makes `back` the way back of `batches`.
  void turnRound()
  {
    for (int c = LEFT; c <= RIGHT; ++c)
    {
      back[c].clear();
      for (size_t i = 0; i < batches[c].size(); ++i)
      {
        back[c].add(batches[c].to[i], batches[c].from[i]);
      }
    }
  }
  std::optional<Eigen::Vector3d> bearingOf(int camera, const front_end::Pixel& p) const
  {
    return geometry.camera(camera).unproject(Eigen::Vector2d(p.x, p.y));
  }
  /// The camera that a feature is matched from.
  static int homeOf(const front_end::Track& track) { return track.seen.seen[LEFT] ? LEFT : RIGHT; }

  const StereoTrackerOptions options;
  const front_end::StereoGeometry geometry;
  front_end::PictureKernels pictures;
  front_end::CurveSearch search;
  front_end::MotionCheck motion_check;

  int64_t next_id = 1;
  std::vector<front_end::Track> tracks;  ///< by increasing id
  bool has_last = false;
  int64_t last_ns = 0;                                             ///< of the last pair that showed something
  Eigen::Quaterniond R_last_now = Eigen::Quaterniond::Identity();  ///< from that pair on
  /// Of the last body's origin in the body frame, as the last two pairs had it [m/s].
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  Eigen::Vector3d p_now_last_camera[2];  ///< expected move of the last camera's place, in the body's axes [m]
  front_end::Pyramid reference[2];       ///< pictures that features are followed from
  bool reference_usable[2] = {false, false};
  int64_t reference_ns = 0;
  size_t reference_tracks = 0;
  int reference_pairs = 0;  ///< since then
  front_end::Pyramid now[2];
  bool usable[2] = {false, false};
  double mean_ratio = 1.0;       ///< brightness of the left picture over that of the right one
  bool threshold_falls = false;  ///< too few corners so far; the next pictures are searched for more
  int fast_threshold[2] = {options.fast_threshold, options.fast_threshold};

  // Kept from call to call for their memory.
  std::vector<front_end::Step> steps;
  front_end::PointBatch batches[2];
  front_end::PointBatch back[2];
  std::vector<pi_runtime::kernels::Corner> corners;
  std::vector<std::pair<front_end::Pixel, front_end::Pixel>> same_places;
  std::vector<uint8_t> out_of_sight;  ///< of each track, for the other camera
};

}  // namespace pi_slam
