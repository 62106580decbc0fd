#include "estimator/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace pi_slam::estimator
{

namespace
{

/// Rays whose directions differ by less have no intersection: a third of a pixel at a usual focal length.
constexpr double MIN_PARALLAX_RAD = 7e-4;
constexpr double MIN_DISTANCE_M = 0.1;
constexpr double MAX_DISTANCE_M = 500.0;
constexpr int ITERATIONS = 4;

}  // namespace

bool triangulate(const WindowProblem& problem, double max_error, Landmark* landmark)
{
  landmark->known = false;
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d a = Eigen::Vector3d::Zero();
  Eigen::Vector3d first_ray = Eigen::Vector3d::Zero();
  double parallax = 0.0;
  for (const View& view : landmark->views)
  {
    const BodyPose body = problem.bodyPose(view);
    const CameraGeometry& camera = problem.cameras[view.camera];
    const Eigen::Vector3d ray = body.R_odom_body * (camera.R_camera_body.transpose() * view.bearing);
    const Eigen::Vector3d origin =
        body.p_odom_body - body.R_odom_body * (camera.R_camera_body.transpose() * camera.p_camera_body);
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    A += across;
    a += across * origin;
    if (first_ray.isZero())
    {
      first_ray = ray;
    }
    parallax = std::max(parallax, first_ray.cross(ray).norm());
  }
  if (parallax < MIN_PARALLAX_RAD)
  {
    return false;
  }
  Eigen::Vector3d p = A.ldlt().solve(a);
  Eigen::Matrix3d H;
  double mean_error = 0.0;
  Eigen::Matrix<double, 2, 3> J;
  for (int iteration = 0; iteration <= ITERATIONS; ++iteration)
  {
    H.setZero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    mean_error = 0.0;
    for (const View& view : landmark->views)
    {
      const BodyPose body = problem.bodyPose(view);
      const Eigen::Vector2d error = reprojectionError(body.R_odom_body, body.p_odom_body, problem.cameras[view.camera],
                                                      view.bearing, view.tangent, p, nullptr, &J);
      double weight = 1.0;
      huberCost(error.squaredNorm(), problem.huber, &weight);
      H += weight * J.transpose() * J;
      b += weight * J.transpose() * error;
      mean_error += error.norm();
    }
    mean_error /= static_cast<double>(landmark->views.size());
    if (iteration == ITERATIONS)
    {
      break;
    }
    H.diagonal() *= 1.0 + 1e-6;
    p -= H.ldlt().solve(b);
    if (!p.allFinite())
    {
      return false;
    }
  }
  if (!(mean_error < max_error))
  {
    return false;
  }
  for (const View& view : landmark->views)
  {
    const BodyPose body = problem.bodyPose(view);
    const CameraGeometry& camera = problem.cameras[view.camera];
    const Eigen::Vector3d p_camera =
        camera.R_camera_body * (body.R_odom_body.transpose() * (p - body.p_odom_body)) + camera.p_camera_body;
    const double along = p_camera.dot(view.bearing);
    if (along < MIN_DISTANCE_M || along > MAX_DISTANCE_M)
    {
      return false;
    }
  }
  H.diagonal().array() += 1e-9;
  landmark->estimate.p_odom = p;
  landmark->estimate.covariance = H.inverse();
  landmark->known = true;
  return true;
}

}  // namespace pi_slam::estimator
