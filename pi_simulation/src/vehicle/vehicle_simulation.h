#pragma once

#include "chassis/simulated_chassis.h"
#include "vehicle/actor.h"
#include "vehicle/fault_schedule.h"
#include "vehicle/motion_window.h"
#include "vehicle/oriented_box.h"
#include "vehicle/road_surface.h"
#include "vehicle/scenario.h"
#include "world/synthetic_world.h"

#include <pi_slam/imu_simulator.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
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
  pi_node::Footprint footprint;                                  ///< for collisions
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

/// The scene in front of the cameras at one time.
struct Exposure
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_world_body = Eigen::Isometry3d::Identity();  ///< body: the IMU
  std::vector<ActorState> actors;
  CameraState left = CameraState::ON;
  CameraState right = CameraState::ON;
};

/// True pose and motion of the vehicle, in the map.
struct TruePose
{
  int64_t stamp_ns = 0;
  Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();      ///< of base_link along its axes [m/s]
  Eigen::Vector3d angular_rate = Eigen::Vector3d::Zero();  ///< likewise [rad/s]
};

/// An object that the vehicle could hit, in base_link.
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

/// What a stock base tells of itself, in a frame that begins where it was started.
struct BaseOdometry
{
  int64_t stamp_ns = 0;
  pi_vehicle::Pose2 pose;
  double speed = 0.0;     ///< [m/s]
  double yaw_rate = 0.0;  ///< [rad/s]
};

/// Outputs of the simulation, called by advance(). Stamps are on the clock of advance().
struct SimulationOutputs
{
  std::function<void(const pi_slam::ImuSample&)> imu;                                 ///< 200 Hz, unless the IMU is off
  std::function<void(const Exposure&)> exposure;                                      ///< frame_rate_hz
  std::function<void(const TruePose&)> pose;                                          ///< 50 Hz
  std::function<void(const BaseOdometry&)> odometry;                                  ///< 50 Hz, of a stock base
  std::function<void(int64_t stamp_ns, const std::vector<TrueObstacle>&)> obstacles;  ///< 20 Hz, nearest first
  std::function<void(const std::string& with)> collision;  ///< the outline begins to overlap a thing
  std::function<void(const std::string&)> log;             ///< lines of JSON, see docs/design/vehicle_simulator.md
};

/// Simulates the vehicle in its world: chassis on a pseudo-terminal or a stock base, motion over an uneven road, IMU,
/// actors, faults, and a log of states and events. The map has its origin where pi_slam starts: at the IMU, with its
/// heading, z up. The caller passes the time. Not thread safe.
class VehicleSimulation
{
public:
  static constexpr double OBSTACLE_RANGE_M = 30.0;  ///< farther obstacles are left out

  /// @param outputs  must stay valid.
  /// @param start_ns  of the clock of advance().
  /// @throws std::invalid_argument for wrong options, std::runtime_error without a pseudo-terminal.
  VehicleSimulation(const Scenario& scenario, const VehicleSimulationOptions& options, SimulationOutputs outputs,
                    int64_t start_ns);

  /// Advances to now in steps of 1 ms. Reads the chassis's line in any case.
  void advance(int64_t now_ns);

  /// To a stock base, now. @return false if a number is not finite.
  bool onTwist(double linear, double angular) { return chassis_.onTwist(linear, angular, now_ns_); }

  /// One line of text: those of SimulatedChassis, `camera left|right|both on|off|dark`, `imu on|off`, `actor ID go`.
  /// @return the problem with its remedy; empty: done.
  std::string command(const std::string& line);

  /// A line of type `error` in the log.
  void logError(const std::string& text);

  const std::shared_ptr<const SyntheticWorld>& world() const { return world_; }
  const SimulatedChassis& chassis() const { return chassis_; }
  pi_vehicle::Pose2 mapInWorld() const { return map_in_world_; }
  int64_t startNs() const { return start_ns_; }
  uint64_t collisions() const { return collisions_; }

private:
  void step();
  void runFaults();
  void publish();
  void judge();
  std::vector<TrueObstacle> obstacles() const;
  std::vector<ActorState> actorStates() const;
  OrientedBox outline() const;
  std::string execute(const std::string& line);
  void log(const std::string& type, const nlohmann::ordered_json& fields);
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
  bool imu_on_ = true;
  CameraState left_ = CameraState::ON;
  CameraState right_ = CameraState::ON;
  FaultSchedule faults_;
  std::set<int> touching_;  ///< ids that the outline overlaps
  uint64_t collisions_ = 0;
};

}  // namespace pi_simulation
