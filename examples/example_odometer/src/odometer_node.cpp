// The distance that the vehicle has driven, from the poses of localisation.

#include <nav_msgs/Odometry.h>
#include <pi_node/ros/node_main.h>
#include <ros/ros.h>
#include <std_msgs/Float64.h>

#include <cmath>
#include <optional>

namespace
{

constexpr double STEP_M = 0.05;  // shorter ones are noise of the pose

class OdometerRos
{
public:
  OdometerRos(ros::NodeHandle node, const ros::NodeHandle& /*private_node*/)
    : distance_(node.advertise<std_msgs::Float64>("distance", 1, true))
    , odometry_(node.subscribe("odometry", 10, &OdometerRos::onOdometry, this))
  {
  }

private:
  void onOdometry(const nav_msgs::OdometryConstPtr& odometry)
  {
    const geometry_msgs::Point& here = odometry->pose.pose.position;
    const double step = last_ ? std::hypot(here.x - last_->x, here.y - last_->y) : 0.0;
    if (last_ && step < STEP_M)
    {
      return;
    }
    last_ = here;
    driven_.data += step;
    distance_.publish(driven_);
  }

  std_msgs::Float64 driven_;  // [m]
  std::optional<geometry_msgs::Point> last_;
  ros::Publisher distance_;
  ros::Subscriber odometry_;
};

}  // namespace

int main(int argc, char** argv)
{
  return pi_node::runNode<OdometerRos>(argc, argv, "odometer");
}
