#include "ros/obstacles/vehicle_motion.h"
#include <pi_detect/ros/conversions.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>
#include <tf2/exceptions.h>

#include <chrono>

namespace pi_detect
{
namespace
{

using pi_node::format;

/// tf that is further behind is not waited for: it is that of another time, or has ended [s].
constexpr double MAX_BEHIND_S = 1.0;
/// Over which the velocity is taken: longer than the steps of tf, short against manoeuvres [s].
constexpr double VELOCITY_INTERVAL_S = 0.1;

}  // namespace

VehicleMotion::VehicleMotion(const ros::NodeHandle& node, const std::string& odom_frame,
                             const std::string& base_link_frame)
  : odom_frame_(odom_frame)
  , base_link_frame_(base_link_frame)
  , connection_(buffer_._addTransformsChangedListener(
        [this]
        {
          // The lock makes sure that nobody is between the look and the sleep.
          std::unique_lock<std::mutex>(mutex_).unlock();
          changed_.notify_all();
        }))
  , listener_(buffer_, node, true, ros::TransportHints().tcpNoDelay())
{
}

VehicleMotion::~VehicleMotion()
{
  stop();
  buffer_._removeTransformsChangedListener(connection_);
}

void VehicleMotion::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
}

std::optional<Eigen::Isometry3d> VehicleMotion::lookUp(const std::string& parent, const std::string& child,
                                                       const ros::Time& stamp) const
{
  try
  {
    return fromMsg(buffer_.lookupTransform(parent, child, stamp).transform);
  }
  catch (const tf2::TransformException&)
  {
    return std::nullopt;
  }
}

bool VehicleMotion::waitFor(const ros::Time& stamp, int64_t until_ns)
{
  std::unique_lock<std::mutex> lock(mutex_);
  return pi_node::waitUntil(&changed_, &lock, until_ns,
                            [this, &stamp]
                            { return stopping_ || buffer_.canTransform(odom_frame_, base_link_frame_, stamp); }) &&
         !stopping_;
}

std::optional<VehicleState> VehicleMotion::at(const ros::Time& stamp, int64_t until_ns, std::string* problem)
{
  problem->clear();
  const std::string transform = odom_frame_ + " -> " + base_link_frame_;
  ros::Time newest;
  try
  {
    newest = buffer_.lookupTransform(odom_frame_, base_link_frame_, ros::Time(0)).header.stamp;
  }
  catch (const tf2::TransformException&)
  {
    *problem = "tf has no " + transform;
    return std::nullopt;
  }
  const double behind_s = newest.isZero() ? 0.0 : (stamp - newest).toSec();  // 0: a static transform
  if (behind_s > MAX_BEHIND_S)
  {
    *problem = "tf " + transform + format(" is %.2f s behind the pictures", behind_s);
    return std::nullopt;
  }
  ros::Time known = stamp;
  if (behind_s > 0.0 && !waitFor(stamp, until_ns))
  {
    known = newest;
    *problem = "tf " + transform + format(" did not reach a picture's stamp in time, it is %.2f s behind", behind_s);
  }
  const std::optional<Eigen::Isometry3d> T_odom_base = poseAt(known);
  if (!T_odom_base)
  {
    *problem = "tf " + transform + format(" begins %.2f s after a picture's stamp", -behind_s);
    return std::nullopt;
  }
  VehicleState state;
  state.T_odom_base = *T_odom_base;
  const ros::Duration interval(VELOCITY_INTERVAL_S);
  const std::optional<Eigen::Isometry3d> before =
      known.toSec() > VELOCITY_INTERVAL_S ? poseAt(known - interval) : std::nullopt;
  if (before)
  {
    state.velocity =
        T_odom_base->linear().transpose() * (T_odom_base->translation() - before->translation()) / VELOCITY_INTERVAL_S;
  }
  if (known != stamp)
  {
    state.T_odom_base.translate(state.velocity * behind_s);
  }
  return state;
}

}  // namespace pi_detect
