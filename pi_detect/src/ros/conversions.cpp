#include <cv_bridge/cv_bridge.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/formatting.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstring>
#include <stdexcept>

namespace pi_detect
{
namespace
{

using pi_node::format;
using pi_node::sizeText;

namespace encodings = sensor_msgs::image_encodings;

ros::Duration durationOf(int64_t ns)
{
  ros::Duration duration;
  duration.fromNSec(std::max<int64_t>(0, ns));
  return duration;
}

std::string labelOf(int class_id, const Labels& labels)
{
  const auto label = labels.find(class_id);
  return label == labels.end() ? "" : label->second;
}

geometry_msgs::Point toPoint(const Eigen::Vector3d& vector)
{
  geometry_msgs::Point point;
  point.x = vector.x();
  point.y = vector.y();
  point.z = vector.z();
  return point;
}

geometry_msgs::Vector3 toVector(const Eigen::Vector3d& vector)
{
  geometry_msgs::Vector3 message;
  message.x = vector.x();
  message.y = vector.y();
  message.z = vector.z();
  return message;
}

template <typename Message>
Eigen::Vector3d fromVector(const Message& message)
{
  return Eigen::Vector3d(message.x, message.y, message.z);
}

using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

}  // namespace

Eigen::Isometry3d fromMsg(const geometry_msgs::Transform& message)
{
  Eigen::Isometry3d transform = Eigen::Isometry3d::Identity();
  transform.translation() = fromVector(message.translation);
  transform.linear() =
      Eigen::Quaterniond(message.rotation.w, message.rotation.x, message.rotation.y, message.rotation.z)
          .normalized()
          .toRotationMatrix();
  return transform;
}

BoundingBox2D toMsg(const Box& box)
{
  BoundingBox2D message;
  message.center.x = 0.5 * (static_cast<double>(box.x1) + box.x2);
  message.center.y = 0.5 * (static_cast<double>(box.y1) + box.y2);
  message.size_x = static_cast<double>(box.x2) - box.x1;
  message.size_y = static_cast<double>(box.y2) - box.y1;
  return message;
}

Box fromMsg(const BoundingBox2D& box)
{
  return {static_cast<float>(box.center.x - 0.5 * box.size_x), static_cast<float>(box.center.y - 0.5 * box.size_y),
          static_cast<float>(box.center.x + 0.5 * box.size_x), static_cast<float>(box.center.y + 0.5 * box.size_y)};
}

Detection2DArrayPtr toMsg(const Detections& detections, const std_msgs::Header& header)
{
  const auto message = boost::make_shared<Detection2DArray>();
  message->header = header;
  message->detections.resize(detections.size());
  for (size_t i = 0; i < detections.size(); ++i)
  {
    Detection2D& detection = message->detections[i];
    detection.header = header;
    detection.results.resize(1);
    detection.results[0].id = detections[i].class_id;
    detection.results[0].score = detections[i].score;
    detection.bbox = toMsg(detections[i].box);
  }
  return message;
}

Detections fromMsg(const Detection2DArray& message)
{
  Detections detections;
  for (const Detection2D& detection : message.detections)
  {
    const auto best = std::max_element(detection.results.begin(), detection.results.end(),
                                       [](const ObjectHypothesisWithPose& a, const ObjectHypothesisWithPose& b)
                                       { return a.score < b.score; });
    if (best != detection.results.end())
    {
      detections.push_back({static_cast<int>(best->id), static_cast<float>(best->score), fromMsg(detection.bbox)});
    }
  }
  return detections;
}

Track2DArrayPtr toMsg(const std::vector<ObjectTrack>& tracks, const Labels& labels, const std_msgs::Header& header)
{
  const int64_t stamp_ns = fromMsg(header.stamp);
  const auto message = boost::make_shared<Track2DArray>();
  message->header = header;
  message->tracks.resize(tracks.size());
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    Track2D& track = message->tracks[i];
    track.id = tracks[i].id;
    track.class_id = tracks[i].class_id;
    track.label = labelOf(tracks[i].class_id, labels);
    track.score = tracks[i].score;
    track.bbox = toMsg(tracks[i].box);
    track.velocity_x = tracks[i].velocity_x;
    track.velocity_y = tracks[i].velocity_y;
    track.age = durationOf(stamp_ns - tracks[i].first_seen_ns);
    track.since_seen = durationOf(stamp_ns - tracks[i].last_seen_ns);
  }
  return message;
}

