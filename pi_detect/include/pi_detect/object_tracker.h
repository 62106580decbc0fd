#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/picture_motion.h>
#include <pi_detect/picture_view.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace pi_detect
{

struct ObjectTrackerOptions
{
  TrackerScores scores;         ///< of the network
  double min_overlap = 0.2;     ///< of detection and predicted box, both grown by margin, to continue a track
  double margin = 0.3;          ///< growth of boxes at each side before they are compared, in parts of width and height
  double time_to_live_s = 1.0;  ///< a track that was not detected for longer ends [s]
  int confirm_hits = 3;         ///< detections before a track is published
  double max_gap_s = 2.0;       ///< gap between pictures that ends all tracks [s]
  int max_objects = 200;        ///< most detections used per picture (the best ones), and most tracks at a time

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// A tracked object.
struct ObjectTrack
{
  int64_t id = 0;  ///< from 1; never used again by this tracker
  int class_id = -1;
  float score = 0.0F;       ///< of the last detection
  Box box;                  ///< estimate for the time of the update; may reach beyond the picture
  float velocity_x = 0.0F;  ///< of the centre in the picture, own motion of the camera included [px/s]
  float velocity_y = 0.0F;  ///< likewise
  int64_t first_seen_ns = 0;
  int64_t last_seen_ns = 0;
  int hits = 0;  ///< detections so far
};

/// What the tracker may know of a picture beside its detections.
struct TrackerView
{
  PictureMotion motion;                  ///< since the picture of the last update; empty: the camera stood still
  const PictureView* picture = nullptr;  ///< to tell objects apart by their colours; null: places alone decide
};

/// Tracks objects through the pictures of one camera. Each box has a Kalman filter with constant velocity. Detections
/// are assigned at least cost in rounds: first confident ones, then weak ones (ByteTrack, Zhang et al. 2022), then
/// those near the last place of a lost object (OC-SORT, Cao et al. 2023). Boxes are compared with a margin, so that
/// small and fast objects still overlap (C-BIoU, Yang et al. 2023). A detection that covers an object of the same
/// picture begins no track. Not thread safe.
class ObjectTracker
{
public:
  /// @throws std::invalid_argument for options out of range.
  explicit ObjectTracker(const ObjectTrackerOptions& options = ObjectTrackerOptions());
  ~ObjectTracker();
  ObjectTracker(const ObjectTracker&) = delete;
  ObjectTracker& operator=(const ObjectTracker&) = delete;

  /// Takes the detections of one picture; those with empty or infinite boxes are ignored. A picture that is not newer
  /// than the last one is ignored. If time goes back by more than max_gap_s, all tracks end; ids are still not used
  /// again.
  /// @return confirmed tracks, by id; those not detected in this picture are predicted.
  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& detections,
                                  const TrackerView& view = TrackerView());

  /// Ends all tracks, for another network or place. Ids are not used again.
  /// @throws std::invalid_argument for options out of range.
  void restart(const ObjectTrackerOptions& options);

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pi_detect
