#pragma once

#include "decision/drive_command.h"

#include <pi_node/vehicle_description.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// A node that may drive the vehicle, or limit its speed.
struct ArbiterSource
{
  std::string name;
  bool drives = true;               ///< false: only limits the speed of the driving source
  int priority = 0;                 ///< the live source with the highest priority drives
  double timeout = 0.3;             ///< a source that is silent for longer is dead [s]
  std::optional<double> max_speed;  ///< of this source's commands [m/s]; none: the vehicle's
  bool required = false;            ///< the vehicle stops while this source is dead
};

struct ArbiterOptions
{
  pi_node::MotionLimits vehicle;
  double max_reverse_speed = 0.0;         ///< backwards [m/s]; 0: not allowed
  double jerk = 4.0;                      ///< [m/s^3]
  double emergency_jerk = 25.0;           ///< when braking harder than usual [m/s^3]
  double max_lateral_acceleration = 1.5;  ///< speed is bounded in bends [m/s^2]
  std::vector<ArbiterSource> sources;

  /// @code{.yaml}
  /// limits: {jerk: 4.0, ...}
  /// sources:
  ///   - {name: remote, priority: 100, timeout: 0.3, max_speed: 1.5}
  ///   - {name: reaction, drives: false, timeout: 0.5, required: true}
  /// @endcode
  /// @throws std::invalid_argument naming source, field, value and bound.
  static ArbiterOptions load(const std::string& path, const pi_node::MotionLimits& vehicle);
  static ArbiterOptions parse(const std::string& yaml, const std::string& name, const pi_node::MotionLimits& vehicle);
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.emergency_jerk, o.max_reverse_speed, void())
{
  visit("max_reverse_speed", o.max_reverse_speed);
  visit("jerk", o.jerk);
  visit("emergency_jerk", o.emergency_jerk);
  visit("max_lateral_acceleration", o.max_lateral_acceleration);
}

enum class ArbiterAnswer
{
  TAKEN,
  UNKNOWN_SOURCE,
  NOT_FINITE,   ///< a number that is not finite; the source's last command holds until its timeout
  TOO_OLD,      ///< the stamp is older than the source's timeout
  FROM_FUTURE,  ///< by more than 0.1 s: check the clocks
  OUT_OF_ORDER  ///< older than the last one taken
};

/// The merged command, and why it is so.
struct ArbiterOutput
{
  DriveCommand command;         ///< source: the one that drives, or "arbiter"; reason: why the vehicle drives or stands
  double acceleration = 0.0;    ///< of command.speed now [m/s^2]
  bool emergency_stop = false;  ///< latched
  std::string driver;           ///< the source that drives, also while others limit it; empty: none
  std::string limited_by;       ///< the source that sets the speed limit, or "arbiter"; empty: none
  bool missing = false;         ///< a required source is silent; reason names it
};

/// What the arbiter knows of a source.
struct ArbiterSourceState
{
  bool alive = false;     ///< at the last update
  bool released = false;  ///< ended by release()
  bool heard = false;     ///< at least once
  int64_t stamp_ns = 0;   ///< of its last command
  DriveCommand command;   ///< the last one
};

/// Merges the commands of all sources into one that respects all limits.
///
/// The live driving source with the highest priority sets speed and curvature. The other kind of source only limits the
/// speed, and may ask for harder braking. A higher priority takes over at once. If the driving source falls silent, the
/// vehicle stops before the next source may drive; after release() the next one takes over at once. While a required
/// source is silent (also before its first command), and during an emergency stop, the vehicle is held at 0 m/s.
///
/// The output obeys limits of acceleration, deceleration, jerk, curvature, curvature rate and lateral acceleration. One
/// update advances it by at most 0.1 s. After a clock that jumps back, or ahead by more than 1 s, all sources are dead
/// until their next command. Not thread safe.
class Arbiter
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit Arbiter(const ArbiterOptions& options);

  /// @param stamp_ns  of the command. @param now_ns  time of arrival on the same clock.
  ArbiterAnswer submit(const DriveCommand& command, int64_t stamp_ns, int64_t now_ns);
  /// The source ends. A required source is then not missed until its next command.
  /// @return false if there is no such source.
  bool release(const std::string& source);

  /// Brakes with emergency_deceleration and holds the vehicle until releaseEmergencyStop(). Of repeated calls the first
  /// reason counts.
  void emergencyStop(const std::string& reason);
  /// @return false, with the latch kept, if the vehicle still moves (last measured or commanded speed).
  bool releaseEmergencyStop();

  /// Call at 20 to 100 Hz. @param measured_speed  [m/s]; nullopt or not finite: the commanded speed is used.
  ArbiterOutput update(int64_t now_ns, std::optional<double> measured_speed = std::nullopt);

  const ArbiterOptions& options() const { return options_; }
  /// In the order of options().sources.
  const std::vector<ArbiterSourceState>& sources() const { return sources_; }

private:
  struct Demand
  {
    double speed;         // [m/s]
    double curvature;     // [1/m]
    double deceleration;  // to brake with [m/s^2]
  };

  int find(const std::string& name) const;
  /// @return the time to shape for [s].
  double advanceClock(int64_t now_ns);
  /// @return the first required source that is silent; empty: none.
  std::string expireSilentSources(int64_t now_ns);
  int highestPriority() const;
  void chooseDriver();
  Demand demandOfDriver(ArbiterOutput* output) const;
  void brakeHarder(double deceleration, Demand* demand) const;
  void applySpeedLimits(Demand* demand, ArbiterOutput* output) const;
  static void hold(const std::string& reason, Demand* demand, ArbiterOutput* output);
  /// Moves speed_, acceleration_ and curvature_ towards the demand within all limits of motion.
  void shape(const Demand& demand, double dt);

  const ArbiterOptions options_;
  std::vector<ArbiterSourceState> sources_;
  int driver_ = -1;
  bool stopping_ = false;  // the driver died: to a standstill first
  std::string dead_;
  bool emergency_ = false;
  std::string emergency_reason_;
  bool have_now_ = false;
  int64_t last_ns_ = 0;
  double speed_ = 0.0;
  double acceleration_ = 0.0;
  double curvature_ = 0.0;
  double measured_ = 0.0;
};

const char* toString(ArbiterAnswer answer);

}  // namespace pi_vehicle