std::vector<ObjectTrack> fromMsg(const Track2DArray& message)
{
  const int64_t stamp_ns = fromMsg(message.header.stamp);
  std::vector<ObjectTrack> tracks(message.tracks.size());
  for (size_t i = 0; i < tracks.size(); ++i)
  {
    const Track2D& track = message.tracks[i];
    tracks[i].id = track.id;
    tracks[i].class_id = static_cast<int>(track.class_id);
    tracks[i].score = static_cast<float>(track.score);
    tracks[i].box = fromMsg(track.bbox);
    tracks[i].velocity_x = static_cast<float>(track.velocity_x);
    tracks[i].velocity_y = static_cast<float>(track.velocity_y);
    tracks[i].first_seen_ns = stamp_ns - track.age.toNSec();
    tracks[i].last_seen_ns = stamp_ns - track.since_seen.toNSec();
  }
  return tracks;
}

ObstacleArrayPtr toMsg(const std::vector<Obstacle>& obstacles, const Labels& labels, const std_msgs::Header& header)
{
  const int64_t stamp_ns = fromMsg(header.stamp);
  const auto message = boost::make_shared<ObstacleArray>();
  message->header = header;
  message->obstacles.resize(obstacles.size());
  for (size_t i = 0; i < obstacles.size(); ++i)
  {
    const Obstacle& from = obstacles[i];
    auto& to = message->obstacles[i];
    to.id = from.id;
    to.label = labelOf(from.class_id, labels);
    to.class_id = from.class_id;
    to.score = from.score;
    to.track_id = from.track_id;
    to.position = toPoint(from.position);
    to.size = toVector(from.size);
    for (const Eigen::Vector2d& corner : from.outline)
    {
      geometry_msgs::Point32 point;
      point.x = static_cast<float>(corner.x());
      point.y = static_cast<float>(corner.y());
      point.z = static_cast<float>(from.position.z() - 0.5 * from.size.z());
      to.outline.push_back(point);
    }
    Eigen::Map<RowMajor3d>(to.position_covariance.data()) = from.position_covariance;
    to.velocity = toVector(from.velocity);
    Eigen::Map<RowMajor3d>(to.velocity_covariance.data()) = from.velocity_covariance;
    to.moving = from.moving;
    to.distance = from.distance_m;
    to.time_to_collision = from.time_to_collision_s;
    to.age = durationOf(stamp_ns - from.first_seen_ns);
    to.since_seen = durationOf(stamp_ns - from.last_seen_ns);
  }
  return message;
}

std::vector<Obstacle> fromMsg(const ObstacleArray& message)
{
  const int64_t stamp_ns = fromMsg(message.header.stamp);
  std::vector<Obstacle> obstacles(message.obstacles.size());
  for (size_t i = 0; i < obstacles.size(); ++i)
  {
    const auto& from = message.obstacles[i];
    Obstacle& to = obstacles[i];
    to.id = from.id;
    to.class_id = static_cast<int>(from.class_id);
    to.score = static_cast<float>(from.score);
    to.track_id = from.track_id;
    to.position = fromVector(from.position);
    to.size = fromVector(from.size);
    for (const geometry_msgs::Point32& corner : from.outline)
    {
      to.outline.emplace_back(corner.x, corner.y);
    }
    to.position_covariance = Eigen::Map<const RowMajor3d>(from.position_covariance.data());
    to.velocity = fromVector(from.velocity);
    to.velocity_covariance = Eigen::Map<const RowMajor3d>(from.velocity_covariance.data());
    to.moving = from.moving != 0;
    to.distance_m = from.distance;
    to.time_to_collision_s = from.time_to_collision;
    to.first_seen_ns = stamp_ns - from.age.toNSec();
    to.last_seen_ns = stamp_ns - from.since_seen.toNSec();
  }
  return obstacles;
}

LabelArray toMsg(const ModelDescription& model)
{
  LabelArray message;
  message.model = model.name;
  message.high_score = model.tracker.high;
  message.low_score = model.tracker.low;
  for (const auto& [id, name] : model.labels)
  {
    message.ids.push_back(id);
    message.names.push_back(name);
  }
  return message;
}

Labels fromMsg(const LabelArray& message)
{
  if (message.ids.size() != message.names.size())
  {
    throw std::invalid_argument("ids has " + std::to_string(message.ids.size()) + " entries, names " +
                                std::to_string(message.names.size()) + ", must have as many");
  }
  Labels labels;
  for (size_t i = 0; i < message.ids.size(); ++i)
  {
    labels[static_cast<int>(message.ids[i])] = message.names[i];
  }
  return labels;
}

