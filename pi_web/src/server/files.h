#pragma once

#include "server/web_server.h"

#include <map>
#include <string>
#include <vector>

namespace pi_web
{

/// The page's files by their path, "/" being index.html. @throws std::runtime_error if there is none.
std::map<std::string, WebFile> pageFiles(const std::string& folder);

/// Where a package lies, by ROS_PACKAGE_PATH and /usr/share; "" if nowhere. (rospack would bring Python's interpreter.)
std::string packageFolder(const std::string& name);

/// The content of package://NAME/PATH: a description of a robot or its meshes, at most 16 MB.
/// @throws std::invalid_argument naming uri and rule, also for a path that leads out of the package.
std::string assetOf(const std::string& uri);

/// Path of a recorder's incident by the name that incidentsJson() tells; "" for all other names.
std::string incidentFile(const std::string& folder, const std::string& name);

/// The recorder's incidents as JSON, newest first: [{"file", "time", "cause", "megabytes"}].
std::string incidentsJson(const std::string& folder);

/// With ~ replaced by the user's home.
std::string expanded(const std::string& path);

}  // namespace pi_web
