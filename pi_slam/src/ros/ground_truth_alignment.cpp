#include "ros/ground_truth_alignment.h"

#include <pi_node/durations.h>
#include <tf2/exceptions.h>
#include "ros/conversions.h"

#include <cmath>
#include <cstdlib>
#include <stdexcept>

namespace pi_slam
{
namespace
{

constexpr int64_t MAX_DIFFERENCE_NS = 5000000;  ///< between the stamps of a pair
constexpr int64_t KEPT_NS = 1000000000;         ///< of ground truth
constexpr int64_t PUBLISH_PERIOD_NS = 500000000;

}  // namespace

void HeadingAlignment::add(const Eigen::Isometry3d& T_a_base, const Eigen::Isometry3d& T_b_base)
{
  // Of all turns about z the one nearest to R_a_b.
  const Eigen::Matrix3d R_a_b = T_a_base.linear() * T_b_base.linear().transpose();
  sum_sine_ += R_a_b(1, 0) - R_a_b(0, 1);
  sum_cosine_ += R_a_b(0, 0) + R_a_b(1, 1);
  sum_p_a_ += T_a_base.translation();
  sum_p_b_ += T_b_base.translation();
  ++count_;
}

Eigen::Isometry3d HeadingAlignment::T_a_b() const
{
  Eigen::Isometry3d T_a_b = Eigen::Isometry3d::Identity();
  if (count_ > 0)
  {
    T_a_b.linear() = Eigen::AngleAxisd(std::atan2(sum_sine_, sum_cosine_), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T_a_b.translation() = (sum_p_a_ - T_a_b.linear() * sum_p_b_) / static_cast<double>(count_);
  }
  return T_a_b;
}

GroundTruthAlignmentRos::GroundTruthAlignmentRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : tf_listener_(tf_buffer_, node)
{
  private_node.param("window_s", window_s_, window_s_);
  private_node.param("map_frame", map_frame_, map_frame_);
  if (!(window_s_ > 0.0 && window_s_ <= 3600.0))
  {
    throw std::invalid_argument("parameter " + private_node.resolveName("window_s") + " = " +
                                std::to_string(window_s_) + ", must be in (0, 3600]");
  }
  const auto hints = ros::TransportHints().tcpNoDelay();
  truth_subscriber_ = node.subscribe("ground_truth/odometry", 200, &GroundTruthAlignmentRos::onTruth, this, hints);
  odometry_subscriber_ = node.subscribe("odometry", 200, &GroundTruthAlignmentRos::onOdometry, this, hints);
}

void GroundTruthAlignmentRos::onTruth(const nav_msgs::OdometryConstPtr& truth)
{
  const int64_t stamp_ns = fromMsg(truth->header.stamp);
  if (!truths_.empty() && stamp_ns <= fromMsg(truths_.back()->header.stamp))
  {
    truths_.clear();  // a recording that began anew
  }
  truths_.push_back(truth);
  while (stamp_ns - fromMsg(truths_.front()->header.stamp) > KEPT_NS)
  {
    truths_.pop_front();
  }
}

void GroundTruthAlignmentRos::onOdometry(const nav_msgs::OdometryConstPtr& odometry)
{
  const int64_t stamp_ns = fromMsg(odometry->header.stamp);
  if (stamp_ns < last_ns_)
  {
    // Odometry was restarted, at another place.
    alignment_.clear();
    first_ns_ = 0;
    published_ns_ = 0;
  }
  last_ns_ = stamp_ns;
  if (first_ns_ != 0 && pi_node::seconds(stamp_ns - first_ns_) > window_s_)
  {
    return;
  }
  const nav_msgs::Odometry* nearest = nullptr;
  int64_t least_ns = MAX_DIFFERENCE_NS;
  for (const nav_msgs::OdometryConstPtr& truth : truths_)
  {
    const int64_t difference_ns = std::abs(fromMsg(truth->header.stamp) - stamp_ns);
    if (difference_ns <= least_ns)
    {
      least_ns = difference_ns;
      nearest = truth.get();
    }
  }
  if (nearest == nullptr)
  {
    return;
  }
  Eigen::Isometry3d T_map_odom;
  try
  {
    T_map_odom = fromMsg(tf_buffer_.lookupTransform(map_frame_, odometry->header.frame_id, ros::Time(0)).transform);
  }
  catch (const tf2::TransformException&)
  {
    return;  // not there yet
  }
  alignment_.add(T_map_odom * fromMsg(odometry->pose.pose), fromMsg(nearest->pose.pose));
  first_ns_ = first_ns_ == 0 ? stamp_ns : first_ns_;
  if (stamp_ns - published_ns_ >= PUBLISH_PERIOD_NS)
  {
    published_ns_ = stamp_ns;
    tf_broadcaster_.sendTransform(
        toTransform(alignment_.T_a_b(), odometry->header.stamp, map_frame_, nearest->header.frame_id));
  }
}

}  // namespace pi_slam
