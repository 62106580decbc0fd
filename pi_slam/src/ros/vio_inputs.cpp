#include "ros/vio_inputs.h"

#include <geometry_msgs/TwistStamped.h>
#include <nav_msgs/Odometry.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>

#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "ros/conversions.h"

namespace pi_slam
{
namespace
{

using pi_node::format;
using pi_node::seconds;
using pi_node::sizeText;

namespace zero_copy = pi_os_transport::zero_copy;

std::string timeWentBack(const std::string& topic, int64_t by_ns)
{
  return topic + ": time went back by " + format("%.3f", seconds(by_ns)) +
         " s (a recording that began anew?): odometry begins anew";
}

}  // namespace

VioInputs::VioInputs(const VioRosOptions& options, ros::NodeHandle imu_node, ros::NodeHandle input_node,
                     VioTopics* topics, VioSession* session, VioCalibrator* calibrator, VioOutputs* outputs,
                     pi_node::WarningBoard* warnings, VioDiagnostics* diagnostics)
  : options_(options)
  , topics_(*topics)
  , session_(*session)
  , calibrator_(*calibrator)
  , outputs_(*outputs)
  , warnings_(*warnings)
  , diagnostics_(*diagnostics)
{
  const auto hints = ros::TransportHints().tcpNoDelay();
  const auto queue_size = static_cast<uint32_t>(options.queue_size);
  topics->imu.topic = imu_node.resolveName("imu/data");
  for (const int camera : {LEFT, RIGHT})
  {
    const std::string side = camera == LEFT ? "left" : "right";
    topics->pictures[camera].topic = input_node.resolveName(side + "/image_raw");
    topics->infos[camera].topic = input_node.resolveName(side + "/camera_info");
  }
  subscribers_.push_back(
      imu_node.subscribe("imu/data", static_cast<uint32_t>(options.imu_queue_size), &VioInputs::onImu, this, hints));
  if (!options.wheel_topic.empty())
  {
    topics->wheels.topic = imu_node.resolveName(options.wheel_topic);
    subscribers_.push_back(imu_node.subscribe(options.wheel_topic, static_cast<uint32_t>(options.imu_queue_size),
                                              &VioInputs::onWheels, this, hints));
  }
  for (const int camera : {LEFT, RIGHT})
  {
    const std::string side = camera == LEFT ? "left" : "right";
    subscribers_.push_back(zero_copy::subscribeImages(
        input_node, side + "/image_raw", queue_size, options.zero_copy,
        [this, camera](const zero_copy::ImageHandle& message) { onImage(camera, message); }, hints));
    if (options.calibration.source == CalibrationSource::CAMERA_INFO)
    {
      const auto on_info = [this, camera](const sensor_msgs::CameraInfoConstPtr& info)
      {
        topics_.infos[camera].note();
        calibrator_.setCameraInfo(camera, info);
      };
      subscribers_.push_back(input_node.subscribe<sensor_msgs::CameraInfo>(side + "/camera_info", queue_size, on_info,
                                                                           ros::VoidConstPtr(), hints));
    }
  }
}

void VioInputs::onImu(const sensor_msgs::ImuConstPtr& message)
{
  const auto begin = std::chrono::steady_clock::now();
  topics_.imu.note();
  ImuSample sample;
  try
  {
    sample = fromMsg(*message);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topics_.imu.topic + ": " + error.what());
    return;
  }
  if (sample.stamp_ns == 0)
  {
    warnings_.error(topics_.imu.topic + ": stamp is 0, sample ignored; the driver must stamp its messages");
    return;
  }
  watchImuTime(sample.stamp_ns);
  const VioPipeline::Ptr pipeline = session_.pipeline();
  calibrator_.setImuFrame(message->header.frame_id);
  if (!pipeline)
  {
    outputs_.imuWorkedOff(sample.stamp_ns);
    return;
  }
  const std::optional<PropagatedState> propagated = pipeline->vio->addImu(sample);
  session_.imuArrived();
  const std::string warning = pipeline->vio->imuMessage();
  if (!warning.empty())
  {
    warnings_.warn(warning);
  }
  if (propagated)
  {
    outputs_.publishOdometry(*pipeline, *propagated);
    diagnostics_.addImu(1e3 * pi_node::secondsSince(begin));
  }
  outputs_.imuWorkedOff(sample.stamp_ns);
}

