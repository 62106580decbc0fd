#include "vehicle/motion_window.h"

namespace pi_simulation
{
namespace
{

constexpr double REACH_S = 1e-9 * static_cast<double>(MotionWindow::REACH * MotionWindow::PERIOD_NS);

}  // namespace

void MotionWindow::add(int64_t stamp_ns, const Eigen::Isometry3d& T_world_base)
{
  if (!poses_.empty() && stamp_ns != stamp_ns_ + PERIOD_NS)
  {
    poses_.clear();
  }
  poses_.push_back(T_world_base);
  stamp_ns_ = stamp_ns;
  if (poses_.size() > 2 * REACH + 1)
  {
    poses_.pop_front();
  }
}

Eigen::Vector3d MotionWindow::velocity() const
{
  return pose().linear().transpose() * (poses_.back().translation() - poses_.front().translation()) / (2.0 * REACH_S);
}

Eigen::Vector3d MotionWindow::angularRate() const
{
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(poses_.front().linear().transpose() * poses_.back().linear()));
  return turn.axis() * (turn.angle() / (2.0 * REACH_S));
}

pi_slam::ImuSample MotionWindow::imu(const Eigen::Isometry3d& T_base_imu, double gravity) const
{
  const Eigen::Vector3d before = poses_.front() * T_base_imu.translation();
  const Eigen::Vector3d at = pose() * T_base_imu.translation();
  const Eigen::Vector3d after = poses_.back() * T_base_imu.translation();
  const Eigen::Vector3d a = (after - 2.0 * at + before) / (REACH_S * REACH_S);
  const Eigen::Matrix3d R_imu_world = (pose().linear() * T_base_imu.linear()).transpose();
  pi_slam::ImuSample sample;
  sample.stamp_ns = stampNs();
  sample.w = T_base_imu.linear().transpose() * angularRate();
  sample.f = R_imu_world * (a + Eigen::Vector3d(0.0, 0.0, gravity));
  return sample;
}

}  // namespace pi_simulation
