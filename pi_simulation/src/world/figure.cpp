#include "world/figure.h"

#include <algorithm>
#include <cmath>

namespace pi_simulation::synthetic
{

namespace
{

constexpr double WALK = 1.2;      ///< full swing of the limbs from this speed on [m/s]
constexpr double RUN_FROM = 1.9;  ///< [m/s]
constexpr double RUN = 2.8;
constexpr double CRANK_M = 0.17;
constexpr double GEAR = 2.6;  ///< turns of the wheel per turn of the crank

double part(double value, double low, double high)
{
  return std::clamp((value - low) / (high - low), 0.0, 1.0);
}

Eigen::Isometry3d at(double x, double y, double z)
{
  return Eigen::Isometry3d(Eigen::Translation3d(x, y, z));
}

/// Turns forward what hangs down.
Eigen::AngleAxisd forward(double angle)
{
  return {-angle, Eigen::Vector3d::UnitY()};
}

/// To the left.
Eigen::AngleAxisd aside(double angle)
{
  return {angle, Eigen::Vector3d::UnitX()};
}

struct Leg
{
  double hip;   ///< forward [rad]
  double knee;  ///< backward, of the shin against the thigh [rad]
  double foot;  ///< toes up against the ground [rad]

  double drop(const Figure& figure) const
  {
    return figure.thigh * std::cos(hip) + figure.shin * std::cos(hip - knee) + figure.ankle;
  }
};

Leg stepping(double phase, double swing, double run)
{
  Leg leg;
  leg.hip = swing * ((0.38 + 0.24 * run) * std::sin(phase) + 0.06 + 0.18 * run);
  const double lifted = std::max(std::cos(phase - 0.25), 0.0);
  leg.knee = 0.04 + swing * (0.08 + 0.25 * run + (0.95 + 0.75 * run) * lifted * lifted);
  // The heel meets the ground with the toes up, the toes leave it last.
  leg.foot = swing * (0.3 * std::max(std::sin(phase), 0.0) - 0.75 * std::max(-std::sin(phase - 0.5), 0.0));
  return leg;
}

/// With the foot at a point in front of the hip and below it.
Leg reaching(const Figure& figure, double ahead, double below)
{
  const double length = std::min(std::hypot(ahead, below), 0.995 * (figure.thigh + figure.shin));
  const auto corner = [](double a, double b, double c)
  { return std::acos(std::clamp((a * a + b * b - c * c) / (2.0 * a * b), -1.0, 1.0)); };
  Leg leg;
  leg.hip = std::atan2(ahead, below) + corner(figure.thigh, length, figure.shin);
  leg.knee = M_PI - corner(figure.thigh, figure.shin, length);
  leg.foot = -0.15;
  return leg;
}

struct Arm
{
  double shoulder;  ///< forward [rad]
  double elbow;
};

struct Body
{
  Eigen::Vector3d hips;
  double lean;        ///< of the trunk [rad]
  double twist;       ///< of the chest, to the left [rad]
  double head_lifts;  ///< against the chest [rad]
  Leg legs[2];        ///< left, right
  Arm arms[2];
};

Pose pose(const Figure& figure, const Body& body)
{
  std::array<Eigen::Isometry3d, BONES> bones;
  bones.fill(Eigen::Isometry3d::Identity());
  const auto bone = [&](Bone index) -> Eigen::Isometry3d& { return bones[static_cast<size_t>(index)]; };
  const Eigen::Isometry3d hips = at(body.hips.x(), body.hips.y(), body.hips.z());
  bone(Bone::PELVIS) =
      hips * forward(-0.5 * body.lean) * Eigen::AngleAxisd(-0.6 * body.twist, Eigen::Vector3d::UnitZ());
  bone(Bone::CHEST) =
      hips * forward(-body.lean) * at(0.0, 0.0, figure.spine) * Eigen::AngleAxisd(body.twist, Eigen::Vector3d::UnitZ());
  bone(Bone::HEAD) = bone(Bone::CHEST) * at(0.0, 0.0, figure.trunk + figure.neck) * forward(body.head_lifts) *
                     Eigen::AngleAxisd(-body.twist, Eigen::Vector3d::UnitZ());
  for (const int side : {0, 1})
  {
    const double left = side == 0 ? 1.0 : -1.0;
    const auto of = [&](Bone left_one) -> Eigen::Isometry3d& { return bone(side == 0 ? left_one : rightOf(left_one)); };
    const Arm& arm = body.arms[side];
    of(Bone::LEFT_UPPER_ARM) = bone(Bone::CHEST) * at(0.0, left * figure.shoulder, figure.trunk) *
                               aside(left * figure.arms_aside) * forward(arm.shoulder + body.lean);
    of(Bone::LEFT_FOREARM) = of(Bone::LEFT_UPPER_ARM) * at(0.0, 0.0, -figure.upper_arm) * forward(arm.elbow) *
                             aside(-0.7 * left * figure.arms_aside);
    const Leg& leg = body.legs[side];
    of(Bone::LEFT_THIGH) = hips * at(0.0, left * figure.hip, 0.0) * forward(leg.hip);
    of(Bone::LEFT_SHIN) = of(Bone::LEFT_THIGH) * at(0.0, 0.0, -figure.thigh) * forward(-leg.knee);
    of(Bone::LEFT_FOOT) = of(Bone::LEFT_SHIN) * at(0.0, 0.0, -figure.shin) * forward(leg.knee - leg.hip + leg.foot);
  }
  Pose result;
  for (size_t i = 0; i < BONES; ++i)
  {
    result[i] = bones[i].cast<float>();
  }
  return result;
}

Pose onFoot(const Figure& figure, double distance, double speed)
{
  const double swing = part(speed, 0.0, WALK);
  const double run = part(speed, RUN_FROM, RUN);
  const double phase = M_PI * distance / figure.step;
  Body body;
  body.lean = 0.02 + 0.03 * swing + 0.14 * run;
  body.twist = 0.12 * swing * std::sin(phase);
  body.head_lifts = 0.5 * body.lean;
  for (const int side : {0, 1})
  {
    const double own = phase + (side == 0 ? 0.0 : M_PI);
    body.legs[side] = stepping(own, swing, run);
    body.arms[side] = {-swing * (0.38 + 0.3 * run) * std::sin(own) - 0.1 * run,
                       0.14 + 0.16 * swing * (1.0 - std::sin(own)) + 1.15 * run};
  }
  const double flight = 0.06 * run * std::abs(std::cos(phase));
  body.hips = {0.0, 0.0, std::max(body.legs[0].drop(figure), body.legs[1].drop(figure)) + flight};
  return pose(figure, body);
}

Pose riding(const Figure& figure, double distance)
{
  const double turn = distance / figure.wheel;  // of the wheels [rad]
  const double crank = turn / GEAR;
  const double bottom_bracket = 0.28;
  Body body;
  body.hips = {-0.22, 0.0, figure.saddle};
  body.lean = 0.5;
  body.twist = 0.0;
  body.head_lifts = 0.42;
  for (const int side : {0, 1})
  {
    const double own = crank + (side == 0 ? 0.0 : M_PI);
    const double pedal_x = CRANK_M * std::cos(own);
    const double pedal_z = bottom_bracket - CRANK_M * std::sin(own);
    body.legs[side] = reaching(figure, pedal_x - body.hips.x() - 0.06, body.hips.z() - pedal_z - figure.ankle);
    body.arms[side] = {0.9, 0.25};
  }
  Pose result = pose(figure, body);
  const auto wheel = [&](Bone bone, double x, double z, double angle)
  {
    result[static_cast<size_t>(bone)] =
        (at(x, 0.0, z) * Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitY())).cast<float>();
  };
  wheel(Bone::REAR_WHEEL, -0.5 * figure.wheel_base, figure.wheel, turn);
  wheel(Bone::FRONT_WHEEL, 0.5 * figure.wheel_base, figure.wheel, turn);
  wheel(Bone::CRANK, 0.0, bottom_bracket, crank);
  return result;
}

}  // namespace

Figure Figure::scaled(double scale) const
{
  Figure figure = *this;
  for (double* length : {&figure.thigh, &figure.shin, &figure.ankle, &figure.hip, &figure.spine, &figure.trunk,
                         &figure.shoulder, &figure.upper_arm, &figure.forearm, &figure.neck, &figure.step})
  {
    *length *= scale;
  }
  return figure;
}

Pose poseOf(const Figure& figure, double distance, double speed)
{
  return figure.rides ? riding(figure, distance) : onFoot(figure, distance, speed);
}

}  // namespace pi_simulation::synthetic
