#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace pi_vehicle
{

enum class CommandAction
{
  STOP,     ///< latches
  GO,       ///< releases the latch; else: drive on
  CONFIRM,  ///< answers a release that waits, "yes"
  CANCEL,   ///< drops a release that waits, "no"
  SLOWER,   ///< speed bound down by a step
  FASTER,   ///< and up
  LEFT,     ///< at the next choice
  RIGHT,
  GO_TO,  ///< a place
  SAY,    ///< a text
  HORN
};

struct SpokenCommand
{
  std::string text;  ///< as recognised: lower case, one space between words
  CommandAction action = CommandAction::STOP;
  double min_confidence = 0.5;  ///< in [0, 1]; fainter ones are ignored
  std::string argument;         ///< GO_TO: the place; SAY: what; else empty
};

struct CommandActionsOptions
{
  bool confirm_release = false;  ///< a latched stop ends only by GO and then CONFIRM
  double confirm_timeout = 5.0;  ///< [s] for the CONFIRM
  double max_age = 2.0;          ///< older commands are ignored, except STOP [s]
  double max_speed = 3.0;        ///< bound at the start and at most [m/s]
  double min_speed = 0.5;        ///< least bound that SLOWER leads to [m/s]
  double speed_step = 0.5;       ///< of SLOWER and FASTER [m/s]
  std::vector<SpokenCommand> commands;
  std::map<std::string, Pose2> places;  ///< T_map_place

  /// @code{.yaml}
  /// options: {confirm_release: true, ...}
  /// places:
  ///   gate: [12.0, 3.5, 1.57]             # x, y [m], heading [rad] in the map
  /// commands:
  ///   - {text: stop, action: stop, min_confidence: 0.2}
  ///   - {text: go home, action: go_to, argument: gate}
  /// @endcode
  /// @throws std::invalid_argument naming entry, field, value and bound: unknown action, unknown place, a text twice,
  ///   no stop, or none to release it by.
  static CommandActionsOptions load(const std::string& path);
  static CommandActionsOptions parse(const std::string& yaml, const std::string& name);
  void validate() const;
};

template <typename Options, typename Visit>
auto visitFields(Options& o, Visit&& visit) -> decltype(o.confirm_release, o.speed_step, void())
{
  visit("confirm_release", o.confirm_release);
  visit("confirm_timeout", o.confirm_timeout);
  visit("max_age", o.max_age);
  visit("max_speed", o.max_speed);
  visit("min_speed", o.min_speed);
  visit("speed_step", o.speed_step);
}

enum class CommandOutcome
{
  DONE,                   ///< `action` is to be carried out
  AWAITS_CONFIRMATION,    ///< a release that needs CONFIRM
  IGNORED_UNKNOWN,        ///< the text is not in the table
  IGNORED_FAINT,          ///< confidence too low, or not a number
  IGNORED_OLD,            ///< older than max_age
  IGNORED_STOPPED,        ///< the stop is latched
  IGNORED_OUT_OF_CONTEXT  ///< CONFIRM or CANCEL without a question, GO without a stop is DONE
};

struct CommandResult
{
  CommandOutcome outcome = CommandOutcome::IGNORED_UNKNOWN;
  CommandAction action = CommandAction::STOP;  ///< only if the text is in the table
  std::string argument;
  Pose2 place;         ///< of GO_TO
  std::string reason;  ///< for people
};

/// Turns spoken commands into actions. "stop" overrides everything and latches.
/// While latched, only stop, go, confirm and cancel do something, and speedLimit() is 0. GO releases the latch, or with
/// confirm_release asks for CONFIRM within confirm_timeout; STOP and CANCEL withdraw the question. A command that was
/// spoken before the last STOP releases nothing. Not thread safe; time comes in as numbers.
class CommandActions
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit CommandActions(const CommandActionsOptions& options);

  /// @param spoken_ns  when it was said, @param now_ns  now, on one clock.
  CommandResult hear(const std::string& text, double confidence, int64_t spoken_ns, int64_t now_ns);
  /// Latches as a spoken stop does (a button, a supervisor).
  void stop(int64_t now_ns);
  /// Ends the latch without a question: whoever calls this is no voice (a button, a supervisor).
  void release();
  /// As an earlier life left it. @param speed_limit  brought to [min_speed, max_speed]; not finite: max_speed.
  void restore(bool stopped, double speed_limit, int64_t now_ns);

  bool stopped() const { return stopped_; }
  /// 0 while latched [m/s].
  double speedLimit() const { return stopped_ ? 0.0 : speed_limit_; }
  /// Also while latched [m/s].
  double keptSpeedLimit() const { return speed_limit_; }

private:
  const CommandActionsOptions options_;
  bool stopped_ = false;
  int64_t stopped_ns_ = 0;
  bool asked_ = false;
  int64_t asked_ns_ = 0;
  double speed_limit_;
};

const char* toString(CommandAction action);
const char* toString(CommandOutcome outcome);

}  // namespace pi_vehicle
