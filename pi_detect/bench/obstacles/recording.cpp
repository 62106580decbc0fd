#include "recording.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>

namespace pi_detect::bench
{

namespace
{

namespace fs = std::filesystem;

struct Camera
{
  cv::Size size;
  cv::Matx33d K;
  cv::Vec4d distortion;
  Eigen::Isometry3d T_body_camera;
};

std::vector<double> numbers(const YAML::Node& node)
{
  return node.as<std::vector<double>>();
}

Eigen::Vector3d vector(const YAML::Node& node)
{
  const std::vector<double> values = numbers(node);
  return {values.at(0), values.at(1), values.at(2)};
}

Camera readCamera(const std::string& file)
{
  std::ifstream stream(file);
  std::stringstream text;
  std::string line;
  while (std::getline(stream, line))
  {
    if (line.rfind('%', 0) != 0)  // OpenCV's "%YAML:1.0" is no YAML
    {
      text << line << "\n";
    }
  }
  const YAML::Node yaml = YAML::Load(text.str());
  if (!yaml["intrinsics"] || !yaml["T_BS"])
  {
    throw std::runtime_error(file + ": cannot be read, or has no intrinsics or T_BS");
  }
  Camera camera;
  const std::vector<double> k = numbers(yaml["intrinsics"]);
  const std::vector<double> size = numbers(yaml["resolution"]);
  const std::vector<double> distortion = numbers(yaml["distortion_coefficients"]);
  const std::vector<double> T = numbers(yaml["T_BS"]["data"]);
  camera.size = cv::Size(static_cast<int>(size.at(0)), static_cast<int>(size.at(1)));
  camera.K = {k.at(0), 0.0, k.at(2), 0.0, k.at(1), k.at(3), 0.0, 0.0, 1.0};
  camera.distortion = {distortion.at(0), distortion.at(1), distortion.at(2), distortion.at(3)};
  Eigen::Matrix4d matrix;
  for (size_t i = 0; i < 16; ++i)
  {
    matrix(static_cast<Eigen::Index>(i / 4), static_cast<Eigen::Index>(i % 4)) = T.at(i);
  }
  camera.T_body_camera = Eigen::Isometry3d(matrix);
  return camera;
}

std::vector<std::pair<int64_t, Eigen::Isometry3d>> readPoses(const std::string& file)
{
  std::vector<std::pair<int64_t, Eigen::Isometry3d>> poses;
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line))
  {
    std::istringstream fields(line);
    double t = 0.0;
    Eigen::Vector3d p;
    Eigen::Quaterniond q;
    if (fields >> t >> p.x() >> p.y() >> p.z() >> q.x() >> q.y() >> q.z() >> q.w())
    {
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      T.linear() = q.normalized().toRotationMatrix();
      T.translation() = p;
      poses.emplace_back(std::llround(t * 1e9), T);
    }
  }
  return poses;
}

TrueObject readObject(const YAML::Node& node)
{
  TrueObject object;
  object.id = node["id"].as<int>();
  object.class_name = node["class"].as<std::string>();
  const std::vector<double> box = numbers(node["box"]);
  object.box = {static_cast<float>(box.at(0)), static_cast<float>(box.at(1)), static_cast<float>(box.at(2)),
                static_cast<float>(box.at(3))};
  object.position = vector(node["position"]);
  object.velocity = vector(node["velocity"]);
  object.size = vector(node["size"]);
  object.heading = node["heading"].as<double>();
  return object;
}

cv::Mat readGrey(const fs::path& file)
{
  cv::Mat picture = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
  if (picture.empty())
  {
    throw std::runtime_error(file.string() + ": cannot be read");
  }
  return picture;
}

}  // namespace

Recording::Recording(const std::string& folder) : folder_(folder)
{
  readCalibration();
  for (const auto& entry : fs::directory_iterator(fs::path(folder) / "mav0" / "cam0" / "data"))
  {
    files_.push_back(entry.path().filename().string());
  }
  std::sort(files_.begin(), files_.end());
  for (const std::string& file : files_)
  {
    stamps_.push_back(std::stoll(file));
  }
  has_truth_ = fs::exists(fs::path(folder) / "truth" / "depth") && !rectify_;
  if (has_truth_)
  {
    readTruth();
  }
}

double Recording::seconds() const
{
  return stamps_.size() < 2 ? 0.0 : 1e-9 * static_cast<double>(stamps_.back() - stamps_.front());
}

