#pragma once

#include "decision/drive_command.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// Who may move the vehicle, or hold it back.
struct ArbiterSource
{
  std::string name;
  bool drives = true;      ///< false: only limits the speed of whoever drives
  int priority = 0;        ///< of those that drive, the highest one that lives does
  double timeout = 0.3;    ///< dead man: silent for longer, it is dead [s]
  double max_speed = 3.0;  ///< what this source may ask for [m/s]
  bool required = false;   ///< its death stops the vehicle, whoever drives
};

struct ArbiterOptions
{
  double max_speed = 3.0;                 ///< forwards [m/s]
  double max_reverse_speed = 0.0;         ///< backwards [m/s]; 0: not allowed
  double acceleration = 1.0;              ///< [m/s^2]
  double deceleration = 1.0;              ///< usual [m/s^2]
  double emergency_deceleration = 2.5;    ///< [m/s^2]
  double jerk = 4.0;                      ///< [m/s^3]
  double emergency_jerk = 25.0;           ///< when braking harder than usual [m/s^3]
  double max_curvature = 0.45;            ///< [1/m]
  double max_curvature_rate = 0.8;        ///< [1/(m s)]
  double max_lateral_acceleration = 1.5;  ///< speed is bounded in bends [m/s^2]
  std::vector<ArbiterSource> sources;

  /// @code{.yaml}
  /// limits: {max_speed: 3.0, ...}
  /// sources:
  ///   - {name: remote, priority: 100, timeout: 0.3, max_speed: 1.5}
  ///   - {name: reaction, drives: false, timeout: 0.5, required: true}
  /// @endcode
  /// @throws std::invalid_argument naming source, field, value and bound.
  static ArbiterOptions load(const std::string& path);
  static ArbiterOptions parse(const std::string& yaml, const std::string& name);
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.emergency_jerk, o.max_reverse_speed, void())
{
  visit("max_speed", o.max_speed);
  visit("max_reverse_speed", o.max_reverse_speed);
  visit("acceleration", o.acceleration);
  visit("deceleration", o.deceleration);
  visit("emergency_deceleration", o.emergency_deceleration);
  visit("jerk", o.jerk);
  visit("emergency_jerk", o.emergency_jerk);
  visit("max_curvature", o.max_curvature);
  visit("max_curvature_rate", o.max_curvature_rate);
  visit("max_lateral_acceleration", o.max_lateral_acceleration);
}

enum class ArbiterAnswer
{
  TAKEN,
  UNKNOWN_SOURCE,
  NOT_FINITE,   ///< a number that is none; the source's last command goes on until its timeout
  TOO_OLD,      ///< the stamp is older than the source's timeout
  FROM_FUTURE,  ///< by more than 0.1 s: check the clocks
  OUT_OF_ORDER  ///< older than the last one taken
};

/// The one output.
struct ArbiterOutput
{
  DriveCommand command;         ///< source: who drives, or "arbiter"; reason: why it drives or stands
  double acceleration = 0.0;    ///< of command.speed now [m/s^2]
  bool emergency_stop = false;  ///< latched
  std::string driver;           ///< the source that drives, also while others hold it back; empty: none
  std::string limited_by;       ///< the source whose bound holds, or "arbiter"; empty: none
  bool missing = false;         ///< a required source is silent; reason names it
};

/// What the arbiter knows of a source.
struct ArbiterSourceState
{
  bool alive = false;     ///< at the last update
  bool released = false;  ///< ended in order
  bool heard = false;     ///< ever
  int64_t stamp_ns = 0;   ///< of its last command
  DriveCommand command;   ///< the last one
};

/// Merges commands into one that may be executed.
///
/// Of the sources that drive, the highest priority that lives decides speed and curvature; those that limit bound the
/// speed and the deceleration asked for. If the source that drives falls silent, the vehicle is first brought to a
/// standstill, then the next may drive; a source that ends in order calls release(), and then the next takes over at
/// once. A higher priority takes over at once. Silence of a required source (also before its first command) and the
/// emergency stop hold the vehicle at 0.
///
/// The output is shaped: speed by acceleration, deceleration and jerk, curvature by its bound and rate, speed in bends
/// by lateral acceleration. Time comes in as numbers; between two updates at most 0.1 s are made up for. A clock that
/// goes back, or forward by more than a second, kills all sources: they must speak anew.
/// Not thread safe: the adapter serialises.
class Arbiter
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit Arbiter(const ArbiterOptions& options);

  /// @param stamp_ns  of the command, @param now_ns  when it arrived, on one clock.
  ArbiterAnswer submit(const DriveCommand& command, int64_t stamp_ns, int64_t now_ns);
  /// The source has nothing more to say; a required one is then not missed until it speaks again.
  /// @return false if there is no such source.
  bool release(const std::string& source);

  /// Holds the vehicle, braking with emergency_deceleration, until releaseEmergencyStop(). Repeated: the first reason
  /// stays.
  void emergencyStop(const std::string& reason);
  /// @return false, with the latch kept, if the vehicle still moves (last measured or commanded speed).
  bool releaseEmergencyStop();

  /// To be called at 20 to 100 Hz. @param measured_speed  [m/s]; nullopt or not finite: the commanded one counts.
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
