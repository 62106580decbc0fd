#include "units/unit_table.h"

#include <fcntl.h>
#include <pi_node/fnv1a.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>
#include <mutex>
#include <new>
#include <stdexcept>
#include <utility>
#include <vector>

namespace pi_runtime
{
namespace
{

constexpr off_t DOOR_BYTE = 0;   // locked while somebody comes or leaves
constexpr off_t PLACE_BYTE = 1;  // of place 0; locked as long as its user lives

/// Locks belong to the open file description, not to the process as those of plain F_SETLK: these would vanish with
/// the first descriptor of the file that the process closes.
/// @return 0: done, or free to lock (F_OFD_GETLK); else locked by another user, or failed with errno set.
int fileLock(int file, int command, short type, off_t start, off_t length)
{
  struct flock lock = {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  lock.l_start = start;
  lock.l_len = length;
  int result;
  do
  {
    result = fcntl(file, command, &lock);
  } while (result != 0 && errno == EINTR);
  return command == F_OFD_GETLK && result == 0 && lock.l_type != F_UNLCK ? 1 : result;
}

/// "pi_runtime.<uid>.<key as far as file names can say it>.<hash of key and version>": programs of another version of
/// the table have another file.
std::string fileName(const std::string& key)
{
  constexpr size_t LEGIBLE = 64;
  const std::string plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-";
  std::string legible;
  for (const char character : key)
  {
    legible += plain.find(character) != std::string::npos ? character : '_';
  }
  const uint64_t hash = pi_node::fnv1a(key + "/" + std::to_string(UnitTable::VERSION));
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(hash));
  return "pi_runtime." + std::to_string(geteuid()) + "." + legible.substr(0, LEGIBLE) + "." + digits;
}

int allocatePages(int file, size_t bytes)
{
  int error;
  do
  {
    error = posix_fallocate(file, 0, static_cast<off_t>(bytes));
  } while (error == EINTR);
  return error;
}

}  // namespace

/// The open tables of this process. The fork handlers hold the mutex across fork(), so the child finds the list whole.
struct OpenTables
{
  OpenTables() { pthread_atfork(prepare, parent, child); }

  static void prepare() { mutex.lock(); }
  static void parent() { mutex.unlock(); }
  static void child()
  {
    for (UnitTableFile* user : list())
    {
      ::close(user->file_);
      user->file_ = -1;
      user->table_ = nullptr;  // not mapped here, see MADV_DONTFORK
    }
    list().clear();
    mutex.unlock();
  }
  static void add(UnitTableFile* user)
  {
    static OpenTables fork_handlers;
    const std::lock_guard<std::mutex> lock(mutex);
    list().push_back(user);
  }
  static void remove(UnitTableFile* user)
  {
    const std::lock_guard<std::mutex> lock(mutex);
    list().erase(std::remove(list().begin(), list().end(), user), list().end());
  }
  static std::vector<UnitTableFile*>& list()
  {
    static auto* users = new std::vector<UnitTableFile*>;  // never destroyed: users with static storage end after it
    return *users;
  }

  static inline std::mutex mutex;
};

UnitTableFile::UnitTableFile(const std::string& key, const std::string& folder) : path_(folder + "/" + fileName(key))
{
  if (key.empty())
  {
    throw std::invalid_argument("the key of a unit arbiter is empty; it must identify the computing unit");
  }
  OpenTables::add(this);
  try
  {
    while (!openFile())
    {
    }
    mapTable();
    checkOrMakeTable();
    claimPlace();
    fileLock(file_, F_OFD_SETLK, F_UNLCK, DOOR_BYTE, 1);
  }
  catch (...)
  {
    close();
    throw;
  }
}

UnitTableFile::~UnitTableFile()
{
  if (isForked())
  {
    return;
  }
  fileLock(file_, F_OFD_SETLKW, F_WRLCK, DOOR_BYTE, 1);
  struct stat opened;
  struct stat named;
  const bool still_named = fstat(file_, &opened) == 0 && lstat(path_.c_str(), &named) == 0 &&
                           opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
  if (still_named && !othersAlive())
  {
    unlink(path_.c_str());
  }
  close();
}

void UnitTableFile::fail(const std::string& problem, const std::string& way_out) const
{
  throw std::runtime_error(path_ + ": " + problem + "; " + way_out);
}

/// Opens the file and locks the door. @return false if the last user removed the file meanwhile; it is closed then.
bool UnitTableFile::openFile()
{
  file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file_ < 0)
  {
    fail(std::string("cannot be opened: ") + std::strerror(errno),
         "the folder must be writable for this user, and the file, if there is one, its own");
  }
  struct stat status;
  if (fstat(file_, &status) != 0 || !S_ISREG(status.st_mode) || status.st_uid != geteuid())
  {
    fail("is no file of this user", "remove it");
  }
  if (fileLock(file_, F_OFD_SETLKW, F_WRLCK, DOOR_BYTE, 1) != 0)
  {
    fail(std::string("cannot be locked: ") + std::strerror(errno), "choose a folder that is memory, like /dev/shm");
  }
  if (fstat(file_, &status) != 0 || status.st_nlink == 0)
  {
    ::close(std::exchange(file_, -1));
    return false;
  }
  return true;
}

