#pragma once

#include <pi_detect/detection.h>

#include <cstdint>
#include <memory>
#include <vector>

namespace pi_detect
{

struct ObjectTrackerOptions
{
  double high_score = 0.6;      ///< detections that may begin a track; those below only continue one
  double low_score = 0.4;       ///< detections below are not looked at
  double min_overlap = 0.2;     ///< of detection and predicted box, both with margin, to continue a track
  double margin = 0.3;          ///< by which boxes grow at each side to be compared, in parts of width and height
  double time_to_live_s = 1.0;  ///< a track that was not seen for longer ends [s]
  int confirm_hits = 3;         ///< detections until a track is published
  double max_gap_s = 2.0;       ///< between pictures, after which all tracks end [s]
  int max_objects = 200;        ///< detections looked at per picture, the best, and tracks at a time

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// An object that is followed.
struct ObjectTrack
{
  int64_t id = 0;  ///< from 1; never used again by this tracker
  int class_id = -1;
  float score = 0.0F;       ///< of the last detection
  Box box;                  ///< estimate for the time of the update; may reach beyond the picture
  float velocity_x = 0.0F;  ///< of the centre [px/s]
  float velocity_y = 0.0F;  ///< likewise
  int64_t first_seen_ns = 0;
  int64_t last_seen_ns = 0;
  int hits = 0;  ///< detections so far
};

/// Follows objects through the pictures of one camera: a Kalman filter with constant velocity per box, assignment of
/// least cost in rounds, first of confident detections, then of weak ones (ByteTrack, Zhang et al. 2022), then to where
/// a lost object was seen last (OC-SORT, Cao et al. 2023). Boxes are compared with a margin, so that small and fast
/// ones find each other (C-BIoU, Yang et al. 2023). A detection that covers an object that was just seen begins none.
/// Not thread safe.
class ObjectTracker
{
public:
  /// @throws std::invalid_argument for options out of range.
  explicit ObjectTracker(const ObjectTrackerOptions& options = ObjectTrackerOptions());
  ~ObjectTracker();
  ObjectTracker(const ObjectTracker&) = delete;
  ObjectTracker& operator=(const ObjectTracker&) = delete;

  /// Takes the detections of one picture; those with boxes that are empty or not finite are left out. Pictures that are
  /// not newer than the last are left out, unless the time goes back by more than max_gap_s: then all begins anew (ids
  /// do not).
  /// @return confirmed tracks, by id; those not seen in this picture are predicted.
  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& detections);

  /// Ends all tracks.
  void clear();

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pi_detect
