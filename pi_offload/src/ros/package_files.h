#pragma once

#include <ros/package.h>

#include <filesystem>
#include <string>
#include <system_error>

namespace pi_offload
{

/// A file or folder in a package's share folder: in the install space of the running program, else as ROS finds the
/// package. Empty if it is in neither.
inline std::string packageFile(const std::string& package, const std::string& name)
{
  namespace fs = std::filesystem;
  std::error_code ignored;
  // PREFIX/lib/pi_offload/PROGRAM and PREFIX/share/PACKAGE
  const fs::path prefix = fs::read_symlink("/proc/self/exe", ignored).parent_path().parent_path().parent_path();
  const fs::path installed = prefix / "share" / package / name;
  if (fs::exists(installed, ignored))
  {
    return installed.string();
  }
  const std::string path = ros::package::getPath(package);
  return !path.empty() && fs::exists(fs::path(path) / name, ignored) ? path + "/" + name : "";
}

}  // namespace pi_offload
