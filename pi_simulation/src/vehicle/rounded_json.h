#pragma once

#include <pi_vehicle/decision/pose2.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

/// JSON with numbers of at most four decimals: logs stay short. Numbers that are not finite become null.
namespace pi_simulation
{

using Json = nlohmann::ordered_json;

inline double rounded(double value)
{
  return std::round(value * 1e4) / 1e4;
}

inline Json toJson(const Eigen::Vector2d& point)
{
  return {rounded(point.x()), rounded(point.y())};
}

inline Json toJson(const pi_vehicle::Pose2& pose)
{
  return {rounded(pose.x), rounded(pose.y), rounded(pose.heading)};
}

/// One line. Bytes that are no UTF-8 are replaced.
inline std::string toLine(const Json& value)
{
  return value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace pi_simulation
