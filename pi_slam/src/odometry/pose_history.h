#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>

namespace pi_slam
{

/// Recent poses by their stamps. Not thread safe.
class PoseHistory
{
public:
  /// @param length_ns   kept behind the newest pose.
  /// @param spacing_ns  at least between two that are kept; the newest is kept in any case.
  PoseHistory(int64_t length_ns, int64_t spacing_ns) : length_ns_(length_ns), spacing_ns_(spacing_ns) {}

  /// Stamps must grow; a pose that is not newer is left out.
  void add(int64_t stamp_ns, const Eigen::Isometry3d& T)
  {
    if (!poses_.empty() && stamp_ns <= poses_.back().first)
    {
      return;
    }
    // The last one goes if both it and this one are near the one before.
    if (poses_.size() >= 2 && stamp_ns - poses_[poses_.size() - 2].first < spacing_ns_)
    {
      poses_.pop_back();
    }
    poses_.emplace_back(stamp_ns, T);
    while (poses_.front().first < stamp_ns - length_ns_)
    {
      poses_.pop_front();
    }
  }

  void clear() { poses_.clear(); }

  /// nullopt: there is none.
  std::optional<std::pair<int64_t, Eigen::Isometry3d>> newest() const
  {
    return poses_.empty() ? std::nullopt : std::make_optional(poses_.back());
  }

  /// Between the two poses around the stamp; nullopt if it is older than the oldest or newer than the newest.
  std::optional<Eigen::Isometry3d> at(int64_t stamp_ns) const;

private:
  const int64_t length_ns_;
  const int64_t spacing_ns_;
  std::deque<std::pair<int64_t, Eigen::Isometry3d>> poses_;
};

}  // namespace pi_slam
