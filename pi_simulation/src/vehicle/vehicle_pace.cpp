#include "vehicle/vehicle_pace.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>

namespace pi_simulation
{
namespace
{

constexpr size_t KEPT = 400;  ///< things of a kind: 2 s of IMU samples

}  // namespace

void PaceOptions::validate() const
{
  const pi_node::OptionCheck check("pace/");
  check.range("rendering", rendering, 0.001, 10.0);
  check.range("imu", imu, 0.02, 10.0);
  check.range("pictures", pictures, 0.05, 10.0);
  check.range("detection", detection, 0.05, 10.0);
  check.range("sound", sound, 0.05, 10.0);
  check.range("tick", tick, 0.015, 10.0);
  check.range("chassis", chassis, 0.03, 10.0);
}

VehiclePace::VehiclePace(const PaceOptions& options)
{
  options.validate();
  for (const auto& [kind, bound_s] : {std::pair<const char*, double>("rendering", options.rendering),
                                      {"imu", options.imu},
                                      {"pictures", options.pictures},
                                      {"detection", options.detection},
                                      {"sound", options.sound},
                                      {"tick", options.tick},
                                      {"chassis", options.chassis}})
  {
    bounds_ns_[kind] = pi_node::nanoseconds(bound_s);
  }
}

void VehiclePace::given(const std::string& kind, int64_t stamp_ns)
{
  std::deque<int64_t>& stamps = given_[kind];
  stamps.push_back(stamp_ns);
  if (stamps.size() > KEPT)
  {
    stamps.pop_front();
  }
}

void VehiclePace::answered(const std::string& kind, const std::string& who, int64_t stamp_ns)
{
  if (bounds_ns_.count(kind) > 0)
  {
    answers_[{kind, who}] = stamp_ns;
  }
}

std::optional<VehiclePace::Awaited> VehiclePace::awaited(int64_t now_ns) const
{
  for (const auto& [key, answered_ns] : answers_)
  {
    const std::optional<int64_t> open_ns = oldestUnanswered(key.first, answered_ns);
    if (open_ns && *open_ns + bounds_ns_.at(key.first) < now_ns)
    {
      return Awaited{key.first, key.second, answered_ns};
    }
  }
  return std::nullopt;
}

std::optional<int64_t> VehiclePace::oldestUnanswered(const std::string& kind, int64_t answered_ns) const
{
  const auto found = given_.find(kind);
  if (found == given_.end())
  {
    return answered_ns;
  }
  const std::deque<int64_t>& stamps = found->second;
  const auto open = std::upper_bound(stamps.begin(), stamps.end(), answered_ns);
  return open != stamps.end() ? std::optional(*open) : std::nullopt;
}

}  // namespace pi_simulation