void VioInputs::onWheels(const topic_tools::ShapeShifter::ConstPtr& message)
{
  topics_.wheels.note();
  const std::string& topic = topics_.wheels.topic;
  const std::string& type = message->getDataType();
  WheelSample sample;
  std::string frame;
  if (type == "nav_msgs/Odometry")
  {
    const nav_msgs::OdometryConstPtr odometry = message->instantiate<nav_msgs::Odometry>();
    sample = toWheelSample(odometry->header.stamp, odometry->twist.twist);
    frame = odometry->child_frame_id;
  }
  else if (type == "geometry_msgs/TwistStamped")
  {
    const geometry_msgs::TwistStampedConstPtr twist = message->instantiate<geometry_msgs::TwistStamped>();
    sample = toWheelSample(twist->header.stamp, twist->twist);
    frame = twist->header.frame_id;
  }
  else
  {
    warnings_.error(topic + ": is " + type +
                    ", must be nav_msgs/Odometry or geometry_msgs/TwistStamped; set wheel_topic, or leave it empty");
    return;
  }
  if (sample.stamp_ns == 0 || !sample.isFinite())
  {
    warnings_.error(topic + ": " + (sample.stamp_ns == 0 ? "stamp is 0" : "a number is not finite") +
                    ", sample ignored; check the chassis driver");
  }
  else if (!frame.empty() && frame != options_.base_link_frame)
  {
    warnings_.error(topic + ": its twist is of the frame " + frame + ", must be of base_link_frame = " +
                    options_.base_link_frame + ", the wheels are not used; set the frame in the chassis driver");
  }
  else if (const VioPipeline::Ptr pipeline = session_.pipeline())
  {
    pipeline->vio->addWheels(sample);
  }
}

void VioInputs::watchImuTime(int64_t stamp_ns)
{
  const int64_t last_ns = session_.last_imu_ns;
  if (last_ns - stamp_ns > std::llround(1e9 * options_.time_jump_s))
  {
    session_.restart(timeWentBack(topics_.imu.topic, last_ns - stamp_ns), false);
    session_.last_imu_ns = stamp_ns;
  }
  else if (stamp_ns > last_ns)
  {
    session_.last_imu_ns = stamp_ns;
  }
}

void VioInputs::onImage(int camera, const zero_copy::ImageHandle& message)
{
  const std::string& topic = topics_.pictures[camera].topic;
  topics_.pictures[camera].note();
  const int64_t stamp_ns = fromMsg(message->header.stamp);
  if (stamp_ns == 0)
  {
    warnings_.error(topic + ": stamp is 0, picture ignored; the driver must stamp its messages");
    return;
  }
  watchPictureTime(camera, stamp_ns);
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (!pipeline)
  {
    outputs_.pairWorkedOff(stamp_ns);
    return;
  }
  cv::Mat picture;
  try
  {
    picture = read(camera, message, *pipeline);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topic + ": " + error.what());
    outputs_.pairWorkedOff(stamp_ns);
    return;
  }
  const std::optional<double> mismatch_s =
      session_.addPicture(pipeline, camera, stamp_ns, picture, message->header.frame_id);
  if (mismatch_s)
  {
    warnings_.warn(topics_.pictures[LEFT].topic + " and " + topics_.pictures[RIGHT].topic + ": stamps differ by " +
                   format("%.4f", *mismatch_s) +
                   " s, above pair_tolerance_s = " + format("%.4f", options_.pair_tolerance_s) +
                   "; trigger the cameras together, or raise the tolerance");
  }
}

void VioInputs::watchPictureTime(int camera, int64_t stamp_ns)
{
  const int64_t jump_ns = std::llround(1e9 * options_.time_jump_s);
  const int64_t last_ns = last_picture_ns_[camera];
  if (last_ns - stamp_ns > jump_ns)
  {
    if (last_ns - session_.last_imu_ns > jump_ns)
    {
      session_.clearPairs();  // the IMU has gone back before, and odometry with it
    }
    else
    {
      session_.restart(timeWentBack(topics_.pictures[camera].topic, last_ns - stamp_ns), false);
    }
    last_picture_ns_[LEFT] = last_picture_ns_[RIGHT] = stamp_ns;
  }
  else if (stamp_ns > last_ns)
  {
    last_picture_ns_[camera] = stamp_ns;
  }
}

cv::Mat VioInputs::read(int camera, const zero_copy::ImageHandle& message, const VioPipeline& pipeline) const
{
  cv::Mat picture;
  try
  {
    picture = fromMsg(message);
  }
  catch (const std::invalid_argument& error)
  {
    throw std::invalid_argument(std::string(error.what()) + "; picture ignored");
  }
  const CameraModel& model = (camera == LEFT ? pipeline.cameras.left : pipeline.cameras.right).model;
  if (picture.cols != model.width || picture.rows != model.height)
  {
    const CalibrationSource source = options_.calibration.source;
    throw std::invalid_argument(
        "picture is " + sizeText(picture.cols, picture.rows) + ", but " +
        (source == CalibrationSource::CAMERA_INFO ? topics_.infos[camera].topic
                                                  : std::string("calibration/") + toString(source)) +
        " is for " + sizeText(model.width, model.height) + "; picture ignored until they agree");
  }
  return picture;
}

}  // namespace pi_slam
