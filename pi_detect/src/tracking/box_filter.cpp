#include "tracking/box_filter.h"

#include <algorithm>
#include <cmath>

namespace pi_detect
{
namespace
{

constexpr double LEAST_SIDE = 1.0;  // [px]

std::array<double, 4> measure(const Box& box)
{
  return {0.5 * (static_cast<double>(box.x1) + box.x2), 0.5 * (static_cast<double>(box.y1) + box.y2),
          static_cast<double>(box.width()), static_cast<double>(box.height())};
}

}  // namespace

void AxisFilter::predict(double dt_s, double q, double fade)
{
  x += v * dt_s;
  P_xx += dt_s * (2.0 * P_xv + dt_s * P_vv) + q * q * dt_s * dt_s * dt_s / 3.0;
  P_xv = fade * (P_xv + dt_s * P_vv) + q * q * dt_s * dt_s / 2.0;
  P_vv = fade * fade * P_vv + q * q * dt_s;
  v *= fade;
}

void AxisFilter::correct(double measured, double sigma)
{
  const double innovation = measured - x;
  const double variance = P_xx + sigma * sigma;
  const double gain_x = P_xx / variance;
  const double gain_v = P_xv / variance;
  x += gain_x * innovation;
  v += gain_v * innovation;
  P_vv -= gain_v * P_xv;
  P_xv *= 1.0 - gain_x;
  P_xx *= 1.0 - gain_x;
}

BoxFilter::BoxFilter(const Box& box, const BoxFilterNoise& noise) : noise_(noise)
{
  const std::array<double, 4> measured = measure(box);
  for (size_t i = 0; i < axes_.size(); ++i)
  {
    axes_[i].x = measured[i];
  }
  const double size = scale();
  for (size_t i = 0; i < axes_.size(); ++i)
  {
    const double sigma_x = (i < 2 ? noise_.position : noise_.size) * size;
    const double sigma_v = (i < 2 ? noise_.first_speed : noise_.growth_change) * size;
    axes_[i].P_xx = sigma_x * sigma_x;
    axes_[i].P_vv = sigma_v * sigma_v;
  }
}

void BoxFilter::predict(double dt_s)
{
  const double size = scale();
  const double fade = std::exp(-dt_s / noise_.growth_time_s);
  for (size_t i = 0; i < axes_.size(); ++i)
  {
    axes_[i].predict(dt_s, (i < 2 ? noise_.acceleration : noise_.growth_change) * size, i < 2 ? 1.0 : fade);
  }
  for (size_t i = 2; i < axes_.size(); ++i)
  {
    axes_[i].x = std::max(axes_[i].x, LEAST_SIDE);
  }
}

void BoxFilter::shift(const Eigen::Vector2d& way, double growth)
{
  axes_[0].x += way.x();
  axes_[1].x += way.y();
  axes_[2].x *= growth;
  axes_[3].x *= growth;
  for (AxisFilter& axis : axes_)
  {
    axis.v *= growth;
  }
}

void BoxFilter::correct(const Box& box)
{
  const std::array<double, 4> measured = measure(box);
  const double size = scale();
  for (size_t i = 0; i < axes_.size(); ++i)
  {
    axes_[i].correct(measured[i], (i < 2 ? noise_.position : noise_.size) * size);
  }
  for (size_t i = 2; i < axes_.size(); ++i)
  {
    axes_[i].x = std::max(axes_[i].x, LEAST_SIDE);
  }
}

Box BoxFilter::box() const
{
  const double half_width = 0.5 * axes_[2].x;
  const double half_height = 0.5 * axes_[3].x;
  return {static_cast<float>(axes_[0].x - half_width), static_cast<float>(axes_[1].x - half_height),
          static_cast<float>(axes_[0].x + half_width), static_cast<float>(axes_[1].x + half_height)};
}

double BoxFilter::scale() const
{
  return std::sqrt(std::max(axes_[2].x, LEAST_SIDE) * std::max(axes_[3].x, LEAST_SIDE));
}

}  // namespace pi_detect
