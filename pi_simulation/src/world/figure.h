#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>

namespace pi_simulation::synthetic
{

/// What a part of an object moves with. Frames at rest: x forward, y left, z up, at the joint nearer to the body.
enum class Bone : uint8_t
{
  ROOT,  ///< the object itself: origin on the ground below its centre
  PELVIS,
  CHEST,
  HEAD,
  LEFT_UPPER_ARM,
  LEFT_FOREARM,
  LEFT_THIGH,
  LEFT_SHIN,
  LEFT_FOOT,
  RIGHT_UPPER_ARM,
  RIGHT_FOREARM,
  RIGHT_THIGH,
  RIGHT_SHIN,
  RIGHT_FOOT,
  REAR_WHEEL,  ///< of a bicycle, at its hub
  FRONT_WHEEL,
  CRANK,
  COUNT,
};

constexpr size_t BONES = static_cast<size_t>(Bone::COUNT);

/// The same bone of the right arm or leg.
constexpr Bone rightOf(Bone left)
{
  return static_cast<Bone>(static_cast<int>(left) + static_cast<int>(Bone::RIGHT_UPPER_ARM) -
                           static_cast<int>(Bone::LEFT_UPPER_ARM));
}

/// Lengths of a person's body [m], of one 1.75 m high unless scaled, and how the person moves.
struct Figure
{
  double thigh = 0.43;
  double shin = 0.42;
  double ankle = 0.08;  ///< above the sole
  double hip = 0.09;    ///< from the middle
  double spine = 0.13;  ///< from the hips to the waist, where the chest bends
  double trunk = 0.33;  ///< from the waist to the shoulders
  double shoulder = 0.19;
  double upper_arm = 0.29;
  double forearm = 0.26;
  double neck = 0.13;        ///< from the shoulders to the joint of the head
  double arms_aside = 0.1;   ///< [rad]
  double step = 0.7;         ///< [m]
  bool rides = false;        ///< a bicycle
  double saddle = 0.94;      ///< height of the hips on it [m]
  double wheel_base = 1.04;  ///< of the bicycle
  double wheel = 0.34;       ///< its radius

  /// The same person, taller or smaller.
  Figure scaled(double scale) const;
};

/// Bones in the frame of the object, at one time.
using Pose = std::array<Eigen::Isometry3f, BONES>;

/// A person who stands, walks or runs, with one foot on the ground; or one who rides.
/// @param distance  gone so far [m]. @param speed  [m/s]
Pose poseOf(const Figure& figure, double distance, double speed);

}  // namespace pi_simulation::synthetic
