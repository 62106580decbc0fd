#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "bridge/config/bridge_config.h"
#include "text_parsing.h"

namespace pi_os_transport
{

constexpr size_t MAX_NAME = 255;  ///< of a device [B]

/// A value and its place, for example "bridge.yaml:7: listen" or "--listen".
struct Setting
{
  std::string place;
  std::string value;

  [[noreturn]] void refuse(const std::string& allowed) const
  {
    throw std::runtime_error(place + " = \"" + value + "\", must be " + allowed);
  }
};

// Each reads a value, and calls Setting::refuse() if it is not valid.

template <typename Number>
Number parseWhole(const Setting& setting, Number lowest, Number highest)
{
  const std::optional<Number> number = parseNumber(setting.value, lowest, highest);
  if (!number)
  {
    setting.refuse("a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest));
  }
  return *number;
}

double parseRate(const Setting& setting);
bool parseSwitch(const Setting& setting);
/// @param allowed  describes the choices
std::string parseChoice(const Setting& setting, const std::vector<std::string>& choices, const std::string& allowed);
std::string parseDeviceName(const Setting& setting);
std::string parseSocketName(const Setting& setting);
Endpoint parseListen(const Setting& setting);
/// ADDRESS[:PORT] of a device; a host name is resolved.
Endpoint parseReachable(const Setting& setting, uint16_t default_port);
CIDR parseCIDR(const Setting& setting);
std::string parseMasterUri(const Setting& setting);

}  // namespace pi_os_transport
