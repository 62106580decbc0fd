#include "engine/node.h"
#include <pi_node/option_check.h>

#include <cctype>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_offload
{

namespace
{

constexpr size_t LONGEST_ID = 64;

bool validId(const std::string& id)
{
  if (id.empty() || id.size() > LONGEST_ID)
  {
    return false;
  }
  for (const char c : id)
  {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-' && c != '.')
    {
      return false;
    }
  }
  return true;
}

/// host:port, where an IPv6 host stands in brackets.
bool validAddress(const std::string& address)
{
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0 || address.size() - colon - 1 > 5 || colon + 1 == address.size())
  {
    return false;
  }
  const std::string host = address.substr(0, colon);
  const bool bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if ((!bracketed && host.find_first_of(":[]") != std::string::npos) ||
      host.find_first_of(" \t\r\n/") != std::string::npos)
  {
    return false;
  }
  int port = 0;
  for (size_t i = colon + 1; i < address.size(); ++i)
  {
    if (std::isdigit(static_cast<unsigned char>(address[i])) == 0)
    {
      return false;
    }
    port = port * 10 + (address[i] - '0');
  }
  return port >= 1 && port <= 65535;
}

}  // namespace

const char* toString(TaskKind kind)
{
  switch (kind)
  {
    case TaskKind::DETECTION:
      return "detection";
    case TaskKind::SPEECH:
      return "speech";
  }
  return "unknown";
}

TaskKind parseTaskKind(const std::string& text)
{
  for (size_t i = 0; i < TASK_KINDS; ++i)
  {
    const auto kind = static_cast<TaskKind>(i);
    if (text == toString(kind))
    {
      return kind;
    }
  }
  throw std::invalid_argument("task kind \"" + text + "\" is not known, must be detection or speech");
}

void NodeDescription::validate() const
{
  if (!validId(id))
  {
    throw std::invalid_argument("node id \"" + id + "\" must be 1 to " + std::to_string(LONGEST_ID) +
                                " letters, digits, '_', '-' or '.'");
  }
  const std::string name = "node " + id;
  if (!address.empty() && !validAddress(address))
  {
    throw std::invalid_argument(name + "/address = \"" + address + "\", must be host:port, port in [1, 65535]");
  }
  if (!std::isfinite(position.x) || !std::isfinite(position.y))
  {
    throw std::invalid_argument(name + "/position = (" + std::to_string(position.x) + ", " +
                                std::to_string(position.y) + "), must be finite");
  }
  const pi_node::OptionCheck check(name);
  check.range("range_m", range_m, 0.0, std::numeric_limits<double>::infinity());
  check.positive("frequency_ghz", frequency_ghz);
  check.range("capacity_gcycles", capacity_gcycles, 0.0, 1e12);
}

}  // namespace pi_offload
