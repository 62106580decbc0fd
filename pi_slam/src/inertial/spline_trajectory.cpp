#include <pi_node/durations.h>
#include <pi_slam/spline_trajectory.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_slam
{

namespace
{

constexpr int MAX_ITERATIONS = 200;
constexpr double CONVERGED = 1e-6;  ///< largest change of a control point in one iteration [m or rad]

/// Basis functions of the uniform cubic B-spline at u in [0, 1).
std::array<double, 4> basis(double u)
{
  const double v = 1.0 - u;
  return {v * v * v / 6.0, (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0, (1.0 + 3.0 * u * (1.0 + u * v)) / 6.0,
          u * u * u / 6.0};
}

std::array<double, 4> basisSlope(double u)
{
  const double v = 1.0 - u;
  return {-0.5 * v * v, 1.5 * u * u - 2.0 * u, 0.5 + u - 1.5 * u * u, 0.5 * u * u};
}

std::array<double, 4> basisCurvature(double u)
{
  return {1.0 - u, 3.0 * u - 2.0, 1.0 - 3.0 * u, u};
}

/// Cumulative basis lambda_j = sum of the basis functions from j on; lambda_0 is constant.
std::array<double, 3> cumulative(const std::array<double, 4>& b)
{
  return {b[1] + b[2] + b[3], b[2] + b[3], b[3]};
}

/// Segment of a spline at a time, and the place in it.
struct Place
{
  Place(double time_s, double interval_s, size_t controls)
    : segment(std::min(static_cast<size_t>(time_s / interval_s), controls - 4))
    , u(time_s / interval_s - static_cast<double>(segment))
  {
  }
  size_t segment;
  double u;  ///< in [0, 1)
};

/// Sum of the residuals that pull at a control point.
struct Pull
{
  void add(double w, const Eigen::Vector3d& residual)
  {
    sum += w * residual;
    weight += w;
  }
  Eigen::Vector3d mean() const { return weight > 1e-6 ? Eigen::Vector3d(sum / weight) : Eigen::Vector3d::Zero(); }

  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weight = 0.0;
};

/// Pose of the input at a time between two samples, to start the iteration with.
Eigen::Isometry3d interpolate(const std::vector<StampedPose>& poses, int64_t stamp_ns)
{
  const auto after = std::upper_bound(poses.begin(), poses.end(), stamp_ns,
                                      [](int64_t stamp, const StampedPose& pose) { return stamp < pose.stamp_ns; });
  if (after == poses.begin())
  {
    return poses.front().T_world_body;
  }
  if (after == poses.end())
  {
    return poses.back().T_world_body;
  }
  const StampedPose& a = *(after - 1);
  const StampedPose& b = *after;
  const double s = static_cast<double>(stamp_ns - a.stamp_ns) / static_cast<double>(b.stamp_ns - a.stamp_ns);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(a.T_world_body.linear())
                      .slerp(s, Eigen::Quaterniond(b.T_world_body.linear()))
                      .toRotationMatrix();
  pose.translation() = (1.0 - s) * a.T_world_body.translation() + s * b.T_world_body.translation();
  return pose;
}

double defaultInterval(const std::vector<StampedPose>& poses, double shortest)
{
  std::vector<double> intervals;
  for (size_t i = 1; i < poses.size(); ++i)
  {
    intervals.push_back(pi_node::seconds(poses[i].stamp_ns - poses[i - 1].stamp_ns));
  }
  std::nth_element(intervals.begin(), intervals.begin() + static_cast<long>(intervals.size() / 2), intervals.end());
  const double sample = intervals[intervals.size() / 2];
  return std::min(10.0, std::max(sample, std::clamp(4.0 * sample, shortest, 0.1)));
}

}  // namespace

SplineTrajectory SplineTrajectory::fit(const std::vector<StampedPose>& poses, double knot_interval_s)
{
  if (poses.size() < 2)
  {
    throw std::invalid_argument("trajectory: " + std::to_string(poses.size()) + " poses, needs two or more");
  }
  for (size_t i = 1; i < poses.size(); ++i)
  {
    if (poses[i].stamp_ns <= poses[i - 1].stamp_ns)
    {
      throw std::invalid_argument("trajectory: stamp of pose " + std::to_string(i) + " is not after the one before");
    }
  }
  const double interval = knot_interval_s == 0.0 ? defaultInterval(poses, 0.05) : knot_interval_s;
  if (!(interval >= 0.001 && interval <= 10.0))
  {
    throw std::invalid_argument("trajectory: knot interval = " + std::to_string(interval) +
                                ", must be in [0.001, 10] s");
  }
  SplineTrajectory spline;
  spline.start_ns_ = poses.front().stamp_ns;
  spline.end_ns_ = poses.back().stamp_ns;
  spline.knot_interval_s_ = interval;
  spline.turn_interval_s_ = knot_interval_s == 0.0 ? defaultInterval(poses, 0.02) : knot_interval_s;
  const double duration_s = pi_node::seconds(spline.end_ns_ - spline.start_ns_);
  // Control point i has most of its weight at the start of segment i - 1.
  const auto firstGuess = [&](size_t i, double knots_s)
  { return interpolate(poses, spline.start_ns_ + std::llround((static_cast<double>(i) - 1.0) * knots_s * 1e9)); };
  for (size_t i = 0; i < static_cast<size_t>(duration_s / spline.knot_interval_s_) + 4; ++i)
  {
    spline.positions_.push_back(firstGuess(i, spline.knot_interval_s_).translation());
  }
  for (size_t i = 0; i < static_cast<size_t>(duration_s / spline.turn_interval_s_) + 4; ++i)
  {
    spline.rotations_.emplace_back(firstGuess(i, spline.turn_interval_s_).linear());
  }
  spline.updateTurns();
  for (int i = 0; i < MAX_ITERATIONS && spline.refine(poses) > CONVERGED; ++i)
  {
  }
  return spline;
}

/// One step of LSPIA: every control point moves by the mean residual of the poses that it influences, weighted by its
/// basis function there. Rotations do the same with residuals in world coordinates.
/// @return the largest change.
double SplineTrajectory::refine(const std::vector<StampedPose>& poses)
{
  std::vector<Pull> shifts(positions_.size());
  std::vector<Pull> turns(rotations_.size());
  for (const StampedPose& pose : poses)
  {
    const double time_s = pi_node::seconds(pose.stamp_ns - start_ns_);
    const State state = evaluate(time_s);
    const Eigen::Vector3d shift = pose.T_world_body.translation() - state.T_world_body.translation();
    const Eigen::Vector3d turn = logSo3(
        Eigen::Quaterniond(Eigen::Matrix3d(pose.T_world_body.linear() * state.T_world_body.linear().transpose())));
    const Place at_position(time_s, knot_interval_s_, positions_.size());
    const Place at_rotation(time_s, turn_interval_s_, rotations_.size());
    for (size_t j = 0; j < 4; ++j)
    {
      shifts[at_position.segment + j].add(basis(at_position.u)[j], shift);
      turns[at_rotation.segment + j].add(basis(at_rotation.u)[j], turn);
    }
  }
  double largest = 0.0;
  for (size_t i = 0; i < positions_.size(); ++i)
  {
    positions_[i] += shifts[i].mean();
    largest = std::max(largest, shifts[i].mean().norm());
  }
  for (size_t i = 0; i < rotations_.size(); ++i)
  {
    rotations_[i] = (expSo3(turns[i].mean()) * rotations_[i]).normalized();
    largest = std::max(largest, turns[i].mean().norm());
  }
  updateTurns();
  return largest;
}

void SplineTrajectory::updateTurns()
{
  turns_.resize(rotations_.size() - 1);
  for (size_t i = 0; i < turns_.size(); ++i)
  {
    turns_[i] = logSo3(rotations_[i].conjugate() * rotations_[i + 1]);
  }
}

SplineTrajectory::State SplineTrajectory::at(int64_t stamp_ns) const
{
  if (stamp_ns < start_ns_ || stamp_ns > end_ns_)
  {
    throw std::out_of_range("trajectory: time " + std::to_string(stamp_ns) + " ns is outside of [" +
                            std::to_string(start_ns_) + ", " + std::to_string(end_ns_) + "]");
  }
  return evaluate(pi_node::seconds(stamp_ns - start_ns_));
}

SplineTrajectory::State SplineTrajectory::atSeconds(double time_s) const
{
  const double duration_s = pi_node::seconds(end_ns_ - start_ns_);
  if (!(time_s >= 0.0 && time_s <= duration_s))
  {
    throw std::out_of_range("trajectory: time " + std::to_string(time_s) + " s is outside of [0, " +
                            std::to_string(duration_s) + "]");
  }
  return evaluate(time_s);
}

SplineTrajectory::State SplineTrajectory::evaluate(double time_s) const
{
  const Place place(time_s, knot_interval_s_, positions_.size());
  const double rate = 1.0 / knot_interval_s_;  // du / dt
  const std::array<double, 4> b = basis(place.u);
  const std::array<double, 4> b1 = basisSlope(place.u);
  const std::array<double, 4> b2 = basisCurvature(place.u);

  State state;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  for (size_t j = 0; j < 4; ++j)
  {
    position += b[j] * positions_[place.segment + j];
    state.v_world += rate * b1[j] * positions_[place.segment + j];
    state.a_world += rate * rate * b2[j] * positions_[place.segment + j];
  }

  // Sommer et al. 2020: R = R_0 A_1 A_2 A_3 with A_j = exp(lambda_j d_j); rate and its derivative by their recursions.
  const Place turn(time_s, turn_interval_s_, rotations_.size());
  const double turn_rate = 1.0 / turn_interval_s_;
  const std::array<double, 3> l = cumulative(basis(turn.u));
  const std::array<double, 3> l1 = cumulative(basisSlope(turn.u));
  const std::array<double, 3> l2 = cumulative(basisCurvature(turn.u));
  Eigen::Quaterniond rotation = rotations_[turn.segment];
  for (size_t j = 0; j < 3; ++j)
  {
    const Eigen::Vector3d& d = turns_[turn.segment + j];
    const Eigen::Quaterniond A = expSo3(l[j] * d);
    rotation = rotation * A;
    state.w_body = A.conjugate() * state.w_body + turn_rate * l1[j] * d;
    state.alpha_body = A.conjugate() * state.alpha_body + turn_rate * l1[j] * state.w_body.cross(d) +
                       turn_rate * turn_rate * l2[j] * d;
  }
  state.T_world_body.linear() = rotation.normalized().toRotationMatrix();
  state.T_world_body.translation() = position;
  return state;
}

}  // namespace pi_slam
