#pragma once

#include "evaluation/sequence_reader.h"
#include "inertial/wheels.h"

#include <memory>
#include <string>
#include <vector>

namespace pi_slam
{

/// Topics of a bag; an empty one is found by its name: left/image_raw, cam0/image_raw, ..., imu/data, imu0, in any
/// namespace.
struct BagTopics
{
  std::string left;   ///< sensor_msgs/Image or CompressedImage
  std::string right;  ///< likewise
  std::string imu;    ///< sensor_msgs/Imu
};

/// Opens a recording of rosbag. Items come in order of the stamps in their headers: the three streams may lag behind
/// each other by up to a second. What is out of order within its own stream, or lags more, is left out and counted. A
/// bag has no calibration that says where the cameras sit on the IMU.
/// @throws RecordingError for a file that is no bag, or topics that are missing, ambiguous or of another type;
///         std::invalid_argument for options out of range.
std::unique_ptr<SequenceSource> openBag(const std::string& file, const BagTopics& topics = {},
                                        const SequenceReaderOptions& options = {});

/// All samples of the wheels: a topic of nav_msgs/Odometry or geometry_msgs/TwistStamped.
/// @throws RecordingError for a file that is no bag, or without such a topic.
std::vector<WheelSample> readBagWheels(const std::string& file, const std::string& topic);

}  // namespace pi_slam
