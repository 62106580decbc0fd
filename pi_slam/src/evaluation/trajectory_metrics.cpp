#include "evaluation/trajectory_metrics.h"

#include <pi_node/durations.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <string>

namespace pi_slam
{

namespace
{

/// Orientations count like points this far off the body in an alignment [m].
constexpr double ORIENTATION_LEVER_M = 0.01;

void check(const std::vector<StampedPose>& poses, const char* name)
{
  if (poses.empty())
  {
    throw TrajectoryError(std::string(name) + ": has no poses, nothing can be compared");
  }
  for (size_t i = 0; i < poses.size(); ++i)
  {
    if (!poses[i].T_world_body.matrix().allFinite())
    {
      throw TrajectoryError(std::string(name) + ": pose " + std::to_string(i) + " at " +
                            formatSeconds(poses[i].stamp_ns) + " s is not finite");
    }
    if (i > 0 && poses[i].stamp_ns <= poses[i - 1].stamp_ns)
    {
      throw TrajectoryError(std::string(name) + ": stamp " + formatSeconds(poses[i].stamp_ns) + " s of pose " +
                            std::to_string(i) + " is not after the one before; sort the poses by time");
    }
  }
}

void check(const std::vector<PosePair>& pairs)
{
  for (const PosePair& pair : pairs)
  {
    if (!pair.T_truth_body.matrix().allFinite() || !pair.T_estimate_body.matrix().allFinite())
    {
      throw TrajectoryError("pair of poses at " + formatSeconds(pair.stamp_ns) + " s is not finite");
    }
  }
}

Eigen::Isometry3d interpolate(const StampedPose& before, const StampedPose& after, int64_t stamp_ns)
{
  const double part =
      static_cast<double>(stamp_ns - before.stamp_ns) / static_cast<double>(after.stamp_ns - before.stamp_ns);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = (1.0 - part) * before.T_world_body.translation() + part * after.T_world_body.translation();
  pose.linear() = Eigen::Quaterniond(before.T_world_body.linear())
                      .slerp(part, Eigen::Quaterniond(after.T_world_body.linear()))
                      .normalized()
                      .toRotationMatrix();
  return pose;
}

double angleOf(const Eigen::Matrix3d& R)
{
  return Eigen::AngleAxisd(R).angle();
}

/// True path up to each pair [m].
std::vector<double> lengths(const std::vector<PosePair>& pairs)
{
  std::vector<double> lengths(pairs.size(), 0.0);
  for (size_t i = 1; i < pairs.size(); ++i)
  {
    lengths[i] =
        lengths[i - 1] + (pairs[i].T_truth_body.translation() - pairs[i - 1].T_truth_body.translation()).norm();
  }
  return lengths;
}

/// Errors over stretches whose ends are `stretch` apart on a scale of increasing `marks`.
/// @param slack  how far beyond the stretch its end may lie.
std::optional<RelativeError> relativeError(const std::vector<PosePair>& pairs, const std::vector<double>& marks,
                                           double stretch, double slack, bool by_distance)
{
  std::vector<double> position;
  std::vector<double> rotation;
  double percent = 0.0;
  size_t end = 0;
  for (size_t begin = 0; begin < pairs.size(); ++begin)
  {
    while (end < pairs.size() && marks[end] - marks[begin] < stretch)
    {
      ++end;
    }
    if (end == pairs.size())
    {
      break;
    }
    const double length = marks[end] - marks[begin];
    if (length > stretch + slack)
    {
      continue;
    }
    const Eigen::Isometry3d truth = pairs[begin].T_truth_body.inverse() * pairs[end].T_truth_body;
    const Eigen::Isometry3d estimate = pairs[begin].T_estimate_body.inverse() * pairs[end].T_estimate_body;
    const Eigen::Isometry3d error = truth.inverse() * estimate;
    position.push_back(error.translation().norm());
    rotation.push_back(angleOf(error.linear()));
    percent += 100.0 * position.back() / length;
  }
  if (position.empty())
  {
    return std::nullopt;
  }
  RelativeError error;
  error.drift_percent = by_distance ? percent / static_cast<double>(position.size()) : 0.0;
  error.position = statisticsOf(std::move(position));
  error.rotation = statisticsOf(std::move(rotation));
  return error;
}

void checkStretch(double stretch, const char* name)
{
  if (!(stretch > 0.0) || !std::isfinite(stretch))
  {
    throw TrajectoryError(std::string(name) + " of a relative error = " + std::to_string(stretch) +
                          ", must be above 0");
  }
}

}  // namespace

std::vector<PosePair> associate(const std::vector<StampedPose>& estimate, const std::vector<StampedPose>& truth,
                                double max_gap_s)
{
  check(estimate, "estimate");
  check(truth, "ground truth");
  if (!(max_gap_s > 0.0))
  {
    throw TrajectoryError("longest gap of the ground truth = " + std::to_string(max_gap_s) + " s, must be above 0");
  }
  std::vector<PosePair> pairs;
  pairs.reserve(estimate.size());
  auto after = truth.begin();
  for (const StampedPose& pose : estimate)
  {
    after =
        std::lower_bound(after, truth.end(), pose.stamp_ns,
                         [](const StampedPose& candidate, int64_t stamp_ns) { return candidate.stamp_ns < stamp_ns; });
    if (after == truth.end())
    {
      break;
    }
    if (after->stamp_ns == pose.stamp_ns)
    {
      pairs.push_back({pose.stamp_ns, after->T_world_body, pose.T_world_body});
    }
    else if (after != truth.begin() &&
             static_cast<double>(after->stamp_ns - std::prev(after)->stamp_ns) <= 1e9 * max_gap_s)
    {
      pairs.push_back({pose.stamp_ns, interpolate(*std::prev(after), *after, pose.stamp_ns), pose.T_world_body});
    }
  }
  return pairs;
}

Eigen::Isometry3d align(const std::vector<PosePair>& pairs, Alignment alignment)
{
  if (pairs.size() < 3)
  {
    throw TrajectoryError(std::to_string(pairs.size()) +
                          " poses of the estimate lie within the ground truth, an alignment needs three or more; "
                          "compare the stamps of both");
  }
  check(pairs);
  Eigen::Vector3d truth_mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d estimate_mean = Eigen::Vector3d::Zero();
  for (const PosePair& pair : pairs)
  {
    truth_mean += pair.T_truth_body.translation();
    estimate_mean += pair.T_estimate_body.translation();
  }
  truth_mean /= static_cast<double>(pairs.size());
  estimate_mean /= static_cast<double>(pairs.size());

  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d turns = Eigen::Matrix3d::Zero();
  for (const PosePair& pair : pairs)
  {
    correlation += (pair.T_truth_body.translation() - truth_mean) *
                   (pair.T_estimate_body.translation() - estimate_mean).transpose();
    turns += pair.T_truth_body.linear() * pair.T_estimate_body.linear().transpose();
  }
  correlation += ORIENTATION_LEVER_M * ORIENTATION_LEVER_M * turns;

  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();
  if (alignment == Alignment::YAW)
  {
    // trace(Rz(yaw)^T correlation) is largest at this angle.
    const double yaw = std::atan2(correlation(1, 0) - correlation(0, 1), correlation(0, 0) + correlation(1, 1));
    T_truth_estimate.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  }
  else
  {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Eigen::Vector3d signs = Eigen::Vector3d::Ones();
    signs.z() = svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0 ? -1.0 : 1.0;
    T_truth_estimate.linear() = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  }
  T_truth_estimate.translation() = truth_mean - T_truth_estimate.linear() * estimate_mean;
  return T_truth_estimate;
}

ErrorStatistics statisticsOf(std::vector<double> values)
{
  if (values.empty())
  {
    throw TrajectoryError("no errors to make statistics of");
  }
  ErrorStatistics statistics;
  statistics.count = values.size();
  double squares = 0.0;
  for (const double value : values)
  {
    if (!std::isfinite(value))
    {
      throw TrajectoryError("an error is not finite");
    }
    statistics.mean += value;
    squares += value * value;
    statistics.max = std::max(statistics.max, value);
  }
  statistics.mean /= static_cast<double>(values.size());
  statistics.rmse = std::sqrt(squares / static_cast<double>(values.size()));
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  statistics.median = *middle;
  if (values.size() % 2 == 0)
  {
    statistics.median = 0.5 * (statistics.median + *std::max_element(values.begin(), middle));
  }
  return statistics;
}

double AbsoluteError::driftPercent() const
{
  return length_m < 0.01 ? 0.0 : 100.0 * position.rmse / length_m;
}

AbsoluteError absoluteError(const std::vector<PosePair>& pairs, Alignment alignment)
{
  AbsoluteError error;
  error.T_truth_estimate = align(pairs, alignment);
  error.length_m = pathLength(pairs);
  error.position_errors.reserve(pairs.size());
  error.rotation_errors.reserve(pairs.size());
  for (const PosePair& pair : pairs)
  {
    const Eigen::Isometry3d aligned = error.T_truth_estimate * pair.T_estimate_body;
    error.position_errors.push_back((aligned.translation() - pair.T_truth_body.translation()).norm());
    error.rotation_errors.push_back(angleOf(aligned.linear().transpose() * pair.T_truth_body.linear()));
  }
  error.position = statisticsOf(error.position_errors);
  error.rotation = statisticsOf(error.rotation_errors);
  return error;
}

std::optional<RelativeError> relativeErrorOverDistance(const std::vector<PosePair>& pairs, double distance_m)
{
  checkStretch(distance_m, "distance");
  check(pairs);
  return relativeError(pairs, lengths(pairs), distance_m, std::max(0.1 * distance_m, 0.05), true);
}

std::optional<RelativeError> relativeErrorOverTime(const std::vector<PosePair>& pairs, double interval_s)
{
  checkStretch(interval_s, "interval");
  check(pairs);
  std::vector<double> seconds;
  seconds.reserve(pairs.size());
  for (const PosePair& pair : pairs)
  {
    seconds.push_back(pi_node::seconds(pair.stamp_ns - pairs.front().stamp_ns));
  }
  // Stamps wander by microseconds: a pose that much early ends its stretch.
  const double early_s = std::min(1e-4, 0.01 * interval_s);
  return relativeError(pairs, seconds, interval_s - early_s, 0.1 * interval_s, false);
}

double pathLength(const std::vector<PosePair>& pairs)
{
  return pairs.empty() ? 0.0 : lengths(pairs).back();
}

std::vector<StampedPose> transformed(const std::vector<StampedPose>& poses, const Eigen::Isometry3d& T_truth_estimate)
{
  std::vector<StampedPose> moved = poses;
  for (StampedPose& pose : moved)
  {
    pose.T_world_body = T_truth_estimate * pose.T_world_body;
  }
  return moved;
}

}  // namespace pi_slam
