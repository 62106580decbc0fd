#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace pi_os_transport
{

// Names of nodes, topics, services and parameters, and their resolution, by the rules of Python's rosgraph.names.
// Nothing is validated.

/// @return the parts between slashes, without empty ones.
std::vector<std::string_view> nameParts(std::string_view name);
/// @return without repeated and trailing slashes: "/a//b/" becomes "/a/b".
std::string canonicalName(std::string_view name);
/// @return the namespace with a trailing slash: of "/a/b" it is "/a/".
std::string namespaceOf(std::string_view name);
/// @return `name` below `space`, or `name` itself if it is global or private.
std::string joinName(std::string_view space, std::string_view name);
/// @return the global name of `name` as used by `node`; private and relative names depend on the node.
std::string resolveName(std::string_view name, std::string_view node);

}  // namespace pi_os_transport
