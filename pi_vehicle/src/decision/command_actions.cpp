#include "decision/command_actions.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_node/yaml_section.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace pi_vehicle
{

using pi_node::seconds;

namespace
{

/// In the order of CommandAction.
constexpr const char* COMMAND_ACTIONS[] = {"stop", "go",    "confirm", "cancel", "slower", "faster",
                                           "left", "right", "go_to",   "say",    "horn"};

CommandActionsOptions readActions(pi_node::YamlSection top)
{
  CommandActionsOptions options;
  if (top.has("options"))
  {
    top.section("options").readFields(&options);
  }
  if (top.has("places"))
  {
    pi_node::YamlSection places = top.section("places");
    for (const auto& entry : top.node("places"))
    {
      const auto name = entry.first.as<std::string>();
      const auto numbers = places.get<std::vector<double>>(name, "[x, y, heading]");
      if (numbers.size() != 3)
      {
        places.refuse(name, std::to_string(numbers.size()) + " numbers", "[x, y, heading]");
      }
      options.places[name] = {numbers[0], numbers[1], numbers[2]};
    }
  }
  for (pi_node::YamlSection& entry : top.list("commands"))
  {
    SpokenCommand command;
    command.text = entry.get<std::string>("text", "a text");
    const auto action = entry.get<std::string>("action", "an action");
    const auto* known = std::find(std::begin(COMMAND_ACTIONS), std::end(COMMAND_ACTIONS), action);
    if (known == std::end(COMMAND_ACTIONS))
    {
      std::string list = COMMAND_ACTIONS[0];
      std::for_each(std::begin(COMMAND_ACTIONS) + 1, std::end(COMMAND_ACTIONS),
                    [&list](const char* one) { list += std::string(", ") + one; });
      entry.refuse("action", "\"" + action + "\"", "one of " + list);
    }
    command.action = static_cast<CommandAction>(known - COMMAND_ACTIONS);
    entry.read("argument", "a text", &command.argument);
    entry.finish();
    options.commands.push_back(command);
  }
  return top.checked(options);
}

}  // namespace

CommandActionsOptions CommandActionsOptions::load(const std::string& path)
{
  return readActions(pi_node::YamlSection::load(path));
}

CommandActionsOptions CommandActionsOptions::parse(const std::string& yaml, const std::string& name)
{
  return readActions(pi_node::YamlSection::parse(yaml, name));
}

void CommandActionsOptions::validate() const
{
  const pi_node::OptionCheck check("options");
  check.range("confirm_timeout", confirm_timeout, 0.5, 60.0);
  check.range("doubt_speed", doubt_speed, 0.0, max_speed);
  check.range("doubt_timeout", doubt_timeout, 0.5, 60.0);
  check.range("max_age", max_age, 0.05, 60.0);
  check.range("max_speed", max_speed, 0.05, 10.0);
  check.range("min_speed", min_speed, 0.05, max_speed);
  check.range("speed_step", speed_step, 0.01, max_speed);
  for (const auto& [name, pose] : places)
  {
    if (!pose.finite())
    {
      throw std::invalid_argument("places/" + name + " is not finite, must be three numbers");
    }
  }
  const auto has = [this](CommandAction action)
  {
    return std::any_of(commands.begin(), commands.end(),
                       [action](const SpokenCommand& command) { return command.action == action; });
  };
  for (size_t i = 0; i < commands.size(); ++i)
  {
    const SpokenCommand& command = commands[i];
    const std::string name = "commands/" + command.text;
    if (command.text.empty())
    {
      throw std::invalid_argument("commands/" + std::to_string(i) + "/text is empty, must be words");
    }
    if (std::any_of(commands.begin(), commands.begin() + static_cast<std::ptrdiff_t>(i),
                    [&command](const SpokenCommand& other) { return other.text == command.text; }))
    {
      throw std::invalid_argument(name + " is there twice, must be once");
    }
    const bool wants_argument = command.action == CommandAction::GO_TO || command.action == CommandAction::SAY;
    if (wants_argument == command.argument.empty())
    {
      throw std::invalid_argument(name + "/argument = \"" + command.argument + "\", must be " +
                                  (wants_argument ? "given for " : "left out for ") + toString(command.action));
    }
    if (command.action == CommandAction::GO_TO && places.count(command.argument) == 0)
    {
      throw std::invalid_argument(name + "/argument = \"" + command.argument + "\", must be one of places");
    }
  }
  for (const CommandAction action : {CommandAction::STOP, CommandAction::GO})
  {
    if (!has(action))
    {
      throw std::invalid_argument(std::string("commands has no action ") + toString(action) + ", must have one");
    }
  }
  if (confirm_release && !has(CommandAction::CONFIRM))
  {
    throw std::invalid_argument("commands has no action confirm, must have one for confirm_release");
  }
}

CommandActions::CommandActions(const CommandActionsOptions& options)
  : options_(options), speed_limit_(options.max_speed)
{
  options_.validate();
}

void CommandActions::stop(int64_t now_ns)
{
  stopped_ = true;
  stopped_ns_ = now_ns;
  asked_ = false;
  doubt_ns_.reset();
}

void CommandActions::release()
{
  stopped_ = false;
  asked_ = false;
  doubt_ns_.reset();
}

bool CommandActions::doubted(int64_t now_ns) const
{
  const double age = doubt_ns_ ? seconds(now_ns - *doubt_ns_) : -1.0;
  return age >= 0.0 && age <= options_.doubt_timeout;
}

double CommandActions::speedLimit(int64_t now_ns) const
{
  if (stopped_)
  {
    return 0.0;
  }
  return doubted(now_ns) ? std::min(options_.doubt_speed, speed_limit_) : speed_limit_;
}

void CommandActions::restore(bool stopped, double speed_limit, int64_t now_ns)
{
  speed_limit_ =
      std::isfinite(speed_limit) ? std::clamp(speed_limit, options_.min_speed, options_.max_speed) : options_.max_speed;
  stopped_ = stopped;
  stopped_ns_ = now_ns;
  asked_ = false;
  doubt_ns_.reset();
}

std::vector<SpokenCommand>::const_iterator CommandActions::find(const std::string& text, CommandResult* result) const
{
  const auto command = std::find_if(options_.commands.begin(), options_.commands.end(),
                                    [&text](const SpokenCommand& one) { return one.text == text; });
  if (command == options_.commands.end())
  {
    result->outcome = CommandOutcome::IGNORED_UNKNOWN;
    result->reason = "\"" + text + "\" is not in the table of commands";
    return command;
  }
  result->action = command->action;
  result->argument = command->argument;
  return command;
}

CommandResult CommandActions::hear(const std::string& text, int64_t spoken_ns, int64_t now_ns)
{
  CommandResult result;
  const auto command = find(text, &result);
  if (command == options_.commands.end())
  {
    return result;
  }
  std::string detail;
  std::tie(result.outcome, detail) = execute(*command, spoken_ns, now_ns);
  result.reason = "\"" + text + "\"" + detail;
  if (result.outcome == CommandOutcome::DONE && command->action == CommandAction::GO_TO)
  {
    result.place = options_.places.at(command->argument);
  }
  return result;
}

CommandResult CommandActions::hearDoubtful(const std::string& text, bool moving, int64_t spoken_ns, int64_t now_ns)
{
  CommandResult result;
  if (find(text, &result) == options_.commands.end())
  {
    return result;
  }
  result.reason = "perhaps \"" + text + "\"";
  if (result.action != CommandAction::STOP || stopped_ || !moving)
  {
    result.outcome = CommandOutcome::IGNORED_DOUBTFUL;
    result.reason += result.action != CommandAction::STOP ? ": say it again"
                     : stopped_                           ? ", but it is stopped"
                                                          : ", but the vehicle stands";
  }
  else if (doubted(now_ns) && spoken_ns > doubtful_spoken_ns_)
  {
    stop(std::max(spoken_ns, now_ns));
    result.outcome = CommandOutcome::DONE;
    result.reason += " twice: stopped until released";
  }
  else
  {
    doubt_ns_ = now_ns;
    doubtful_spoken_ns_ = spoken_ns;
    result.outcome = CommandOutcome::AWAITS_CONFIRMATION;
    result.reason += ": slower until it is confirmed or denied";
  }
  return result;
}

CommandActions::Outcome CommandActions::execute(const SpokenCommand& command, int64_t spoken_ns, int64_t now_ns)
{
  if (command.action == CommandAction::STOP)
  {
    stop(std::max(spoken_ns, now_ns));  // whatever its stamp: a late stop is still a stop
    return {CommandOutcome::DONE, ": stopped until released"};
  }
  const double age = seconds(now_ns - spoken_ns);
  const bool before_stop = stopped_ && spoken_ns < stopped_ns_ && now_ns >= stopped_ns_;
  if (age > options_.max_age || age < -options_.max_age || before_stop)
  {
    return {CommandOutcome::IGNORED_OLD, " was said too long ago, or before the stop"};
  }
  const double asked_age = seconds(now_ns - asked_ns_);
  if (asked_ && (asked_age > options_.confirm_timeout || asked_age < 0.0))
  {
    asked_ = false;
  }
  switch (command.action)
  {
    case CommandAction::GO:
    case CommandAction::CONFIRM:
    case CommandAction::CANCEL:
      return answerQuestion(command.action, spoken_ns, now_ns);
    default:
      break;
  }
  if (stopped_)
  {
    return {CommandOutcome::IGNORED_STOPPED, ", but stopped: release it first"};
  }
  if (command.action == CommandAction::SLOWER)
  {
    speed_limit_ = std::max(options_.min_speed, speed_limit_ - options_.speed_step);
  }
  else if (command.action == CommandAction::FASTER)
  {
    speed_limit_ = std::min(options_.max_speed, speed_limit_ + options_.speed_step);
  }
  return {CommandOutcome::DONE, ""};
}

CommandActions::Outcome CommandActions::answerQuestion(CommandAction action, int64_t spoken_ns, int64_t now_ns)
{
  if (doubted(now_ns) && spoken_ns > doubtful_spoken_ns_)
  {
    if (action == CommandAction::CONFIRM)
    {
      stop(std::max(spoken_ns, now_ns));
      return {CommandOutcome::DONE, ": stopped until released"};
    }
    doubt_ns_.reset();
    return {CommandOutcome::DONE, ": goes on"};
  }
  if (action == CommandAction::GO)
  {
    if (stopped_ && options_.confirm_release)
    {
      asked_ = true;
      asked_ns_ = now_ns;
      return {CommandOutcome::AWAITS_CONFIRMATION, ": confirm to go on"};
    }
    stopped_ = false;
    return {CommandOutcome::DONE, ""};
  }
  if (!asked_ || (action == CommandAction::CONFIRM && spoken_ns < asked_ns_))
  {
    return {CommandOutcome::IGNORED_OUT_OF_CONTEXT, ", but nothing was asked"};
  }
  asked_ = false;
  if (action == CommandAction::CANCEL)
  {
    return {CommandOutcome::DONE, ": stays stopped"};
  }
  stopped_ = false;
  return {CommandOutcome::DONE, ": released"};
}

const char* toString(CommandAction action)
{
  return COMMAND_ACTIONS[static_cast<size_t>(action)];
}

const char* toString(CommandOutcome outcome)
{
  static constexpr const char* NAMES[] = {
      "done",         "awaits confirmation", "ignored: unknown",       "ignored: doubtful",
      "ignored: old", "ignored: stopped",    "ignored: out of context"};
  return NAMES[static_cast<size_t>(outcome)];
}

}  // namespace pi_vehicle
