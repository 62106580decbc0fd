#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace pi_simulation
{

/// What the vehicle is to work off, and by how much simulated time it may be behind with it [s].
struct PaceOptions
{
  double rendering = 0.04;  ///< pictures, until they are published
  double imu = 0.03;        ///< samples, by the odometry
  double pictures = 0.15;   ///< stereo pairs, by localisation and obstacles
  double detection = 0.4;   ///< pictures, by the detector
  double sound = 0.1;       ///< by the recogniser
  double tick = 0.02;       ///< beyond the end of the next period, of what works in periods
  double chassis = 0.06;    ///< commands on the chassis's line: at most every 0.05 s

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// How far a simulation may go on: not farther ahead of the vehicle's answers than the options say. Whoever has
/// answered is waited for from then on, until forget(). Not thread safe. Times are simulated [ns].
class VehiclePace
{
public:
  explicit VehiclePace(const PaceOptions& options);

  /// The vehicle got something of a kind that is named in the options.
  void given(const std::string& kind, int64_t stamp_ns);
  /// Someone has worked off all of a kind up to this time, or needs none before. The last answer counts, also an
  /// earlier time. @param who  "SERVICE NODE"
  void answered(const std::string& kind, const std::string& who, int64_t stamp_ns);
  /// Nobody is waited for until he answers again: somebody has died.
  void forget() { answers_.clear(); }
  /// The same for one.
  void forget(const std::string& kind, const std::string& who) { answers_.erase({kind, who}); }

  struct Awaited
  {
    std::string kind;
    std::string who;
    int64_t answered_ns = 0;  ///< its last answer
  };
  /// @return who has to answer before the simulation reaches this time; nobody: it may go on.
  std::optional<Awaited> awaited(int64_t now_ns) const;

private:
  std::optional<int64_t> oldestUnanswered(const std::string& kind, int64_t answered_ns) const;

  std::map<std::string, int64_t> bounds_ns_;
  std::map<std::string, std::deque<int64_t>> given_;  ///< the last ones of each kind; none: given all the time
  std::map<std::pair<std::string, std::string>, int64_t> answers_;
};

}  // namespace pi_simulation
