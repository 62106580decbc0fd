#pragma once

#include <Eigen/Core>
#include <vector>

namespace pi_simulation
{

enum class PathShape
{
  CAMPUS_LOOP,   ///< around a block, 75 m x 45 m, counterclockwise
  HALL_LOOP,     ///< around the aisles of a hall, 22 m x 12 m
  STRAIGHT,      ///< along x
  FIGURE_EIGHT,  ///< lemniscate, 44 m long
};

bool isClosed(PathShape shape);

/// A shape as a function of the distance driven [m].
class PathLine
{
public:
  static constexpr double STEP_M = 0.05;  ///< between its points

  explicit PathLine(PathShape shape);
  Eigen::Vector2d at(double s) const;
  /// Of a closed shape [m]; STRAIGHT: 0.
  double length() const { return step_m_ * static_cast<double>(points_.size()); }

private:
  std::vector<Eigen::Vector2d> points_;  ///< empty: straight
  double step_m_ = STEP_M;
};

/// The line that a drive follows, every 0.25 m or so: one round of a closed shape, `length_m` of STRAIGHT.
std::vector<Eigen::Vector2d> pathLine(PathShape shape, double length_m);

}  // namespace pi_simulation
