#include "audio/sound_files.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>
#include <system_error>

namespace pi_speech
{
namespace
{

namespace fs = std::filesystem;

std::string extension(const fs::path& path)
{
  std::string end = path.extension().string();
  std::transform(end.begin(), end.end(), end.begin(), [](unsigned char c) { return std::tolower(c); });
  return end;
}

std::vector<std::string> filesOfFolder(const std::string& folder)
{
  static const std::set<std::string> SOUNDS = {".wav", ".flac", ".ogg", ".oga", ".aif", ".aiff", ".au", ".mp3", ".raw"};
  std::vector<std::string> files;
  std::error_code error;
  for (fs::directory_iterator file(folder, error), end; !error && file != end; file.increment(error))
  {
    if (SOUNDS.count(extension(file->path())) > 0)
    {
      files.push_back(file->path().string());
    }
  }
  if (error)
  {
    throw std::runtime_error("folder " + folder + " cannot be read: " + error.message());
  }
  if (files.empty())
  {
    throw std::runtime_error("folder " + folder + " has no sound file, such as .wav or .flac");
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::string> filesOfList(const std::string& list)
{
  std::ifstream stream(list);
  if (!stream)
  {
    throw std::runtime_error("list " + list + " cannot be read: " + std::strerror(errno));
  }
  const bool columns = extension(list) == ".tsv";
  std::vector<std::string> files;
  std::string line;
  for (bool first = true; std::getline(stream, line); first = false)
  {
    line.erase(line.find_last_not_of(" \t\r") + 1);
    const std::string file = columns ? line.substr(0, line.find('\t')) : line;
    if (file.empty() || file.front() == '#' || (columns && first && file == "file"))
    {
      continue;
    }
    files.push_back((fs::path(list).parent_path() / file).string());
  }
  if (files.empty())
  {
    throw std::runtime_error("list " + list + " names no file, must have one per line");
  }
  return files;
}

}  // namespace

std::vector<std::string> listSoundFiles(const std::vector<std::string>& entries)
{
  std::vector<std::string> files;
  for (const std::string& entry : entries)
  {
    std::error_code ignored;
    std::vector<std::string> more;
    if (fs::is_directory(entry, ignored))
    {
      more = filesOfFolder(entry);
    }
    else if (extension(entry) == ".txt" || extension(entry) == ".tsv")
    {
      more = filesOfList(entry);
    }
    else
    {
      more = {entry};
    }
    files.insert(files.end(), more.begin(), more.end());
  }
  return files;
}

}  // namespace pi_speech
