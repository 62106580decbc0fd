#pragma once

#include "map/map_frame.h"
#include <pi_slam/stereo_calibration.h>

#include <array>
#include <memory>
#include <vector>

#include "front_end/curve_search.h"
#include "front_end/picture_kernels.h"
#include "front_end/stereo_geometry.h"
#include "map/feature_set.h"

namespace pi_slam
{
namespace map
{

/// Corners of a pair with descriptor and distance.
///
/// Descriptors are the binary tests of ORB (Rublee et al. 2011), looked at on the plane that touches the unit sphere
/// where the corner is, upright by gravity: neither a turn of the camera in any direction nor its lens changes them,
/// only where it stands. Distances are the odometry's where it knows them well, else from the other picture.
/// Not thread safe. Deterministic.
class FeatureExtractor
{
public:
  static constexpr int LEVELS = 3;  ///< of the pyramid that corners are taken from

  /// @param features  most of them per pair.
  FeatureExtractor(const StereoCalibration& calibration, int features,
                   std::shared_ptr<pi_runtime::Runtime> runtime = nullptr);
  ~FeatureExtractor();

  /// @param frame  of the calibration's size; without a left picture there are no features, without a right one only
  ///               those that odometry knows.
  std::shared_ptr<FeatureSet> extract(const MapFrame& frame);

private:
  struct Point;
  void takeLandmarks(const MapFrame& frame, std::vector<Point>* points) const;
  void takeCorners(int level, size_t count, std::vector<Point>* points);
  bool orient(const Eigen::Vector3d& g_camera, Point* point) const;
  void measureDistances(const MapFrame& frame, std::vector<Point>* points);
  void blur(int level);
  void describe(const Point& point, uint8_t* descriptor) const;

  const StereoCalibration calibration_;
  const front_end::StereoGeometry geometry_;
  const size_t most_;
  front_end::PictureKernels kernels_;
  front_end::CurveSearch search_;
  std::array<front_end::Pyramid, 2> pyramids_;
  std::vector<pi_runtime::kernels::Corner> corners_;
  std::array<std::vector<uint8_t>, LEVELS> smoothed_;
  front_end::PointBatch there_;
  front_end::PointBatch back_;
};

}  // namespace map
}  // namespace pi_slam
