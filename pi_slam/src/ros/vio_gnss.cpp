#include "ros/vio_gnss.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <string>

#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

constexpr uint32_t QUEUE = 50;
constexpr double UNKNOWN_DEVIATION_M = 5.0;  ///< of a receiver that tells none
constexpr double LEAST_DEVIATION_M = 0.02;   ///< of any receiver

double deviationOf(double variance)
{
  return std::isfinite(variance) && variance > 0.0 ? std::max(LEAST_DEVIATION_M, std::sqrt(variance))
                                                   : UNKNOWN_DEVIATION_M;
}

GnssFix toFix(const sensor_msgs::NavSatFix& message)
{
  GnssFix fix;
  fix.stamp_ns = fromMsg(message.header.stamp);
  fix.antenna = {message.latitude, message.longitude, message.altitude};
  const bool known = message.position_covariance_type != sensor_msgs::NavSatFix::COVARIANCE_TYPE_UNKNOWN;
  const auto& variances = message.position_covariance;
  fix.deviation = deviationOf(known ? std::max(variances[0], variances[4]) : 0.0);
  fix.up_deviation = known ? deviationOf(variances[8]) : 2.0 * UNKNOWN_DEVIATION_M;
  return fix;
}

}  // namespace

VioGnss::VioGnss(const VioRosOptions& options, ros::NodeHandle node, VioSession* session, pi_node::InputTopic* topic,
                 pi_node::WarningBoard* warnings)
  : options_(options), session_(*session), topic_(*topic), warnings_(*warnings)
{
  if (!options_.gnss_topic.empty())
  {
    topic_.topic = node.resolveName(options_.gnss_topic);
    fixes_ = node.subscribe<sensor_msgs::NavSatFix>(
        options_.gnss_topic, QUEUE, [this](const sensor_msgs::NavSatFixConstPtr& message) { onFix(*message); });
  }
}

void VioGnss::onFix(const sensor_msgs::NavSatFix& message)
{
  topic_.note();
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (!pipeline || !pipeline->mapper)
  {
    return;
  }
  if (message.status.status < sensor_msgs::NavSatStatus::STATUS_FIX)
  {
    warnings_.warn(topic_.topic + ": the receiver has no fix; the antenna needs a view of the sky");
    return;
  }
  if (message.header.stamp.isZero())
  {
    warnings_.error(topic_.topic + ": stamp is 0, fix ignored; the driver must stamp its messages");
    return;
  }
  GnssFix fix = toFix(message);
  const std::vector<double>& antenna = options_.gnss_antenna;
  fix.p_body_antenna = pipeline->T_base_body.inverse() * Eigen::Vector3d(antenna[0], antenna[1], antenna[2]);
  try
  {
    pipeline->mapper->addFix(fix);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topic_.topic + ": " + error.what() + "; left out");
  }
}

}  // namespace pi_slam
