#include "shm/file_descriptor.h"

#include <pthread.h>
#include <unistd.h>

#include <utility>

namespace pi_os_transport
{

/// The open descriptors. The fork handlers hold the mutex during fork(), so the child finds a consistent list.
struct DescriptorList
{
  DescriptorList() { pthread_atfork(prepare, parent, child); }

  static void prepare() { pthread_mutex_lock(&mutex); }
  static void parent() { pthread_mutex_unlock(&mutex); }
  static void child()
  {
    forked_child = true;
    for (FileDescriptor* entry = first; entry != nullptr;)
    {
      FileDescriptor* next = entry->next_;
      close(entry->fd_);
      entry->fd_ = -1;
      entry->previous_ = entry->next_ = nullptr;
      entry = next;
    }
    first = nullptr;
    pthread_mutex_unlock(&mutex);
  }

  static inline pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
  static inline FileDescriptor* first = nullptr;
  static inline bool forked_child = false;
};

bool isForkedChild()
{
  return DescriptorList::forked_child;
}

FileDescriptor::FileDescriptor(int fd) : fd_(fd < 0 ? -1 : fd)
{
  enlist();
}

FileDescriptor::~FileDescriptor()
{
  reset();
}

FileDescriptor::FileDescriptor(FileDescriptor&& other) noexcept
{
  *this = std::move(other);
}

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept
{
  if (this != &other)
  {
    reset();
    other.delist();
    fd_ = std::exchange(other.fd_, -1);
    enlist();
  }
  return *this;
}

int FileDescriptor::release()
{
  if (fd_ >= 0)
  {
    delist();
  }
  return std::exchange(fd_, -1);
}

void FileDescriptor::reset()
{
  if (fd_ >= 0)
  {
    delist();
    close(fd_);
    fd_ = -1;
  }
}

void FileDescriptor::enlist()
{
  static DescriptorList fork_handlers;
  if (fd_ < 0)
  {
    return;
  }
  pthread_mutex_lock(&DescriptorList::mutex);
  next_ = DescriptorList::first;
  if (next_ != nullptr)
  {
    next_->previous_ = this;
  }
  DescriptorList::first = this;
  pthread_mutex_unlock(&DescriptorList::mutex);
}

void FileDescriptor::delist()
{
  if (fd_ < 0)
  {
    return;
  }
  pthread_mutex_lock(&DescriptorList::mutex);
  (previous_ != nullptr ? previous_->next_ : DescriptorList::first) = next_;
  if (next_ != nullptr)
  {
    next_->previous_ = previous_;
  }
  previous_ = next_ = nullptr;
  pthread_mutex_unlock(&DescriptorList::mutex);
}

}  // namespace pi_os_transport
