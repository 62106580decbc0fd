#pragma once

#include <pi_detect/obstacle_tracker.h>

#include <Eigen/Geometry>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "recording.h"

namespace pi_detect::bench
{

/// A box around something in base_link, found or published.
struct FoundBox
{
  Eigen::Vector3d min;
  Eigen::Vector3d max;
  double distance_m = 0.0;
};

/// What the true depth picture shows, in base_link.
class TruthCloud
{
public:
  TruthCloud(const Pair& pair, const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_body,
             const Eigen::Isometry3d& T_base_left, const StereoObstacleOptions& options, double min_depth_m);

  struct Seen
  {
    const TrueObject* object = nullptr;
    double distance_m = 0.0;                           ///< of its nearest visible point, on the ground
    std::vector<Eigen::Vector3d> points;               ///< visible, between the heights that count
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();  ///< of the box around its points
    Eigen::Vector3d velocity_base;                     ///< over the ground, in the axes of base_link [m/s]
    bool counts = false;  ///< large enough, enough of it in view, no nearer than matching can see
  };
  const std::vector<Seen>& objects() const { return objects_; }

  /// Points of every surface above the ground, as high as a bit more than the vehicle.
  const std::vector<Eigen::Vector3d>& raised() const { return raised_; }

  /// Part of an object's points inside a box (with tolerance).
  static double covered(const Seen& seen, const FoundBox& box);
  /// Whether there is a surface above the ground at the box's place.
  bool isReal(const FoundBox& box) const;

  static constexpr double TILE_M = 0.25;
  /// Middles of the tiles on which bare ground is seen, within FREE_M.
  const std::vector<Eigen::Vector2d>& freeTiles() const { return free_tiles_; }

private:
  std::vector<Seen> objects_;
  std::vector<Eigen::Vector3d> raised_;  ///< every surface above the ground
  std::vector<Eigen::Vector2d> free_tiles_;
};

/// Counts over a recording.
class Score
{
public:
  static constexpr double BAND_M = 5.0;
  static constexpr int BANDS = 3;

  void addMeasured(const TruthCloud& truth, const std::vector<FoundBox>& boxes);
  /// How much of what is seen the published boxes and outlines hold, and how much of the bare ground they cover.
  void addShapes(const TruthCloud& truth, const std::vector<Obstacle>& obstacles);
  void addPublished(const TruthCloud& truth, const std::vector<Obstacle>& obstacles, int64_t stamp_ns);
  void print(const std::string& name, double minutes) const;

  /// Of the last frame, for pictures.
  const std::vector<int>& missed() const { return missed_; }
  const std::set<size_t>& falseBoxes() const { return false_boxes_; }

private:
  struct Band
  {
    int wanted = 0;
    int found = 0;
    std::vector<double> errors;  ///< signed, in parts of the distance
  };
  struct Life
  {
    int frames = 0;
    int false_frames = 0;
    int64_t first_ns = 0;
    Eigen::Vector3d first_position = Eigen::Vector3d::Zero();
    Eigen::Vector3d first_size = Eigen::Vector3d::Zero();
  };
  Band bands_[BANDS];
  std::map<std::string, Band> classes_;
  int boxes_ = 0;
  int false_measured_ = 0;
  std::map<int64_t, Life> lives_;
  std::vector<double> speed_errors_;
  int moving_wanted_ = 0;
  int moving_found_ = 0;
  int standing_ = 0;
  int standing_moving_ = 0;
  struct Shapes
  {
    size_t held = 0;   ///< points of objects
    size_t tiles = 0;  ///< of bare ground
  };
  Shapes of_boxes_;
  Shapes of_outlines_;
  size_t points_ = 0;
  size_t shape_pairs_ = 0;
  std::vector<int> missed_;
  std::set<size_t> false_boxes_;
};

}  // namespace pi_detect::bench
