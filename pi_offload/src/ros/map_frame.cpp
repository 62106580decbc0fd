#include <pi_detect/ros/conversions.h>
#include "ros/map_frame.h"
#include <tf2/exceptions.h>

namespace pi_offload
{
namespace
{

constexpr std::chrono::seconds PATIENCE(1);  ///< tf needs time to come

std::string withoutSlash(const std::string& frame)
{
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

}  // namespace

MapFrame::MapFrame(const ros::NodeHandle& node, const std::string& map_frame)
  : node_(node), map_frame_(withoutSlash(map_frame))
{
}

std::optional<Eigen::Isometry3d> MapFrame::from(const std::string& given, std::string* problem)
{
  problem->clear();
  const std::string frame = withoutSlash(given);
  if (frame.empty() || frame == map_frame_)
  {
    return Eigen::Isometry3d::Identity();
  }
  std::lock_guard<std::mutex> lock(mutex_);
  if (!listener_)
  {
    listener_ = std::make_unique<tf2_ros::TransformListener>(buffer_, node_, true, ros::TransportHints().tcpNoDelay());
    listening_since_ = Clock::now();
  }
  try
  {
    const Eigen::Isometry3d transform =
        pi_detect::fromMsg(buffer_.lookupTransform(map_frame_, frame, ros::Time(0)).transform);
    said_.erase(frame);
    return transform;
  }
  catch (const tf2::TransformException&)
  {
    if (Clock::now() - listening_since_ > PATIENCE && said_.insert(frame).second)
    {
      *problem = "tf has no " + map_frame_ + " -> " + frame + "; start what publishes it, or set map_frame to " + frame;
    }
    return std::nullopt;
  }
}

}  // namespace pi_offload
