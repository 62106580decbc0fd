#pragma once

#include "chassis/simulated_chassis.h"
#include "renderer/synthetic_world.h"
#include "vehicle/actor.h"
#include "vehicle/motion_window.h"
#include "vehicle/oriented_box.h"
#include "vehicle/road_surface.h"
#include "vehicle/scenario.h"

#include <pi_slam/imu_simulator.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

namespace pi_simulation
{

struct VehicleSimulationOptions
{
  SimulationOptions chassis;                                     ///< its start comes from the scenario
  pi_slam::ImuSimulatorOptions imu;                              ///< rate_hz must be 200
  Eigen::Vector3d imu_in_base = Eigen::Vector3d(0.8, 0.0, 1.0);  ///< also the middle between the cameras [m]
  double front = 1.0;                                            ///< outline of the vehicle, ahead of base_link [m]
  double rear = 0.5;                                             ///< behind it [m]
  double half_width = 0.6;                                       ///< [m]
  double height = 1.6;                                           ///< what hangs higher is passed below [m]
  double frame_rate_hz = 20.0;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

enum class CameraState
{
  ON,
  OFF,   ///< sends nothing
  DARK,  ///< sends black pictures
};

/// What the cameras see at one time.
struct Exposure
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();  ///< body: the IMU
  std::vector<ActorState> actors;
  CameraState left = CameraState::ON;
  CameraState right = CameraState::ON;
};

/// Where the vehicle truly is, in the map.
struct TruePose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();      ///< of base_link along its axes [m/s]
  Eigen::Vector3d angular_rate = Eigen::Vector3d::Zero();  ///< likewise [rad/s]
};

/// Something that the vehicle could hit, in base_link.
struct TrueObstacle
{
  int id = 0;
  std::string name;  ///< of an actor in the scenario; else empty
  std::string class_name;
  OrientedBox box;                                     ///< in base_link
  double height = 0.0;                                 ///< [m]
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  ///< over the ground, along the axes of base_link [m/s]
  double distance = 0.0;                               ///< from the outline of the vehicle [m]
};

/// What the simulation gives away as time goes on; called by advance(). Stamps are those of advance().
struct SimulationOutputs
{
  std::function<void(const pi_slam::ImuSample&)> imu;                                 ///< 200 Hz, unless the IMU is off
  std::function<void(const Exposure&)> exposure;                                      ///< frame_rate_hz
  std::function<void(const TruePose&)> pose;                                          ///< 50 Hz
  std::function<void(int64_t stamp_ns, const std::vector<TrueObstacle>&)> obstacles;  ///< 20 Hz, nearest first
  std::function<void(const std::string&)> log;  ///< lines of JSON, see docs/design/vehicle_simulator.md
};

/// The vehicle in its world: chassis on a pseudo-terminal, motion over an uneven road, IMU, actors, faults, and the
/// judge's facts. The map is where pi_slam begins it: at the IMU's place and heading at the start, z up. The caller
/// gives it time. Not thread safe.
class VehicleSimulation
{
public:
  static constexpr double OBSTACLE_RANGE_M = 30.0;  ///< farther ones are not given away

  /// @param clock  any that does not jump [ns]; asked once, for the time of the start, when the world is built. Outputs
  /// must stay valid.
  /// @throws std::invalid_argument for wrong options, std::runtime_error without a pseudo-terminal.
  VehicleSimulation(const Scenario& scenario, const VehicleSimulationOptions& options, SimulationOutputs outputs,
                    const std::function<int64_t()>& clock);

  /// Goes on in steps of 1 ms up to now. After a pause of more than 1 s it leaves out what is missing.
  void advance(int64_t now_ns);

  /// One line of text: those of SimulatedChassis, `camera left|right|both on|off|dark`, `imu on|off`, `actor ID go`.
  /// @return what is wrong with it and what would be right; empty: done.
  std::string command(const std::string& line);

  const std::shared_ptr<const SyntheticWorld>& world() const { return world_; }
  const SimulatedChassis& chassis() const { return chassis_; }
  pi_vehicle::Pose2 mapInWorld() const { return map_in_world_; }
  int64_t startNs() const { return start_ns_; }
  uint64_t collisions() const { return collisions_; }
  double lostSeconds() const { return 1e-9 * static_cast<double>(lost_ns_); }  ///< left out by advance()

private:
  void step();
  void runFaults();
  void publish();
  void judge();
  std::vector<TrueObstacle> obstacles() const;
  std::vector<ActorState> actorStates() const;
  OrientedBox outline() const;
  std::string execute(const std::string& line);
  void log(const std::string& type, const std::string& fields);
  double time() const { return 1e-9 * static_cast<double>(now_ns_ - start_ns_); }

  const Scenario scenario_;
  const VehicleSimulationOptions options_;
  const SimulationOutputs outputs_;
  const RoadSurface surface_;
  const pi_vehicle::Pose2 map_in_world_;
  Eigen::Isometry3d T_map_world_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_base_body_ = Eigen::Isometry3d::Identity();
  std::vector<Actor> actors_;
  std::shared_ptr<const SyntheticWorld> world_;
  const int64_t start_ns_;
  SimulatedChassis chassis_;
  pi_slam::ImuNoise noise_;
  MotionWindow window_;
  int64_t now_ns_;
  int64_t frame_ = 1;  ///< number of the next one
  int64_t lost_ns_ = 0;
  bool imu_on_ = true;
  CameraState left_ = CameraState::ON;
  CameraState right_ = CameraState::ON;
  std::multimap<double, std::string> waiting_faults_;  ///< by time [s]
  std::set<int> touching_;                             ///< ids that the outline overlaps
  uint64_t collisions_ = 0;
};

}  // namespace pi_simulation
