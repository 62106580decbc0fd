#include "engine/node.h"

#include <pi_node/option_check.h>

#include <cctype>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "wire/socket_tools.h"

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

bool validAddress(const std::string& address)
{
  try
  {
    return parseHostPort("address", address).host.find_first_of(" \t\r\n/[]") == std::string::npos;
  }
  catch (const std::invalid_argument&)
  {
    return false;
  }
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
