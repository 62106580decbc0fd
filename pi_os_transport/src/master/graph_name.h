#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace pi_os_transport
{

/// Names of nodes, topics, services and parameters as ROS writes them, and how they resolve. The rules are those of
/// Python's rosgraph.names; nothing is checked, only put together.

/// @return the parts between slashes, without empty ones.
std::vector<std::string_view> nameParts(std::string_view name);
/// @return without repeated and trailing slashes: "/a//b/" becomes "/a/b".
std::string canonicalName(std::string_view name);
/// @return the namespace with a trailing slash: "/a/b" lies in "/a/".
std::string namespaceOf(std::string_view name);
/// @return `name` below `space`, or `name` itself if it is global or private.
std::string joinName(std::string_view space, std::string_view name);
/// @return the global name that `name` means for the node `node`: "~a" and relative names depend on it.
std::string resolveName(std::string_view name, std::string_view node);

}  // namespace pi_os_transport
