#pragma once

#include "renderer/bounding_tree.h"
#include "renderer/shadow.h"
#include "world/figure.h"
#include "world/road_map.h"
#include "world/synthetic_world.h"

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_simulation::synthetic
{

enum class Shape : uint8_t
{
  BOX,       ///< seen from outside; invisible to a camera inside of it
  CYLINDER,  ///< around its z axis, with caps
  SPHERE,    ///< ellipsoid
  CAPSULE,   ///< smooth hull of a ball of radius 1 at z = -length / 2 and one of radius `taper` at z = length / 2
  WEDGE,     ///< box whose front leans back by `taper` from bottom to top, its rear by `rear`, its sides by `sides`
  RING,      ///< cylinder with a hole of radius `taper`
  ROOM,      ///< box seen from inside
  GROUND,    ///< plane through the centre, seen from above
};

enum class Material : uint8_t
{
  STREET,
  FACADE,
  BARK,
  FOLIAGE,
  METAL,
  SIGN,
  CAR_PAINT,
  GLASS,
  RUBBER,
  CLOTH,
  SHIRT,
  JACKET,
  SLEEVE,
  TROUSERS,
  SKIRT,
  SHOE,
  SKIN,
  FACE,
  HAIR,
  TUBE,
  CONE,
  STONE,
  HALL_SHELL,
  POSTER,
  SHELF,
  CRATE,
  MACHINE,
  PIPE,
  WARNING,
  LAMP,
};

/// An affine image of a unit shape: [-1, 1]^3, the cylinder of radius 1 and height 2, the unit sphere.
struct Primitive
{
  Shape shape = Shape::BOX;
  Material material = Material::METAL;
  Eigen::Vector3f center = Eigen::Vector3f::Zero();        ///< world [m]
  Eigen::Matrix3f rotation = Eigen::Matrix3f::Identity();  ///< local axes in the world
  Eigen::Vector3f half = Eigen::Vector3f::Ones();          ///< half extents along the local axes [m]
  float length = 0.0f;                                     ///< of a shape that has one, in its unit frame
  float taper = 0.0f;
  float rear = 0.0f;
  float sides = 0.0f;
  Eigen::Vector3f color = Eigen::Vector3f::Constant(0.5f);   ///< R, G, B reflectance in [0, 1]
  Eigen::Vector3f accent = Eigen::Vector3f::Constant(0.8f);  ///< second colour of the material
  uint32_t seed = 0;                                         ///< of the texture
  int32_t object = 0;                                        ///< id of the obstacle it belongs to, 0: none

  Eigen::Matrix3f to_unit = Eigen::Matrix3f::Identity();  ///< world to unit shape, set by place()
  Eigen::Vector3f sun_local = Eigen::Vector3f::UnitZ();   ///< direction to the sun in local axes, set by place()

  /// Sets what follows from the other members.
  void place(const Eigen::Vector3f& sun);
  Bounds bounds() const;
};

/// Back and forth between two places, with a rest at each end.
struct Motion
{
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  Eigen::Vector2d to = Eigen::Vector2d::Zero();
  double period_s = 0.0;  ///< 0: stands still at `from`
  double phase = 0.0;     ///< in [0, 1)

  struct State
  {
    Eigen::Vector2d position;
    Eigen::Vector2d velocity;
    double heading;   ///< [rad]
    double distance;  ///< walked since the last end [m]
  };
  /// @param rest_heading heading of a thing that has no motion.
  State at(double time_s, double rest_heading) const;
};

/// A primitive in the frame of a bone of its object.
struct MovingPart
{
  Primitive primitive;
  Bone bone = Bone::ROOT;
};

struct SceneObject
{
  int id = 0;
  std::string class_name;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< of the box around it [m]
  Eigen::Vector3d base = Eigen::Vector3d::Zero();  ///< centre of the box's bottom, where it stands still
  double heading = 0.0;                            ///< [rad]
  Motion motion;
  std::vector<MovingPart> parts;  ///< empty for what stands still
  std::optional<Figure> figure;   ///< of people
  int actor = -1;                 ///< its number among the actors; -1: none, the world moves it
};

/// The moving primitives at one time, in world coordinates.
struct MovingScene
{
  std::vector<Primitive> primitives;
  BoundingTree tree;
  Shadows shadows;  ///< of these primitives; empty in a hall
};

struct Scene
{
  bool has_sky = true;
  Eigen::Vector3f sun = Eigen::Vector3f(0.37f, 0.28f, 0.885f);  ///< unit vector
  float ambient = 0.5f;                                         ///< light from everywhere; the sun adds 1 - ambient
  float haze_m = 0.0f;  ///< distance at which half of the light comes from the air; 0: none
  uint32_t seed = 0;
  int64_t origin_ns = 0;  ///< time zero of all motions
  double ground_z = 0.0;
  std::vector<Primitive> primitives;  ///< the first `unbounded` ones are hit by every ray and in no tree
  size_t unbounded = 0;
  BoundingTree tree;  ///< of primitives[unbounded] and on
  std::vector<SceneObject> objects;
  RoadMap road;     ///< empty in a hall
  Shadows shadows;  ///< of what stands; empty in a hall

  double seconds(int64_t stamp_ns) const { return 1e-9 * static_cast<double>(stamp_ns - origin_ns); }
  MovingScene movingAt(int64_t stamp_ns, const std::vector<ActorState>& actors) const;
  /// @return nullopt: an actor that is not there.
  std::optional<Motion::State> stateOf(const SceneObject& object, int64_t stamp_ns,
                                       const std::vector<ActorState>& actors) const;
  /// Puts every primitive in place and builds the tree. Call once all are there.
  void finish();
};

}  // namespace pi_simulation::synthetic
