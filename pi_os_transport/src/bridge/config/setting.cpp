#include "bridge/config/setting.h"

#include <ifaddrs.h>
#include <net/if.h>

#include <algorithm>
#include <cctype>
#include <memory>

#include "master/network_address.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr double MAX_RATE_HZ = 1e6;
constexpr size_t MAX_SOCKET_NAME = 64;  // an abstract address holds 107 bytes, user id and prefix included

/// First IPv4 address of a network interface.
std::optional<std::string> interfaceAddress(const std::string& name)
{
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0)
  {
    return std::nullopt;
  }
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next)
  {
    if (entry->ifa_addr != nullptr && entry->ifa_addr->sa_family == AF_INET && name == entry->ifa_name)
    {
      return addressText(*reinterpret_cast<const sockaddr_in*>(entry->ifa_addr));
    }
  }
  return std::nullopt;
}

/// ADDRESS[:PORT]; the address is not resolved.
Endpoint splitEndpoint(const Setting& setting, uint16_t default_port, uint16_t lowest_port)
{
  Endpoint endpoint{setting.value, default_port};
  const size_t colon = setting.value.rfind(':');
  if (colon != std::string::npos)
  {
    endpoint.address = setting.value.substr(0, colon);
    const auto port = parseNumber<uint16_t>(setting.value.substr(colon + 1), lowest_port, 65535);
    if (!port)
    {
      setting.refuse("ADDRESS[:PORT] with a port from " + std::to_string(lowest_port) + " to 65535");
    }
    endpoint.port = *port;
  }
  if (endpoint.address.empty() || endpoint.address.find(':') != std::string::npos)
  {
    setting.refuse("ADDRESS[:PORT] with an IPv4 address or a name");
  }
  return endpoint;
}

/// Replaces a name by the address that `find` gives.
void resolve(const Setting& setting, std::optional<std::string> (*find)(const std::string& name),
             const std::string& expected, Endpoint* endpoint)
{
  if (!parseIpv4(endpoint->address))
  {
    const std::optional<std::string> found = find(endpoint->address);
    if (!found)
    {
      setting.refuse("ADDRESS[:PORT], where ADDRESS is an IPv4 address or " + expected);
    }
    endpoint->address = *found;
  }
}

}  // namespace

double parseRate(const Setting& setting)
{
  const std::optional<double> rate = parseNumber(setting.value, 0.0, MAX_RATE_HZ);
  if (!rate)
  {
    setting.refuse("a number from 0 (no limit) to 1000000 [1/s]");
  }
  return *rate;
}

bool parseSwitch(const Setting& setting)
{
  if (setting.value != "true" && setting.value != "false")
  {
    setting.refuse("true or false");
  }
  return setting.value == "true";
}

std::string parseChoice(const Setting& setting, const std::vector<std::string>& choices, const std::string& allowed)
{
  if (std::find(choices.begin(), choices.end(), setting.value) == choices.end())
  {
    setting.refuse(allowed);
  }
  return setting.value;
}

std::string parseDeviceName(const Setting& setting)
{
  const auto unprintable = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
  if (setting.value.empty() || setting.value.size() > MAX_NAME ||
      std::any_of(setting.value.begin(), setting.value.end(), unprintable))
  {
    setting.refuse("1 to 255 printable characters");
  }
  return setting.value;
}

std::string parseSocketName(const Setting& setting)
{
  const auto usable = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.'; };
  if (setting.value.empty() || setting.value.size() > MAX_SOCKET_NAME || setting.value == "0" ||
      !std::all_of(setting.value.begin(), setting.value.end(), usable))
  {
    setting.refuse("1 to 64 letters, digits, '_', '-' or '.', and not \"0\", which switches the bridge off in a node");
  }
  return setting.value;
}

Endpoint parseListen(const Setting& setting)
{
  Endpoint endpoint = splitEndpoint(setting, BRIDGE_PORT, 0);
  resolve(setting, interfaceAddress, "an interface of this device that has one", &endpoint);
  return endpoint;
}

Endpoint parseReachable(const Setting& setting, uint16_t default_port)
{
  Endpoint endpoint = splitEndpoint(setting, default_port, 1);
  resolve(setting, hostAddress, "a host name that can be resolved now", &endpoint);
  if (*parseIpv4(endpoint.address) == INADDR_ANY)
  {
    setting.refuse("the address of one device");
  }
  return endpoint;
}

CIDR parseCIDR(const Setting& setting)
{
  const char* const allowed = "an IPv4 address, or a range like 192.168.1.0/24";
  const size_t slash = setting.value.find('/');
  const std::optional<uint32_t> address = parseIpv4(setting.value.substr(0, slash));
  if (!address)
  {
    setting.refuse(allowed);
  }
  CIDR range{*address, 32};
  if (slash != std::string::npos)
  {
    const std::optional<int> prefix = parseNumber(setting.value.substr(slash + 1), 0, 32);
    if (!prefix)
    {
      setting.refuse(allowed);
    }
    range.prefix = *prefix;
  }
  range.network &= range.prefix == 0 ? 0 : ~uint32_t{0} << (32 - range.prefix);
  return range;
}

std::string parseMasterUri(const Setting& setting)
{
  try
  {
    if (!setting.value.empty())
    {
      parseHttpUri(setting.value);
    }
  }
  catch (const std::invalid_argument&)
  {
    setting.refuse("the URI of a ROS master like http://192.168.1.10:11311, or \"\" for ROS_MASTER_URI");
  }
  return setting.value;
}

}  // namespace pi_os_transport
