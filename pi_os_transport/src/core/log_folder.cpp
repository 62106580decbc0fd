#include "core/log_folder.h"

#include <pwd.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace pi_os_transport
{
namespace
{

std::filesystem::path homeFolder()
{
  const char* const home = std::getenv("HOME");
  if (home != nullptr && *home != '\0')
  {
    return home;
  }
  const passwd* const user = getpwuid(getuid());
  return user != nullptr && user->pw_dir != nullptr ? user->pw_dir : "/";
}

/// A path from a variable; "~" is the home folder.
std::filesystem::path fromVariable(const char* name)
{
  const char* const value = std::getenv(name);
  if (value == nullptr || *value == '\0')
  {
    return {};
  }
  const std::string text = value;
  return text[0] == '~' ? homeFolder() / std::filesystem::path(text.substr(1)).relative_path()
                        : std::filesystem::path(text);
}

std::filesystem::path logRoot()
{
  std::filesystem::path folder = fromVariable("ROS_LOG_DIR");
  if (folder.empty())
  {
    folder = fromVariable("ROS_HOME");
    folder = (folder.empty() ? homeFolder() / ".ros" : folder) / "log";
  }
  return folder;
}

}  // namespace

std::string newRunId()
{
  std::ifstream source("/proc/sys/kernel/random/uuid");
  std::string id;
  if (!(source >> id))
  {
    throw std::runtime_error("/proc/sys/kernel/random/uuid cannot be read: is /proc mounted?");
  }
  return id;
}

std::string makeLogFolder(const std::string& run_id)
{
  const std::filesystem::path root = logRoot();
  const std::filesystem::path folder = root / run_id;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error)
  {
    throw std::runtime_error("cannot make the log folder " + folder.string() + ": " + error.message() +
                             "; set ROS_LOG_DIR to a folder that can be written to");
  }
  // The link is only for convenience: failure is ignored.
  const std::filesystem::path latest = root / "latest";
  if (std::filesystem::is_symlink(latest, error) || !std::filesystem::exists(latest, error))
  {
    std::filesystem::remove(latest, error);
    std::filesystem::create_directory_symlink(folder, latest, error);
  }
  return folder.string();
}

}  // namespace pi_os_transport
