#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pi_vehicle
{

enum class CommandAction
{
  STOP,     ///< latches
  GO,       ///< releases the latch; else: drive on
  CONFIRM,  ///< "yes" to a question
  CANCEL,   ///< "no" to a question
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
  std::string argument;  ///< GO_TO: the place; SAY: what; else empty
};

struct CommandActionsOptions
{
  bool confirm_release = false;  ///< a latched stop ends only by GO and then CONFIRM
  double confirm_timeout = 5.0;  ///< [s] for the CONFIRM
  double doubt_speed = 0.6;      ///< bound after a doubtful STOP [m/s]
  double doubt_timeout = 4.0;    ///< how long it holds unless somebody answers [s]
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
  ///   - {text: stop, action: stop}
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
  visit("doubt_speed", o.doubt_speed);
  visit("doubt_timeout", o.doubt_timeout);
  visit("max_age", o.max_age);
  visit("max_speed", o.max_speed);
  visit("min_speed", o.min_speed);
  visit("speed_step", o.speed_step);
}

enum class CommandOutcome
{
  DONE,                   ///< `action` is to be carried out
  AWAITS_CONFIRMATION,    ///< a release, or a doubtful STOP, that needs CONFIRM
  IGNORED_UNKNOWN,        ///< the text is not in the table
  IGNORED_DOUBTFUL,       ///< perhaps said, but no STOP, or standing
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

/// Turns spoken commands into actions. STOP always acts, and latches.
/// While latched, only STOP, GO, CONFIRM and CANCEL act, and speedLimit() is 0. GO releases the latch, or with
/// confirm_release asks for CONFIRM within confirm_timeout; STOP and CANCEL withdraw the question. A command that was
/// spoken before the last STOP releases nothing.
/// A STOP that was perhaps said bounds the speed to doubt_speed and asks: a second one, or CONFIRM, within
/// doubt_timeout stops; CANCEL, GO, or no answer in that time ends the doubt. A false STOP costs little so, a missed
/// one much. Whether something was said, surely or perhaps, is the recogniser's decision. Not thread safe.
class CommandActions
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit CommandActions(const CommandActionsOptions& options);

  /// @param spoken_ns  when it was said, @param now_ns  now, on one clock.
  CommandResult hear(const std::string& text, int64_t spoken_ns, int64_t now_ns);
  /// What was perhaps said. @param moving  whether the vehicle does.
  CommandResult hearDoubtful(const std::string& text, bool moving, int64_t spoken_ns, int64_t now_ns);
  /// Latches like a spoken stop; for a button or a supervisor.
  void stop(int64_t now_ns);
  /// Ends the latch without a question: for callers other than the speech recogniser, for example a service.
  void release();
  /// Restores the state of an earlier run. @param speed_limit  is clamped to [min_speed, max_speed]; not finite:
  /// max_speed.
  void restore(bool stopped, double speed_limit, int64_t now_ns);

  bool stopped() const { return stopped_; }
  /// Whether a doubtful STOP waits for an answer.
  bool doubted(int64_t now_ns) const;
  /// 0 while latched [m/s].
  double speedLimit(int64_t now_ns) const;
  /// Also while latched or in doubt [m/s].
  double keptSpeedLimit() const { return speed_limit_; }

private:
  using Outcome = std::pair<CommandOutcome, std::string>;  // with the detail of the reason

  std::vector<SpokenCommand>::const_iterator find(const std::string& text, CommandResult* result) const;
  Outcome execute(const SpokenCommand& command, int64_t spoken_ns, int64_t now_ns);
  /// GO, CONFIRM and CANCEL.
  Outcome answerQuestion(CommandAction action, int64_t spoken_ns, int64_t now_ns);

  const CommandActionsOptions options_;
  bool stopped_ = false;
  int64_t stopped_ns_ = 0;
  bool asked_ = false;
  int64_t asked_ns_ = 0;
  std::optional<int64_t> doubt_ns_;  ///< when a doubtful STOP was heard
  int64_t doubtful_spoken_ns_ = 0;   ///< when it was said
  double speed_limit_;
};

const char* toString(CommandAction action);
const char* toString(CommandOutcome outcome);

}  // namespace pi_vehicle
