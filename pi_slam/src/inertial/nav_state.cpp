#include "inertial/nav_state.h"
#include <pi_slam/so3.h>

namespace pi_slam
{

void NavState::boxPlus(const Vector15d& delta)
{
  p += delta.segment<3>(0);
  q = (q * expSo3(delta.segment<3>(3))).normalized();
  v += delta.segment<3>(6);
  bias.gyro += delta.segment<3>(9);
  bias.accel += delta.segment<3>(12);
}

Vector15d NavState::boxMinus(const NavState& other) const
{
  Vector15d delta;
  delta.segment<3>(0) = p - other.p;
  delta.segment<3>(3) = logSo3(other.q.conjugate() * q);
  delta.segment<3>(6) = v - other.v;
  delta.segment<3>(9) = bias.gyro - other.bias.gyro;
  delta.segment<3>(12) = bias.accel - other.bias.accel;
  return delta;
}

bool NavState::isFinite() const
{
  return p.allFinite() && q.coeffs().allFinite() && v.allFinite() && bias.gyro.allFinite() && bias.accel.allFinite();
}

}  // namespace pi_slam
