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

/// Acts when something with this label stays in this zone.
struct ReactionRule
{
  std::string name;
  std::string label;                     ///< "*": any, also things without a label
  std::vector<Eigen::Vector2d> polygon;  ///< zone in base_link, 3 corners or more [m]; empty: the range below
  double min_range = 0.0;                ///< from base_link's origin [m]
  double max_range = 0.0;                ///< [m]
  double max_bearing = M_PI;             ///< to either side of x, in (0, pi] [rad]
  double min_score = 0.0;                ///< in [0, 1]; networks differ in what a score means
  double persistence = 0.3;              ///< time in the zone before the rule acts [s]
  double gap = 0.3;                      ///< a thing that is unseen for longer is gone [s]
  double cooldown = 0.0;  ///< least time between two actions of GREET, HORN, SAY, which also act once per stay [s]
  double hold = 0.5;      ///< SLOW, STOP hold for this time after the last thing left [s]
  ReactionAction action = ReactionAction::SLOW;
  std::string text;    ///< of SAY; of GREET, empty: the usual greeting
  double speed = 0.0;  ///< of SLOW [m/s]
};

struct ReactionRulesOptions
{
  std::vector<ReactionRule> rules;

  /// @code{.yaml}
  /// rules:
  ///   - {name: passenger, label: person, range: [0.5, 3.0], bearing: 0.6, persistence: 1.0, cooldown: 20.0,
  ///      action: greet}
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
  SeenThing thing;  ///< that made the rule act, as seen last; of several the one with the smallest id
};

struct ReactionResult
{
  std::vector<RuleEvent> events;  ///< in the order of the rules; SLOW and STOP when they begin
  double speed_limit = 0.0;       ///< infinite: none [m/s]
  std::string reason;             ///< of the limit: the rule's name
};

/// Applies the rules; deterministic. Things are told apart by id. A stay ends when the thing loses the rule's label, or
/// leaves its zone, for longer than `gap`. Not thread safe.
class ReactionRules
{
public:
  /// @throws std::invalid_argument from options.validate().
  explicit ReactionRules(const ReactionRulesOptions& options);

  /// @param now_ns   must increase; a clock that goes back resets stays and cooldowns.
  /// @param things   seen at now_ns; those with numbers that are not finite are left out.
  ReactionResult update(int64_t now_ns, const std::vector<SeenThing>& things);

  /// Positions on the polygon's border may count as inside or outside.
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

  /// Begins or prolongs the stays of what is in the rule's zone.
  void notice(size_t index, const std::vector<SeenThing>& things, int64_t now_ns);
  void forgetGone(size_t index, int64_t now_ns);
  /// @return whether a thing has stayed for the rule's persistence.
  bool react(size_t index, int64_t now_ns, std::vector<RuleEvent>* events);

  const ReactionRulesOptions options_;
  std::vector<RuleState> states_;
  std::map<std::pair<size_t, int64_t>, bool> greeted_;  // things that a rule acted for, while they stay
  bool have_now_ = false;
  int64_t last_ns_ = 0;
};

const char* toString(ReactionAction action);

}  // namespace pi_vehicle
