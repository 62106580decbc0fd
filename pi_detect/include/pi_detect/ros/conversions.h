#pragma once

#include <geometry_msgs/Transform.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_detect/Track2DArray.h>
#include <pi_detect/detection.h>
#include <pi_detect/model_description.h>
#include <pi_detect/object_tracker.h>
#include <pi_detect/obstacle_tracker.h>
#include <pi_detect/stereo_obstacles.h>
#include <pi_node/ros/time.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_msgs/Header.h>
#include <stereo_msgs/DisparityImage.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace pi_detect
{

/// Class id to name.
using Labels = std::map<int, std::string>;

using pi_node::fromMsg;  // of stamps

Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& transform);

BoundingBox2D toMsg(const Box& box);
Box fromMsg(const BoundingBox2D& box);

/// Each detection gets one result. @param header  of the picture.
Detection2DArrayPtr toMsg(const Detections& detections, const std_msgs::Header& header);
/// Takes the best result of each detection; detections without result are left out.
Detections fromMsg(const Detection2DArray& message);

/// @param header  of the picture; ages are counted up to its stamp.
Track2DArrayPtr toMsg(const std::vector<ObjectTrack>& tracks, const Labels& labels, const std_msgs::Header& header);
/// The number of hits is not in the message: 0.
std::vector<ObjectTrack> fromMsg(const Track2DArray& message);

/// @param header  with the stamp of the pair and base_link's name; ages are counted up to its stamp.
ObstacleArrayPtr toMsg(const std::vector<Obstacle>& obstacles, const Labels& labels, const std_msgs::Header& header);
std::vector<Obstacle> fromMsg(const ObstacleArray& message);

LabelArray toMsg(const ModelDescription& model);
/// @throws std::invalid_argument if there are not as many names as ids.
Labels fromMsg(const LabelArray& message);
/// The default where the message has none.
TrackerScores scoresOf(const LabelArray& message);

/// Fields x, y, z, float32.
sensor_msgs::PointCloud2Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header);

/// @param disparity  as StereoObstacles::disparity() returns it.
/// @param min_depth_m  from which on depths are measured; 0: unknown [m].
stereo_msgs::DisparityImagePtr toDisparityImage(const cv::Mat& disparity, const StereoGeometry& geometry,
                                                double min_depth_m, const std_msgs::Header& header);
/// CV_32FC1 [px], unknown pixels -1. @throws std::invalid_argument for an inconsistent message.
cv::Mat fromMsg(const stereo_msgs::DisparityImage& message);

/// @param picture  CV_8UC1 or CV_8UC3 (BGR).
sensor_msgs::ImagePtr toImage(const cv::Mat& picture, const std_msgs::Header& header);

}  // namespace pi_detect
