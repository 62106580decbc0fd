#include "ros/navigation/navigation_inputs.h"

#include "ros/decision_conversions.h"
#include "ros/navigation/navigation_conversions.h"

#include <pi_node/formatting.h>
#include <tf2/exceptions.h>

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace pi_vehicle
{

using pi_node::format;

namespace
{

constexpr double NO_ORIENTATION = 1e-9;  // a quaternion with a smaller norm is no orientation

}  // namespace

NavigationInputs::NavigationInputs(ros::NodeHandle node, const NavigationRosOptions& options)
  : options_(options), tf_listener_(tf_buffer_, node, false, ros::TransportHints().tcpNoDelay())
{
  const auto newest = [&node](const std::string& topic, auto* message)
  {
    using Message = std::remove_const_t<typename std::remove_pointer_t<decltype(message)>::element_type>;
    return node.subscribe<Message>(
        topic, 1, [message](const boost::shared_ptr<const Message>& came) { *message = came; }, ros::VoidConstPtr(),
        ros::TransportHints().tcpNoDelay());
  };
  odometry_subscriber_ = newest("odometry", &odometry_);
  map_pose_subscriber_ = newest("map_pose", &map_pose_);
  localisation_subscriber_ = newest("localisation", &localisation_);
  vehicle_subscriber_ = node.subscribe<VehicleState>(
      "vehicle_state", 1,
      [this](const VehicleStateConstPtr& message)
      {
        vehicle_ = message;
        vehicle_came_ = ros::Time::now();
      },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
}

std::optional<Eigen::Isometry3d> NavigationInputs::mapFrom(const std::string& given, bool may_be_old,
                                                           std::string* problem) const
{
  const std::string frame = withoutSlash(given);
  if (frame == options_.map_frame)
  {
    return Eigen::Isometry3d::Identity();
  }
  try
  {
    const geometry_msgs::TransformStamped transform =
        tf_buffer_.lookupTransform(options_.map_frame, frame, ros::Time(0));
    const double age_s = transform.header.stamp.isZero() ? 0.0 : (ros::Time::now() - transform.header.stamp).toSec();
    if (may_be_old || age_s <= options_.tf_timeout_s)
    {
      return toIsometry(transform.transform);
    }
    *problem = "tf " + options_.map_frame + " -> " + frame +
               " is older than tf_timeout_s = " + format("%g", options_.tf_timeout_s) +
               " s; does the localisation run?";
  }
  catch (const tf2::TransformException&)
  {
    *problem = "tf has no " + options_.map_frame + " -> " + frame +
               (may_be_old ? "; give the goal in a frame that tf knows" : "; does the localisation run?");
  }
  return std::nullopt;
}

NavigatorInput NavigationInputs::at(const ros::Time& now) const
{
  NavigatorInput input;
  input.now_ns = toNs(now);
  if (vehicle_)
  {
    input.vehicle_ns = std::max<int64_t>(1, toNs(vehicle_came_));
    input.speed = vehicle_->speed;
    input.curvature = vehicle_->curvature;
    input.vehicle_problem = vehicleProblem(*vehicle_);
  }
  if (localisation_ && !localisation_->valid)
  {
    input.pose_problem = "localisation is not valid: " + localisation_->reason;
  }
  else if (!odometry_)
  {
    input.pose_problem = "nothing came on " + odometry_subscriber_.getTopic() + " yet; does the localisation run?";
  }
  else
  {
    addPose(&input);
  }
  return input;
}

void NavigationInputs::addPose(NavigatorInput* input) const
{
  const nav_msgs::Odometry& odometry = *odometry_;
  const geometry_msgs::Quaternion& q = odometry.pose.pose.orientation;
  if (!odometry.child_frame_id.empty() && withoutSlash(odometry.child_frame_id) != options_.base_link_frame)
  {
    input->pose_problem = "odometry is of frame " + odometry.child_frame_id + ", must be of " +
                          options_.base_link_frame + " (base_link_frame)";
  }
  else if (std::hypot(std::hypot(q.x, q.y), std::hypot(q.z, q.w)) < NO_ORIENTATION)
  {
    input->pose_problem = "odometry has no orientation: its quaternion is 0";
  }
  else if (const auto T_map_odom = mapFrom(odometry.header.frame_id, false, &input->pose_problem))
  {
    input->pose = toPose2(*T_map_odom * toIsometry(odometry.pose.pose));
    input->pose_stamp_ns = toNs(odometry.header.stamp);
    input->position_deviation = positionDeviation(odometry.pose);
    // The deviation of odometry grows from the start; the map also counts the places that were recognised since.
    if (map_pose_ && std::abs((odometry.header.stamp - map_pose_->header.stamp).toSec()) <= options_.tf_timeout_s)
    {
      const double in_map = positionDeviation(map_pose_->pose);
      const bool better = in_map > 0.0 && (input->position_deviation == 0.0 || in_map < input->position_deviation);
      input->position_deviation = better ? in_map : input->position_deviation;
    }
  }
}

}  // namespace pi_vehicle
