#pragma once

#include <pi_speech/command_recognizer.h>
#include <ros/package.h>

#include <filesystem>
#include <string>
#include <system_error>

namespace pi_speech
{

/// This package's config folder: that of the install space that the running program is in, else where ROS's environment
/// knows the package. Empty if neither.
inline const std::string& configFolder()
{
  static const std::string folder = []() -> std::string
  {
    namespace fs = std::filesystem;
    std::error_code ignored;
    // PREFIX/lib/pi_speech/PROGRAM and PREFIX/share/pi_speech/config
    const fs::path prefix = fs::read_symlink("/proc/self/exe", ignored).parent_path().parent_path().parent_path();
    const fs::path installed = prefix / "share" / "pi_speech" / "config";
    if (fs::is_directory(installed, ignored))
    {
      return installed.string();
    }
    const std::string package = ros::package::getPath("pi_speech");
    return package.empty() ? "" : package + "/config";
  }();
  return folder;
}

/// A file of that folder, such as "commands.yaml". Empty if there is none.
inline std::string packageFile(const std::string& name)
{
  std::error_code ignored;
  const std::string file = configFolder() + "/" + name;
  return !configFolder().empty() && std::filesystem::exists(file, ignored) ? file : "";
}

/// The options with this package's models; without a network where the package has none.
inline RecognizerOptions withDefaultModels(RecognizerOptions options = {})
{
  options.word_network = packageFile("word_network.bin");
  options.garbage_words = packageFile("garbage_words.txt");
  options.confidence = packageFile("confidence.yaml");
  options.sphinx.adaptation = packageFile("adaptation");
  return options;
}

}  // namespace pi_speech
