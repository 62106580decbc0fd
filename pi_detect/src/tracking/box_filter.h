#pragma once

#include <pi_detect/detection.h>

#include <Eigen/Core>
#include <array>

namespace pi_detect
{

/// Noise of a box filter, in parts of the box's size (square root of its area), so that near and far objects are alike.
struct BoxFilterNoise
{
  double position = 0.1;        ///< of a detection's centre
  double size = 0.15;           ///< of a detection's width and height
  double first_speed = 2.0;     ///< of a new object [1/s]
  double acceleration = 2.0;    ///< density of the white noise that changes the centre's speed [1/s^2 sqrt(s)]
  double growth_change = 0.25;  ///< the same for width and height
  double growth_time_s = 0.5;   ///< in which growth fades
};

/// Position and speed of one side or one coordinate: Kalman filter with 2 states.
struct AxisFilter
{
  double x = 0.0;
  double v = 0.0;
  double P_xx = 0.0;
  double P_xv = 0.0;
  double P_vv = 0.0;

  /// White noise acceleration of density q (standard deviation), speed fading by `fade` over dt.
  void predict(double dt_s, double q, double fade);
  void correct(double measured, double sigma);
};

/// Kalman filter of a box that moves with constant velocity. The errors of centre, width and height are independent, so
/// one filter with 8 states becomes four with 2.
class BoxFilter
{
public:
  BoxFilter(const Box& box, const BoxFilterNoise& noise);

  void predict(double dt_s);
  /// The camera moved: the box is shifted [px] and grows by a factor.
  void shift(const Eigen::Vector2d& way, double growth);
  void correct(const Box& box);

  Box box() const;
  double velocityX() const { return axes_[0].v; }  ///< of the centre [px/s]
  double velocityY() const { return axes_[1].v; }

private:
  double scale() const;  ///< square root of the area [px]

  BoxFilterNoise noise_;
  std::array<AxisFilter, 4> axes_;  ///< centre x, centre y, width, height
};

}  // namespace pi_detect
