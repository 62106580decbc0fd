#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace pi_vehicle
{

enum class ReactionAction
{
  GREET,  ///< once
  HORN,   ///< once
  SAY,    ///< once, with a text
  SLOW,   ///< as long as it holds: bounds the speed
  STOP    ///< as long as it holds: speed 0
};

/// If something with this label is in this zone for so long, then do that.
struct ReactionRule
{
  std::string name;
  std::string label;                     ///< "*": any, also things without a label
  std::vector<Eigen::Vector2d> polygon;  ///< zone in base_link, 3 corners or more [m]; empty: the range below
  double min_range = 0.0;                ///< from base_link's origin [m]
  double max_range = 0.0;                ///< [m]
  double max_bearing = M_PI;             ///< to either side of x, in (0, pi] [rad]
  double min_score = 0.5;                ///< in [0, 1]
  double persistence = 0.3;              ///< in the zone for so long, before it acts [s]
  double gap = 0.3;                      ///< unseen for so long does not count as gone [s]
  double cooldown =
      0.0;  ///< not again so soon, for nothing: GREET, HORN, SAY; in any case once per thing while it stays [s]
  double hold = 0.5;  ///< SLOW, STOP: kept for so long after the last thing left [s]
  ReactionAction action = ReactionAction::SLOW;
  std::string text;    ///< of SAY; of GREET, empty: the usual greeting
  double speed = 0.0;  ///< of SLOW [m/s]
};

struct ReactionRulesOptions
{
  std::vector<ReactionRule> rules;

  /// @code{.yaml}
  /// rules:
  ///   - {name: passenger, label: person, range: [0.5, 3.0], bearing: 0.6, min_score: 0.6, persistence: 1.0,
  ///      cooldown: 20.0, action: greet}
  ///   - {name: child ahead, label: person, polygon: [[0, -1], [4, -1], [4, 1], [0, 1]], action: slow, speed: 0.8}
  /// @endcode
  /// @throws std::invalid_argument naming rule, field, value and bound.
  static ReactionRulesOptions load(const std::string& path);
  static ReactionRulesOptions parse(const std::string& yaml, const std::string& name);
  void validate() const;
};

/// Something seen, on the ground plane in base_link.
struct SeenThing
{
  int64_t id = 0;                                      ///< stays with the thing
  std::string label;                                   ///< empty: none
  double score = 0.0;                                  ///< of the label
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
};

/// A rule that begins to act.
struct RuleEvent
{
  std::string rule;
  ReactionAction action = ReactionAction::GREET;
  std::string text;
  SeenThing thing;  ///< the one that made it act, as seen last: of several the one with the smallest id
};

struct ReactionResult
{
  std::vector<RuleEvent> events;  ///< in the order of the rules; SLOW and STOP when they begin
  double speed_limit = 0.0;       ///< infinite: none [m/s]
  std::string reason;             ///< of the limit: the rule's name
};

/// Runs the rules. Deterministic: the same calls give the same results. Things are told apart by id; one that changes
/// its label below a rule, or leaves its zone, for longer than `gap` begins anew. Not thread safe.
class ReactionRules
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit ReactionRules(const ReactionRulesOptions& options);

  /// @param now_ns   newer from call to call; a clock that goes back forgets all that was seen (cooldowns too).
  /// @param things   seen at now_ns; those with odd numbers are left out.
  ReactionResult update(int64_t now_ns, const std::vector<SeenThing>& things);

  /// Is the position in the rule's zone? The polygon's border counts as either.
  static bool inZone(const ReactionRule& rule, const Eigen::Vector2d& position);

private:
  struct Stay
  {
    int64_t since_ns;
    int64_t last_ns;
    SeenThing thing;  // as seen last
  };
  struct RuleState
  {
    std::map<int64_t, Stay> stays;  // by id
    bool active = false;
    bool acted = false;
    int64_t acted_ns = 0;
    int64_t held_ns = 0;
  };

  const ReactionRulesOptions options_;
  std::vector<RuleState> states_;
  std::map<std::pair<size_t, int64_t>, bool> greeted_;  // things that a rule acted for, while they stay
  bool have_now_ = false;
  int64_t last_ns_ = 0;
};

const char* toString(ReactionAction action);

}  // namespace pi_vehicle
