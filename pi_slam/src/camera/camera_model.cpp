#include <pi_slam/camera_model.h>

#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_slam
{

namespace
{

using Coefficients = decltype(CameraModel::coefficients);

/// (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3) of s = r^2.
struct Radial
{
  double value;
  double slope;  ///< by s
};

Radial radialOf(const Coefficients& k, double s)
{
  const double above = 1.0 + s * (k[0] + s * (k[1] + s * k[4]));
  const double above_slope = k[0] + s * (2.0 * k[1] + s * 3.0 * k[4]);
  if (k[5] == 0.0 && k[6] == 0.0 && k[7] == 0.0)
  {
    return {above, above_slope};
  }
  const double below = 1.0 + s * (k[5] + s * (k[6] + s * k[7]));
  const double below_slope = k[5] + s * (2.0 * k[6] + s * 3.0 * k[7]);
  return {above / below, (above_slope * below - above * below_slope) / (below * below)};
}

/// Distorted point of normalised coordinates and its derivative by them.
struct RadtanPoint
{
  Eigen::Vector2d value;
  Eigen::Matrix2d jacobian;
};

RadtanPoint distortRadtan(const Coefficients& k, const Eigen::Vector2d& m)
{
  const double x = m.x();
  const double y = m.y();
  const double r2 = x * x + y * y;
  const Radial along = radialOf(k, r2);
  const double radial = along.value;
  const double slope = 2.0 * along.slope;  // d radial / dx = slope x
  RadtanPoint point;
  point.value = {x * radial + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
                 y * radial + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y};
  const double cross = slope * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
  point.jacobian << radial + slope * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x, cross,  //
      cross, radial + slope * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
  return point;
}

/// True up to the radius at which r radial(r^2) turns back: beyond it, pixels have two directions.
bool isBeforeFold(const Coefficients& k, double r2)
{
  if (k[4] != 0.0 || k[5] != 0.0 || k[6] != 0.0 || k[7] != 0.0)
  {
    // No closed form; lenses are smooth, so a few places on the way tell.
    constexpr int PLACES = 8;
    for (int i = 1; i <= PLACES; ++i)
    {
      const double s = r2 * i / PLACES;
      const Radial radial = radialOf(k, s);
      if (!(radial.value > 0.0 && radial.value + 2.0 * s * radial.slope > 0.0))
      {
        return false;
      }
    }
    return true;
  }
  // Smallest positive root s = r^2 of 1 + 3 k1 s + 5 k2 s^2.
  const double a = 5.0 * k[1];
  const double b = 3.0 * k[0];
  double fold = -1.0;
  if (std::abs(a) < 1e-12)
  {
    fold = b < 0.0 ? -1.0 / b : -1.0;
  }
  else if (b * b - 4.0 * a >= 0.0)
  {
    const double root = std::sqrt(b * b - 4.0 * a);
    const double low = std::min((-b - root) / (2.0 * a), (-b + root) / (2.0 * a));
    const double high = std::max((-b - root) / (2.0 * a), (-b + root) / (2.0 * a));
    fold = low > 0.0 ? low : high;
  }
  return fold <= 0.0 || r2 < fold;
}

struct Angle
{
  double value;
  double slope;  ///< by theta
};

Angle distortEquidistant(const Coefficients& k, double theta)
{
  const double s = theta * theta;
  return {theta * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))),
          1.0 + s * (3.0 * k[0] + s * (5.0 * k[1] + s * (7.0 * k[2] + s * 9.0 * k[3])))};
}

std::optional<Eigen::Vector2d> undistortRadtan(const Coefficients& k, const Eigen::Vector2d& distorted)
{
  Eigen::Vector2d m = distorted;
  for (int iteration = 0; iteration < 30; ++iteration)
  {
    const RadtanPoint point = distortRadtan(k, m);
    const Eigen::Vector2d error = point.value - distorted;
    if (error.squaredNorm() < 1e-24)
    {
      return isBeforeFold(k, m.squaredNorm()) ? std::make_optional(m) : std::nullopt;
    }
    const double determinant = point.jacobian.determinant();
    if (std::abs(determinant) < 1e-9)
    {
      return std::nullopt;
    }
    m -= point.jacobian.inverse() * error;
  }
  return std::nullopt;
}

