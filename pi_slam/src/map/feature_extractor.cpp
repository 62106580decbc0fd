#include "map/feature_extractor.h"

#include <pi_runtime/kernels/corner_grid.h>
#include <pi_runtime/kernels/gaussian_blur.h>
#include <pi_runtime/kernels/orb.h>

#include <algorithm>
#include <cmath>

namespace pi_slam::map
{

namespace kernels = pi_runtime::kernels;

namespace
{

constexpr int PYRAMID_LEVELS = 3;
constexpr int SEARCH_LEVEL = 1;                                              ///< of the search in the other picture
constexpr double SHARE[FeatureExtractor::LEVELS] = {0.55, 0.30, 0.15};       ///< of features per level
constexpr int CELL_PX[FeatureExtractor::LEVELS] = {40, 32, 24};              ///< of the grid, in pixels of the level
constexpr float DISTANCE_PX[FeatureExtractor::LEVELS] = {9.0F, 7.0F, 6.0F};  ///< between corners
constexpr int THRESHOLD = 14;
constexpr int LOW_THRESHOLD = 6;             ///< in dark or blurred pictures
constexpr double STEREO_DEVIATION_PX = 0.4;  ///< of a shift between both pictures
constexpr double PAIR_EPIPOLAR_PX = 1.2;
constexpr double BACK_PX = 1.0;        ///< farthest from where the search back began
constexpr float MAX_RESIDUAL = 40.0F;  ///< mean difference of patches [grey levels]: cameras differ in brightness
constexpr double NEAREST_M = 0.15;
constexpr double MIN_TILT_SINE = 0.15;  ///< rays closer to the vertical have no upright
constexpr float PATTERN_RADIUS = kernels::ORB_TEST_RADIUS + 0.5F;

}  // namespace

/// A corner on its way to be a feature.
struct FeatureExtractor::Point
{
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();    ///< in the full picture
  Eigen::Vector3d bearing = Eigen::Vector3d::Zero();  ///< in the camera's frame
  int level = 0;
  double inverse_distance = 0.0;
  double inverse_deviation = 0.0;  ///< 0: distance unknown
  /// From the plane that touches the sphere (right, down by gravity; in units of the pattern) to pixels of the level.
  Eigen::Matrix2f pattern = Eigen::Matrix2f::Identity();
};

FeatureExtractor::FeatureExtractor(const StereoCalibration& calibration, int features,
                                   std::shared_ptr<pi_runtime::Runtime> runtime)
  : calibration_(calibration)
  , geometry_(calibration)
  , most_(static_cast<size_t>(features))
  , kernels_(calibration.left.model.width, calibration.left.model.height, PYRAMID_LEVELS, front_end::FlowOptions(),
             std::move(runtime))
  , search_(geometry_, NEAREST_M, SEARCH_LEVEL)
  , pyramids_{kernels_.makePyramid(), kernels_.makePyramid()}
{
}

FeatureExtractor::~FeatureExtractor() = default;

void FeatureExtractor::takeLandmarks(const MapFrame& frame, std::vector<Point>* points) const
{
  const Eigen::Isometry3d T_camera_body = calibration_.left.T_body_camera.inverse();
  const double worst = STEREO_DEVIATION_PX / geometry_.disparityScale();
  const auto most = static_cast<size_t>(0.8 * SHARE[0] * static_cast<double>(most_));
  for (const MapFrame::Landmark& landmark : frame.landmarks)
  {
    if (points->size() >= most)
    {
      return;
    }
    const Eigen::Vector3d p_camera = T_camera_body * landmark.p_body;
    const double distance = p_camera.norm();
    Point point;
    point.pixel = landmark.pixel.cast<double>();
    const bool good = p_camera.allFinite() && landmark.pixel.allFinite() && distance > NEAREST_M &&
                      std::isfinite(landmark.deviation_m) && calibration_.left.model.contains(point.pixel);
    const std::optional<Eigen::Vector3d> bearing = good ? calibration_.left.model.unproject(point.pixel) : std::nullopt;
    if (!bearing)
    {
      continue;
    }
    point.bearing = *bearing;
    point.inverse_distance = 1.0 / distance;
    point.inverse_deviation = std::max(landmark.deviation_m / (distance * distance), 0.1 * worst);
    if (point.inverse_deviation < worst)
    {
      points->push_back(point);
    }
  }
}

void FeatureExtractor::takeCorners(int level, size_t count, std::vector<Point>* points)
{
  const front_end::Picture picture = kernels_.view(pyramids_[LEFT], level);
  const double scale = 1 << level;
  std::vector<kernels::Point2f> taken;
  if (level == 0)
  {
    for (const Point& point : *points)
    {
      taken.push_back({static_cast<float>(point.pixel.x()), static_cast<float>(point.pixel.y())});
    }
  }
  kernels::CornerGrid grid;
  grid.width = picture.width;
  grid.height = picture.height;
  grid.cell = CELL_PX[level];
  grid.min_distance = DISTANCE_PX[level];
  grid.max_points = count + taken.size();
  const int cells = std::max(1, (picture.width / grid.cell) * (picture.height / grid.cell));
  grid.per_cell = std::max(1, static_cast<int>(std::ceil(2.5 * static_cast<double>(count) / cells)));
  for (const int threshold : {THRESHOLD, LOW_THRESHOLD})
  {
    if (level == 0)
    {
      kernels_.findCorners(pyramids_[LEFT], threshold, &corners_);
    }
    else
    {
      corners_.resize(static_cast<size_t>(picture.width) * static_cast<size_t>(picture.height) / 16);
      const size_t found = kernels::findFastCorners(picture, threshold, corners_.data(), corners_.size());
      corners_.resize(std::min(found, corners_.size()));
    }
    if (corners_.size() >= 3 * count)
    {
      break;
    }
  }
  for (const kernels::Corner& corner : kernels::selectGridCorners(corners_.data(), corners_.size(), grid, taken))
  {
    Point point;
    point.pixel = scale * Eigen::Vector2d(corner.x, corner.y);
    point.level = level;
    const std::optional<Eigen::Vector3d> bearing = calibration_.left.model.unproject(point.pixel);
    if (bearing)
    {
      point.bearing = *bearing;
      points->push_back(point);
    }
  }
}

/// Finds where the pattern lies in the picture.
/// @return false where it leaves the picture or has no upright.
bool FeatureExtractor::orient(const Eigen::Vector3d& g_camera, Point* point) const
{
  Eigen::Vector3d down = g_camera - g_camera.dot(point->bearing) * point->bearing;
  if (down.norm() < MIN_TILT_SINE)
  {
    return false;
  }
  down.normalize();
  const Eigen::Vector3d right = down.cross(point->bearing);
  const double unit = static_cast<double>(1 << point->level) / geometry_.focal(LEFT);  // [rad] per pattern unit
  constexpr double STEP = 8.0;                                                         // pattern units
  const CameraModel& camera = calibration_.left.model;
  const auto slope = [&](const Eigen::Vector3d& axis) -> std::optional<Eigen::Vector2d>
  {
    const auto ahead = camera.project(point->bearing + STEP * unit * axis);
    const auto behind = camera.project(point->bearing - STEP * unit * axis);
    return ahead && behind ? std::make_optional<Eigen::Vector2d>((*ahead - *behind) / (2.0 * STEP)) : std::nullopt;
  };
  const auto along_right = slope(right);
  const auto along_down = slope(down);
  if (!along_right || !along_down)
  {
    return false;
  }
  const double scale = 1 << point->level;
  point->pattern.col(0) = (*along_right / scale).cast<float>();
  point->pattern.col(1) = (*along_down / scale).cast<float>();
  const Eigen::Vector2f reach = PATTERN_RADIUS * point->pattern.rowwise().norm();
  const Eigen::Vector2f centre = (point->pixel / scale).cast<float>();
  const front_end::Picture picture = kernels_.view(pyramids_[LEFT], point->level);
  return centre.x() - reach.x() >= 1.0F && centre.y() - reach.y() >= 1.0F &&
         centre.x() + reach.x() <= static_cast<float>(picture.width - 2) &&
         centre.y() + reach.y() <= static_cast<float>(picture.height - 2);
}

void FeatureExtractor::measureDistances(const MapFrame& frame, std::vector<Point>* points)
{
  if (frame.right.empty())
  {
    return;
  }
  const front_end::Picture left = kernels_.view(pyramids_[LEFT], SEARCH_LEVEL);
  const front_end::Picture right = kernels_.view(pyramids_[RIGHT], SEARCH_LEVEL);
  there_.clear();
  std::vector<size_t> index;
  for (size_t i = 0; i < points->size(); ++i)
  {
    const Point& point = (*points)[i];
    if (point.inverse_deviation > 0.0)
    {
      continue;
    }
    const auto& candidates = search_.search(LEFT, left, right, point.pixel, point.bearing);
    if (!candidates.empty())
    {
      there_.add({static_cast<float>(point.pixel.x()), static_cast<float>(point.pixel.y())}, candidates.front().pixel);
      index.push_back(i);
    }
  }
  kernels_.track({{&pyramids_[LEFT], &pyramids_[RIGHT], SEARCH_LEVEL + 1, &there_}});
  back_.clear();
  for (size_t k = 0; k < index.size(); ++k)
  {
    back_.add(there_.to[k], there_.from[k]);
  }
  kernels_.track({{&pyramids_[RIGHT], &pyramids_[LEFT], 1, &back_}});
  for (size_t k = 0; k < index.size(); ++k)
  {
    Point& point = (*points)[index[k]];
    const Eigen::Vector2d there(there_.to[k].x, there_.to[k].y);
    const double back = std::hypot(back_.to[k].x - there_.from[k].x, back_.to[k].y - there_.from[k].y);
    const bool tracked = there_.status[k] != 0 && there_.residual[k] <= MAX_RESIDUAL && back_.status[k] != 0 &&
                         back <= BACK_PX && calibration_.right.model.contains(there);
    const auto bearing = tracked ? calibration_.right.model.unproject(there) : std::nullopt;
    if (!bearing || geometry_.epipolarError(LEFT, point.bearing, *bearing) > PAIR_EPIPOLAR_PX)
    {
      continue;
    }
    const Eigen::Vector3d to_right =
        (calibration_.right.T_body_camera.translation() - calibration_.left.T_body_camera.translation()).normalized();
    const double sine = (calibration_.left.T_body_camera.linear() * point.bearing).cross(to_right).norm();
    const double deviation = STEREO_DEVIATION_PX / (geometry_.disparityScale() * std::max(sine, 0.1));
    const double inverse_distance = geometry_.inverseDistance(LEFT, point.bearing, *bearing);
    if (inverse_distance > -2.0 * deviation && inverse_distance < 1.0 / NEAREST_M)
    {
      point.inverse_distance = std::max(inverse_distance, 0.0);
      point.inverse_deviation = deviation;
    }
  }
}

void FeatureExtractor::blur(int level)
{
  const front_end::Picture source = kernels_.view(pyramids_[LEFT], level);
  std::vector<uint8_t>& target = smoothed_[static_cast<size_t>(level)];
  target.resize(source.stride * static_cast<size_t>(source.height));
  kernels::gaussianBlur7(source, {target.data(), source.width, source.height, source.stride}, 0, source.height);
}

void FeatureExtractor::describe(const Point& point, uint8_t* descriptor) const
{
  const kernels::OrbPattern& tables = kernels::ORB_PATTERN;
  const front_end::Picture picture = kernels_.view(pyramids_[LEFT], point.level);
  const uint8_t* const pixels = smoothed_[static_cast<size_t>(point.level)].data();
  const auto scale = static_cast<float>(1 << point.level);
  const float x0 = static_cast<float>(point.pixel.x()) / scale + 0.5F;
  const float y0 = static_cast<float>(point.pixel.y()) / scale + 0.5F;
  const float xx = point.pattern(0, 0);
  const float xy = point.pattern(0, 1);
  const float yx = point.pattern(1, 0);
  const float yy = point.pattern(1, 1);
  const auto stride = static_cast<int>(picture.stride);
  int offset[2 * kernels::ORB_BITS];
  for (int i = 0; i < 2 * kernels::ORB_BITS; ++i)
  {
    const auto u = static_cast<float>(tables.x[i]);
    const auto v = static_cast<float>(tables.y[i]);
    offset[i] = static_cast<int>(y0 + yx * u + yy * v) * stride + static_cast<int>(x0 + xx * u + xy * v);
  }
  for (int byte = 0; byte < kernels::ORB_BYTES; ++byte)
  {
    unsigned bits = 0;
    for (int bit = 0; bit < 8; ++bit)
    {
      const int i = 8 * byte + bit;
      bits |= static_cast<unsigned>(pixels[offset[i]] < pixels[offset[i + kernels::ORB_BITS]]) << bit;
    }
    descriptor[byte] = static_cast<uint8_t>(bits);
  }
}

std::shared_ptr<FeatureSet> FeatureExtractor::extract(const MapFrame& frame)
{
  auto set = std::make_shared<FeatureSet>();
  set->p_body_camera = calibration_.left.T_body_camera.translation().cast<float>();
  if (frame.left.empty())
  {
    return set;
  }
  kernels_.build({&frame.left, frame.right.empty() ? nullptr : &frame.right}, pyramids_);
  const Eigen::Matrix3d& R_body_camera = calibration_.left.T_body_camera.linear();
  const Eigen::Vector3d g_camera =
      (frame.T_odom_body.linear() * R_body_camera).transpose() * Eigen::Vector3d(0.0, 0.0, -1.0);
  std::vector<Point> points;
  points.reserve(most_);
  takeLandmarks(frame, &points);
  for (int level = 0; level < LEVELS; ++level)
  {
    const auto wanted = static_cast<size_t>(SHARE[level] * static_cast<double>(most_));
    const size_t there = level == 0 ? points.size() : 0;
    takeCorners(level, wanted - std::min(wanted, there), &points);
  }
  points.erase(std::remove_if(points.begin(), points.end(), [&](Point& point) { return !orient(g_camera, &point); }),
               points.end());
  measureDistances(frame, &points);
  points.erase(
      std::remove_if(points.begin(), points.end(), [](const Point& point) { return point.inverse_deviation <= 0.0; }),
      points.end());
  for (int level = 0; level < LEVELS; ++level)
  {
    blur(level);
  }
  set->features.resize(points.size());
  set->descriptors.resize(points.size() * DESCRIPTOR_BYTES);
  for (size_t i = 0; i < points.size(); ++i)
  {
    const Point& point = points[i];
    MapFeature& feature = set->features[i];
    feature.bearing = (R_body_camera * point.bearing).cast<float>();
    feature.inverse_distance = static_cast<float>(point.inverse_distance);
    feature.inverse_deviation = static_cast<float>(point.inverse_deviation);
    feature.grey = frame.left.at<uint8_t>(static_cast<int>(point.pixel.y()), static_cast<int>(point.pixel.x()));
    feature.level = static_cast<uint8_t>(point.level);
    describe(point, set->descriptors.data() + i * DESCRIPTOR_BYTES);
  }
  return set;
}

}  // namespace pi_slam::map
