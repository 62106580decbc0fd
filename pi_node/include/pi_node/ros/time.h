#pragma once

#include <ros/time.h>

#include <cstdint>
#include <stdexcept>
#include <string>

namespace pi_node
{

/// [ns]
inline int64_t fromMsg(const ros::Time& stamp)
{
  return static_cast<int64_t>(stamp.toNSec());
}

/// @throws std::invalid_argument if it is before 1970 or after 2106.
inline ros::Time toTime(int64_t stamp_ns)
{
  constexpr int64_t SECOND_NS = 1000000000;
  if (stamp_ns < 0 || stamp_ns / SECOND_NS > UINT32_MAX)
  {
    throw std::invalid_argument("stamp " + std::to_string(stamp_ns) + " ns does not fit into ros::Time");
  }
  return ros::Time(static_cast<uint32_t>(stamp_ns / SECOND_NS), static_cast<uint32_t>(stamp_ns % SECOND_NS));
}

}  // namespace pi_node
