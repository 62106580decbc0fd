#pragma once

#include "renderer/scene.h"

#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace pi_simulation::synthetic
{

/// Random numbers that are the same with every standard library. One call at most in the arguments of a function: a
/// compiler may evaluate them in any order, and another order is another world (GCC: the last first on amd64, the first
/// first on arm64).
class Random
{
public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high)
  {
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  /// The last coordinate is drawn first.
  template <int N>
  Eigen::Matrix<double, N, 1> uniform(const Eigen::Matrix<double, N, 1>& low, const Eigen::Matrix<double, N, 1>& high)
  {
    Eigen::Matrix<double, N, 1> result;
    for (int i = N; i-- > 0;)
    {
      result[i] = uniform(low[i], high[i]);
    }
    return result;
  }
  uint32_t seed() { return static_cast<uint32_t>(engine_() >> 32); }
  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }

private:
  std::mt19937_64 engine_;
};

/// An object made of primitives, in its own frame: x forward, z up, origin on the ground below its centre.
struct Prop
{
  std::string class_name;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();  ///< of the box around what one could bump into [m]
  std::vector<MovingPart> parts;
  std::optional<Figure> figure = {};  ///< of people
};

Prop makeTree(Random* random);
Prop makeLampPost(Random* random);
Prop makeSign(Random* random);
Prop makeCar(Random* random);
Prop makeCone(Random* random);
/// @param size  along x, y, z [m]
Prop makeKerb(Random* random, const Eigen::Vector3d& size);
/// @param height_m  of a child, if it is below 1.4; 0: an adult of any height.
Prop makePerson(Random* random, double height_m = 0.0);
/// A person on a bicycle, which is as high as its rider.
Prop makeCyclist(Random* random);
Prop makeCart(Random* random);
Prop makeBox(Random* random, double largest_m);
/// @param size  along the facade, depth, height [m].
Prop makeBuilding(Random* random, const Eigen::Vector3d& size);
Prop makePillar(Random* random, double height_m);
Prop makeShelf(Random* random, double width_m, double height_m);
Prop makeMachine(Random* random, const Eigen::Vector3d& size);
/// Thin along x.
Prop makePoster(Random* random, double width_m, double height_m);
/// Lies along x at `height_m` above the ground.
Prop makePipe(Random* random, double length_m, double height_m, double radius_m);
/// Hangs from `height_m` down.
Prop makeHangingLamp(Random* random, double height_m);

}  // namespace pi_simulation::synthetic