void Recording::readCalibration()
{
  const fs::path mav = fs::path(folder_) / "mav0";
  const Camera left = readCamera((mav / "cam0" / "sensor.yaml").string());
  const Camera right = readCamera((mav / "cam1" / "sensor.yaml").string());
  const Eigen::Isometry3d T_right_left = right.T_body_camera.inverse() * left.T_body_camera;
  geometry_.width = left.size.width;
  geometry_.height = left.size.height;
  T_body_left_ = left.T_body_camera;
  cv::Matx33d K = left.K;
  geometry_.baseline_m = -T_right_left.translation().x();
  rectify_ = cv::norm(left.distortion) + cv::norm(right.distortion) > 0.0 || cv::norm(left.K - right.K) > 0.0 ||
             (T_right_left.linear() - Eigen::Matrix3d::Identity()).norm() > 1e-6;
  if (rectify_)
  {
    cv::Matx33d R;
    cv::eigen2cv(Eigen::Matrix3d(T_right_left.linear()), R);
    const cv::Vec3d t(T_right_left.translation().x(), T_right_left.translation().y(), T_right_left.translation().z());
    cv::Mat R_left, R_right, P_left, P_right, Q;
    cv::stereoRectify(left.K, left.distortion, right.K, right.distortion, left.size, R, t, R_left, R_right, P_left,
                      P_right, Q, cv::CALIB_ZERO_DISPARITY, 0.0);
    cv::initUndistortRectifyMap(left.K, left.distortion, R_left, P_left, left.size, CV_16SC2, maps_[0], maps_[1]);
    cv::initUndistortRectifyMap(right.K, right.distortion, R_right, P_right, left.size, CV_16SC2, maps_[2], maps_[3]);
    K = cv::Matx33d(cv::Mat(P_left.colRange(0, 3)));
    geometry_.baseline_m = -P_right.at<double>(0, 3) / P_right.at<double>(0, 0);
    Eigen::Matrix3d R_rectified_left;
    cv::cv2eigen(R_left, R_rectified_left);
    T_body_left_.linear() = T_body_left_.linear() * R_rectified_left.transpose();
  }
  geometry_.fx = K(0, 0);
  geometry_.fy = K(1, 1);
  geometry_.cx = K(0, 2);
  geometry_.cy = K(1, 2);
  geometry_.validate();
}

void Recording::readTruth()
{
  poses_ = readPoses(folder_ + "/groundtruth_tum.txt");
  std::map<int64_t, std::vector<TrueObject>> by_stamp;
  const std::string file = folder_ + "/truth/obstacles.json";
  for (const YAML::Node& frame : YAML::LoadFile(file)["frames"])
  {
    std::vector<TrueObject>& objects = by_stamp[frame["stamp_ns"].as<int64_t>()];
    for (const YAML::Node& node : frame["obstacles"])
    {
      objects.push_back(readObject(node));
    }
  }
  for (const int64_t stamp_ns : stamps_)
  {
    objects_.push_back(by_stamp[stamp_ns]);
  }
  if (poses_.empty())
  {
    throw std::runtime_error(folder_ + "/groundtruth_tum.txt: has no poses");
  }
}

Pair Recording::read(size_t index) const
{
  Pair pair;
  pair.stamp_ns = stamps_.at(index);
  const fs::path mav = fs::path(folder_) / "mav0";
  pair.left = readGrey(mav / "cam0" / "data" / files_[index]);
  pair.right = readGrey(mav / "cam1" / "data" / files_[index]);
  if (rectify_)
  {
    cv::remap(pair.left.clone(), pair.left, maps_[0], maps_[1], cv::INTER_LINEAR);
    cv::remap(pair.right.clone(), pair.right, maps_[2], maps_[3], cv::INTER_LINEAR);
  }
  if (has_truth_)
  {
    const fs::path depth_file = fs::path(folder_) / "truth" / "depth" / files_[index];
    const cv::Mat millimetres = cv::imread(depth_file.string(), cv::IMREAD_UNCHANGED);
    if (millimetres.type() != CV_16UC1)
    {
      throw std::runtime_error(depth_file.string() + ": is no 16-bit picture");
    }
    millimetres.convertTo(pair.depth, CV_32F, 1e-3);
    pair.objects = objects_[index];
    const auto after = std::lower_bound(poses_.begin(), poses_.end(), pair.stamp_ns,
                                        [](const auto& pose, int64_t stamp_ns) { return pose.first < stamp_ns; });
    const auto& nearest = after == poses_.end() ? poses_.back() : *after;
    const auto& before = after == poses_.begin() ? nearest : *(after - 1);
    pair.T_world_body = pair.stamp_ns - before.first < nearest.first - pair.stamp_ns ? before.second : nearest.second;
  }
  return pair;
}

}  // namespace pi_detect::bench