void UnitTableFile::mapTable()
{
  constexpr size_t BYTES = sizeof(UnitTable);
  struct stat status = {};
  fstat(file_, &status);
  if (status.st_size != 0 && status.st_size != BYTES)
  {
    fail("has " + std::to_string(status.st_size) + " bytes instead of " + std::to_string(BYTES),
         "end the programs that use it and remove it");
  }
  // Allocates the pages now: a full /dev/shm is an error here instead of SIGBUS later.
  if (const int error = allocatePages(file_, BYTES))
  {
    if (status.st_size == 0)
    {
      unlink(path_.c_str());
    }
    fail("cannot get " + std::to_string(BYTES) + " bytes: " + std::strerror(error), "make room there");
  }
  void* address = mmap(nullptr, BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, file_, 0);
  if (address == MAP_FAILED)
  {
    fail(std::string("cannot be mapped: ") + std::strerror(errno), "raise the limit of address space (ulimit -v)");
  }
  madvise(address, BYTES, MADV_DONTFORK);
  table_ = static_cast<UnitTable*>(address);
}

void UnitTableFile::checkOrMakeTable()
{
  const uint64_t magic = table_->magic.load(std::memory_order_acquire);
  if (magic != 0 &&
      (magic != UnitTable::MAGIC || table_->version != UnitTable::VERSION || table_->places != UnitTable::PLACES))
  {
    fail("is no table of a unit in version " + std::to_string(UnitTable::VERSION),
         "end the programs that use it and remove it");
  }
  if (magic != 0 && othersAlive())
  {
    return;
  }
  // New, left unfinished, or left by users that were all killed.
  new (table_) UnitTable{};
  for (UnitTable::Place& place : table_->place)
  {
    place.blocking_budget_ns.store(std::numeric_limits<int64_t>::max(), std::memory_order_relaxed);
  }
  table_->version = UnitTable::VERSION;
  table_->places = UnitTable::PLACES;
  table_->magic.store(UnitTable::MAGIC, std::memory_order_release);
}

/// Takes the first place without a living user. The caller cleans up its content.
void UnitTableFile::claimPlace()
{
  while (place_ < UnitTable::PLACES && fileLock(file_, F_OFD_SETLK, F_WRLCK, PLACE_BYTE + place_, 1) != 0)
  {
    ++place_;
  }
  if (place_ == UnitTable::PLACES)
  {
    fail("all " + std::to_string(UnitTable::PLACES) + " places are taken, the first by process " +
             std::to_string(table_->place[0].pid.load(std::memory_order_relaxed)),
         "end some of the processes that use this unit");
  }
  table_->place[place_].pid.store(getpid(), std::memory_order_relaxed);
}

void UnitTableFile::close()
{
  OpenTables::remove(this);
  if (table_ != nullptr)
  {
    munmap(std::exchange(table_, nullptr), sizeof(UnitTable));
  }
  if (file_ >= 0)
  {
    ::close(std::exchange(file_, -1));  // gives up the door and the place
  }
}

UnitTable& UnitTableFile::table() const
{
  if (table_ == nullptr)
  {
    throw std::logic_error(path_ + ": a unit arbiter was used in a forked child; make a new one there");
  }
  return *table_;
}

bool UnitTableFile::isAlive(uint32_t place) const
{
  // A failed query counts as alive, so that no living user loses the unit.
  return place == place_ || fileLock(file_, F_OFD_GETLK, F_WRLCK, PLACE_BYTE + place, 1) != 0;
}

bool UnitTableFile::othersAlive() const
{
  return fileLock(file_, F_OFD_GETLK, F_WRLCK, PLACE_BYTE, UnitTable::PLACES) != 0;
}

}  // namespace pi_runtime
