#include "recorder/recording_folder.h"

#include <fcntl.h>
#include <pi_node/child_process.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <system_error>

namespace pi_vehicle::recorder
{

namespace fs = std::filesystem;

namespace
{

constexpr char ACTIVE_ENDING[] = ".bag.active";
constexpr uintmax_t EMPTY_BAG_BYTES = 4200;   // the header of a bag, and no message
constexpr char RECOVERY[] = ".recovery_";     // begin of the name of a folder
constexpr double RECOVERY_TIMEOUT_S = 120.0;  // of seconds that a large file takes

fs::path expanded(const std::string& path)
{
  const char* home = std::getenv("HOME");
  return home != nullptr && (path == "~" || path.rfind("~/", 0) == 0) ? fs::path(home + path.substr(1))
                                                                      : fs::path(path);
}

bool endsWith(const std::string& text, const std::string& end)
{
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

struct Entry
{
  fs::path path;
  uint64_t bytes;
  bool finished;
};

std::string lastLine(std::string text)
{
  text.erase(text.find_last_not_of(" \n") + 1);
  return text.substr(text.rfind('\n') + 1);
}

/// Files of a kind, the oldest by their names first. What vanishes meanwhile is left out.
std::vector<Entry> entriesOf(const fs::path& folder, const std::string& kind)
{
  std::vector<Entry> entries;
  std::error_code error;
  for (fs::directory_iterator file(folder, error), end; !error && file != end; file.increment(error))
  {
    std::error_code gone;
    const uint64_t bytes = file->is_directory(gone) ? 0 : file->file_size(gone);
    const Entry entry{file->path(), bytes, file->path().extension() == ".bag"};
    if (!gone && entry.path.filename().string().rfind(kind, 0) == 0)
    {
      entries.push_back(entry);
    }
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.path < b.path; });
  return entries;
}

}  // namespace

RecordingFolder::RecordingFolder(const std::string& path) : path_(expanded(path)) {}

void RecordingFolder::open()
{
  std::error_code error;
  if (lock_ && fs::is_directory(path_, error))
  {
    return;
  }
  lock_.reset();
  const std::string choose = "; give the user of this node a folder to write to by the parameter folder";
  fs::create_directories(path_, error);
  if (error)
  {
    throw std::runtime_error(path_.string() + " cannot be created: " + error.message() + choose);
  }
  pi_node::UniqueFd lock(::open((path_ / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (!lock)
  {
    throw std::runtime_error(path_.string() + " cannot be written to: " + std::strerror(errno) + choose);
  }
  if (::flock(lock.get(), LOCK_EX | LOCK_NB) != 0)
  {
    throw std::runtime_error(path_.string() +
                             " is used by another recorder; end that one, or give this one a folder of its own by the "
                             "parameter folder");
  }
  lock_ = std::move(lock);
  for (const Entry& left : entriesOf(path_, RECOVERY))
  {
    fs::remove_all(left.path, error);
  }
}

std::string RecordingFolder::unusedName(const char* kind, int64_t stamp_ns, const std::string& cause) const
{
  const std::time_t seconds = static_cast<std::time_t>(stamp_ns / 1000000000);
  std::tm time = {};
  gmtime_r(&seconds, &time);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H-%M-%SZ", &time);
  return unused(kind + std::string(text) + (cause.empty() ? "" : "_" + cause));
}

std::string RecordingFolder::unused(const std::string& name) const
{
  std::string other = name;
  std::error_code ignored;
  for (int number = 2; fs::exists(finished(other), ignored) || fs::exists(active(other), ignored); ++number)
  {
    other = name + "_" + std::to_string(number);
  }
  return other;
}

uint64_t RecordingFolder::freeBytes() const
{
  std::error_code error;
  const fs::space_info space = fs::space(path_, error);
  return error ? 0 : space.available;
}

std::vector<fs::path> RecordingFolder::unfinished(const std::vector<std::string>& own) const
{
  std::vector<fs::path> files;
  for (const char* kind : {INCIDENT, SLIM})
  {
    for (const Entry& entry : entriesOf(path_, kind))
    {
      const std::string name = entry.path.filename().string();
      if (endsWith(name, ACTIVE_ENDING) &&
          std::find(own.begin(), own.end(), name.substr(0, name.size() - std::strlen(ACTIVE_ENDING))) == own.end())
      {
        files.push_back(entry.path);
      }
    }
  }
  return files;
}

RecordingFolder::Usage RecordingFolder::usage(const char* kind) const
{
  Usage usage;
  for (const Entry& entry : entriesOf(path_, kind))
  {
    usage.bytes += entry.bytes;
    ++usage.files;
  }
  return usage;
}

std::vector<fs::path> RecordingFolder::keepWithin(const char* kind, uint64_t budget_bytes) const
{
  std::vector<fs::path> deleted;
  uint64_t bytes = usage(kind).bytes;
  for (const Entry& entry : entriesOf(path_, kind))
  {
    std::error_code error;
    if (bytes <= budget_bytes)
    {
      break;
    }
    if (entry.finished && fs::remove(entry.path, error))
    {
      bytes -= entry.bytes;
      deleted.push_back(entry.path);
    }
  }
  return deleted;
}

std::string recoverFile(const fs::path& file, const std::function<std::optional<uint64_t>(const fs::path&)>& count)
{
  const std::string nothing = file.string() + " held no message yet; deleted";
  const fs::path finished = file.parent_path() / file.stem();  // without .active
  if (fs::file_size(file) <= EMPTY_BAG_BYTES)
  {
    fs::remove(file);
    return nothing;
  }
  if (fs::exists(finished) && count(finished))  // killed between the last two steps below
  {
    fs::remove(file);
    return finished.string() + " is complete";
  }
  if (count(file))  // killed between its index and its name
  {
    fs::rename(file, finished);
    return finished.string() + " is complete";
  }
  // Of this process: the rosbag of a recorder that was killed meanwhile may still write to that recorder's.
  const fs::path folder = file.parent_path() / (RECOVERY + std::to_string(::getpid()));
  const fs::path copy = folder / file.filename();
  fs::create_directories(folder);
  if (fs::space(folder).available < fs::file_size(file))
  {
    throw std::runtime_error(file.string() + " awaits its recovery: there is no room for a copy");
  }
  pi_node::ChildOptions options;
  options.timeout_s = RECOVERY_TIMEOUT_S;
  const pi_node::ChildResult result = pi_node::runChild(
      "/usr/bin/nice", {"rosbag", "reindex", "--quiet", "--output-dir=" + folder.string(), file.string()}, options);
  if (!result.in_time || result.status != 0)
  {
    fs::remove(copy);
    throw std::runtime_error(file.string() + " awaits its recovery: rosbag reindex " +
                             (result.in_time ? "failed: " + lastLine(result.output) : "took too long"));
  }
  const std::optional<uint64_t> messages = count(copy);
  if (messages == uint64_t{0})  // killed in its first write
  {
    fs::remove(copy);
    fs::remove(file);
    return nothing;
  }
  if (messages)
  {
    fs::rename(copy, finished);
    fs::remove(file);
    return finished.string() + " was recovered after the end of its recorder; at most its last second is missing";
  }
  fs::remove(copy);
  throw std::runtime_error(file.string() + " cannot be recovered now: rosbag reindex says: " + lastLine(result.output) +
                           "; it stays, and is tried again");
}

}  // namespace pi_vehicle::recorder
