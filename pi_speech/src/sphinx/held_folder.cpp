#include "sphinx/held_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

namespace pi_speech
{
namespace
{

namespace fs = std::filesystem;

constexpr char NAME[] = "pi_speech_";
constexpr int ATTEMPTS = 10;

int lockFolder(const std::string& path)
{
  const int lock = ::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
  if (lock >= 0 && ::flock(lock, LOCK_EX | LOCK_NB) != 0)
  {
    ::close(lock);
    return -1;
  }
  return lock;
}

void removeDead(const std::string& place)
{
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(place, error))
  {
    struct stat status = {};
    if (entry.path().filename().string().rfind(NAME, 0) != 0 || ::lstat(entry.path().c_str(), &status) != 0 ||
        !S_ISDIR(status.st_mode) || status.st_uid != ::getuid())
    {
      continue;
    }
    const int lock = lockFolder(entry.path());
    if (lock >= 0)
    {
      std::error_code ignored;
      fs::remove_all(entry.path(), ignored);
      ::close(lock);
    }
  }
}

}  // namespace

HeldFolder::HeldFolder()
{
  std::error_code error;
  const std::string temporary = fs::temp_directory_path(error);
  for (const std::string& place : {temporary, std::string("/dev/shm"), "/run/user/" + std::to_string(::getuid())})
  {
    if (!place.empty() && make(place))
    {
      return;
    }
  }
  throw std::runtime_error("no folder can be made in " + temporary + " or /dev/shm: " + std::strerror(errno) +
                           "; PocketSphinx needs one for its scores: make room, or set TMPDIR");
}

HeldFolder::~HeldFolder()
{
  std::error_code ignored;
  fs::remove_all(path_, ignored);
  ::close(lock_);
}

bool HeldFolder::make(const std::string& place)
{
  removeDead(place);
  for (int i = 0; i < ATTEMPTS; ++i)
  {
    std::string name = place + "/" + NAME + "XXXXXX";
    if (::mkdtemp(name.data()) == nullptr)
    {
      return false;
    }
    // Another process may have taken it for a dead one's before it was locked.
    lock_ = lockFolder(name);
    if (lock_ >= 0 && ::access(name.c_str(), F_OK) == 0)
    {
      path_ = name;
      return true;
    }
    ::close(lock_);
  }
  return false;
}

}  // namespace pi_speech