TrackerScores scoresOf(const LabelArray& message)
{
  TrackerScores scores;
  if (message.high_score > 0.0 && message.low_score > 0.0)
  {
    scores.high = std::min(message.high_score, 1.0);
    scores.low = std::min(message.low_score, scores.high);
  }
  return scores;
}

sensor_msgs::PointCloud2Ptr toPointCloud(const std::vector<Eigen::Vector3f>& points, const std_msgs::Header& header)
{
  static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float), "points are copied as they lie");
  const auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  cloud->is_dense = true;
  constexpr int FLOAT = sensor_msgs::PointField::FLOAT32;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2Fields(3, "x", 1, FLOAT, "y", 1, FLOAT, "z", 1, FLOAT);
  modifier.resize(points.size());
  if (!points.empty())
  {
    std::memcpy(cloud->data.data(), points.data(), cloud->data.size());
  }
  return cloud;
}

stereo_msgs::DisparityImagePtr toDisparityImage(const cv::Mat& disparity, const StereoGeometry& geometry,
                                                double min_depth_m, const std_msgs::Header& header)
{
  const auto message = boost::make_shared<stereo_msgs::DisparityImage>();
  message->header = header;
  message->f = static_cast<float>(geometry.fx);
  message->T = static_cast<float>(geometry.baseline_m);
  message->min_disparity = 0.0F;
  message->max_disparity =
      static_cast<float>(min_depth_m > 0.0 ? geometry.fx * geometry.baseline_m / min_depth_m : 0.0);
  message->delta_d = 1.0F / 16.0F;
  message->valid_window.width = static_cast<uint32_t>(disparity.cols);
  message->valid_window.height = static_cast<uint32_t>(disparity.rows);
  sensor_msgs::Image& image = message->image;
  image.header = header;
  image.width = static_cast<uint32_t>(disparity.cols);
  image.height = static_cast<uint32_t>(disparity.rows);
  image.encoding = encodings::TYPE_32FC1;
  image.step = static_cast<uint32_t>(sizeof(float)) * image.width;
  image.data.resize(static_cast<size_t>(image.step) * image.height);
  disparity.copyTo(cv::Mat(disparity.rows, disparity.cols, CV_32FC1, image.data.data(), image.step));
  return message;
}

cv::Mat fromMsg(const stereo_msgs::DisparityImage& message)
{
  const sensor_msgs::Image& image = message.image;
  if (image.encoding != encodings::TYPE_32FC1 || image.is_bigendian != 0)
  {
    throw std::invalid_argument("encoding \"" + image.encoding + "\"" +
                                (image.is_bigendian != 0 ? ", big-endian" : "") + ", must be 32FC1, little-endian");
  }
  if (image.width == 0 || image.height == 0 || image.step < sizeof(float) * image.width ||
      static_cast<size_t>(image.step) * image.height > image.data.size())
  {
    throw std::invalid_argument("size " + sizeText(image.width, image.height) + " with step " +
                                std::to_string(image.step) + " does not fit its " + std::to_string(image.data.size()) +
                                " bytes");
  }
  if (!(message.f > 0.0F) || !(message.T > 0.0F))
  {
    throw std::invalid_argument("f = " + format("%g", message.f) + " and T = " + format("%g", message.T) +
                                ", must be a focal length [px] and a baseline [m], above 0");
  }
  cv::Mat disparity(static_cast<int>(image.height), static_cast<int>(image.width), CV_32FC1);
  for (int y = 0; y < disparity.rows; ++y)
  {
    std::memcpy(disparity.ptr(y), image.data.data() + static_cast<size_t>(y) * image.step, sizeof(float) * image.width);
    float* row = disparity.ptr<float>(y);
    // What is below the smallest one, as matchers mark what they do not know, and what is no number.
    std::replace_if(
        row, row + disparity.cols, [&message](float value) { return !(value >= message.min_disparity); }, -1.0F);
  }
  return disparity;
}

sensor_msgs::ImagePtr toImage(const cv::Mat& picture, const std_msgs::Header& header)
{
  return cv_bridge::CvImage(header, picture.channels() == 3 ? encodings::BGR8 : encodings::MONO8, picture).toImageMsg();
}

}  // namespace pi_detect
