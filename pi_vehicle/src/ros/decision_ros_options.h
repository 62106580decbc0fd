#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>

namespace pi_vehicle
{

/// The parameters of the arbiter node; config/arbiter_node.yaml shows each with its unit.
struct ArbiterRosOptions : pi_node::NodeParameters<ArbiterRosOptions>
{
  std::string sources_file = "arbiter.yaml";  ///< see configPath()
  double rate = 50.0;                         ///< of motion [Hz]
  double vehicle_state_timeout = 0.3;         ///< an older measured speed does not count [s]
  double diagnostic_period = 1.0;             ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;              ///< between two log lines of one warning [s]
  pi_node::MotionLimits limits;               ///< of the vehicle

  void setVehicle(const pi_node::VehicleDescription& vehicle) { limits = vehicle.limits; }
  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// The parameters of the command node; config/command_node.yaml shows each with its unit.
struct CommandRosOptions : pi_node::NodeParameters<CommandRosOptions>
{
  std::string actions_file = "commands_actions.yaml";  ///< see configPath()
  double rate = 20.0;                                  ///< of motion/command [Hz]
  double stop_deceleration = 2.5;                      ///< of a latched stop [m/s^2]; 0: the usual one
  bool stopped_at_start = false;
  std::string question = "shall I go on";              ///< said when a release needs a confirmation; empty: nothing
  std::string doubt_question = "please say it again";  ///< after a doubtful stop; without "stop": it hears itself
  std::string map_frame = "map";
  double diagnostic_period = 1.0;  ///< [s]
  double warning_period_s = 5.0;   ///< [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// The parameters of the reaction node; config/reaction_node.yaml shows each with its unit.
struct ReactionRosOptions : pi_node::NodeParameters<ReactionRosOptions>
{
  std::string rules_file = "reaction.yaml";  ///< see configPath()
  double rate = 20.0;                        ///< of motion/reaction [Hz]
  bool need_obstacles = true;                ///< the vehicle stands while they are silent
  double obstacles_timeout = 0.5;            ///< age of the newest from which on they are silent [s]
  double max_unseen = 0.2;                   ///< an obstacle not seen for longer does not count [s]
  double stop_deceleration = 2.5;            ///< of rules that stop [m/s^2]; 0: the usual one
  double slow_deceleration = 0.0;            ///< of rules that slow, and of silence [m/s^2]
  std::string greeting = "hello";            ///< of rules that greet without a text of their own; empty: nothing
  std::string base_link_frame = "base_link";
  double diagnostic_period = 1.0;  ///< [s]
  double warning_period_s = 5.0;   ///< [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// An absolute path as it is; a name without a folder as one in this package's folder config.
/// @throws std::invalid_argument for anything else, or if the package is not found.
std::string configPath(const std::string& parameter, const std::string& file);

}  // namespace pi_vehicle

extern template struct pi_node::NodeParameters<pi_vehicle::ArbiterRosOptions>;
extern template struct pi_node::NodeParameters<pi_vehicle::CommandRosOptions>;
extern template struct pi_node::NodeParameters<pi_vehicle::ReactionRosOptions>;
