#pragma once

#include "graph/graph_reader.h"

#include <map>
#include <optional>
#include <string>

namespace pi_web
{

/// Types that clients publish, or that are wanted before somebody publishes them.
std::map<std::string, MessageType> knownTypes();

struct ServiceSchema
{
  std::string request;
  std::string response;
};
/// Of std_srvs; nodes tell nobody how their services' messages are laid out.
std::optional<ServiceSchema> knownService(const std::string& type);

}  // namespace pi_web