std::optional<double> undistortEquidistant(const Coefficients& k, double distorted)
{
  double theta = distorted;
  for (int iteration = 0; iteration < 30; ++iteration)
  {
    const Angle angle = distortEquidistant(k, theta);
    if (angle.slope < 1e-6)
    {
      return std::nullopt;
    }
    const double step = (angle.value - distorted) / angle.slope;
    theta -= step;
    if (std::abs(step) < 1e-13)
    {
      return theta >= 0.0 && theta < M_PI ? std::make_optional(theta) : std::nullopt;
    }
  }
  return std::nullopt;
}

}  // namespace

size_t CameraModel::usedCoefficients() const
{
  const auto& k = coefficients;
  return k[5] != 0.0 || k[6] != 0.0 || k[7] != 0.0 ? 8 : k[4] != 0.0 ? 5 : 4;
}

void CameraModel::validate() const
{
  const auto check = [](bool good, const std::string& field, double value, const std::string& bound)
  {
    if (!good)
    {
      throw std::invalid_argument("camera: " + field + " = " + std::to_string(value) + ", must be " + bound);
    }
  };
  check(width >= 1 && width <= 8192, "width", width, "in [1, 8192] px");
  check(height >= 1 && height <= 8192, "height", height, "in [1, 8192] px");
  check(fx > 0.0 && std::isfinite(fx), "fx", fx, "above 0 px");
  check(fy > 0.0 && std::isfinite(fy), "fy", fy, "above 0 px");
  check(std::isfinite(cx), "cx", cx, "finite");
  check(std::isfinite(cy), "cy", cy, "finite");
  for (const double coefficient : coefficients)
  {
    check(std::isfinite(coefficient), "distortion coefficient", coefficient, "finite");
  }
}

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& p) const
{
  Eigen::Vector2d m;
  if (distortion == Distortion::EQUIDISTANT)
  {
    const double radius = p.head<2>().norm();
    const double theta = std::atan2(radius, p.z());
    const Angle angle = distortEquidistant(coefficients, theta);
    if ((radius == 0.0 && p.z() <= 0.0) || angle.slope <= 0.0 || angle.value < 0.0)
    {
      return std::nullopt;
    }
    m = radius > 1e-12 ? Eigen::Vector2d(p.head<2>() * (angle.value / radius)) : Eigen::Vector2d::Zero();
  }
  else
  {
    if (p.z() <= 0.0)
    {
      return std::nullopt;
    }
    m = p.head<2>() / p.z();
    if (distortion == Distortion::RADTAN)
    {
      if (!isBeforeFold(coefficients, m.squaredNorm()))
      {
        return std::nullopt;
      }
      m = distortRadtan(coefficients, m).value;
    }
  }
  return Eigen::Vector2d(fx * m.x() + cx, fy * m.y() + cy);
}

std::optional<Eigen::Vector3d> CameraModel::unproject(const Eigen::Vector2d& pixel) const
{
  const Eigen::Vector2d distorted((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  if (distortion == Distortion::EQUIDISTANT)
  {
    const double radius = distorted.norm();
    const std::optional<double> theta = undistortEquidistant(coefficients, radius);
    if (!theta)
    {
      return std::nullopt;
    }
    const double scale = radius > 1e-12 ? std::sin(*theta) / radius : 1.0;
    return Eigen::Vector3d(distorted.x() * scale, distorted.y() * scale, std::cos(*theta)).normalized();
  }
  const std::optional<Eigen::Vector2d> m =
      distortion == Distortion::RADTAN ? undistortRadtan(coefficients, distorted) : std::make_optional(distorted);
  return m ? std::make_optional(Eigen::Vector3d(m->x(), m->y(), 1.0).normalized()) : std::nullopt;
}

}  // namespace pi_slam
