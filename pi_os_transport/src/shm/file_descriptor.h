#pragma once

namespace pi_os_transport
{

/// Owns one file descriptor; -1 means none.
///
/// Every open descriptor of the library is on a process-wide list. A child made by fork() closes them all before it
/// runs (a descriptor that lived on in the child would hide the parent's death from its peers), and sees this object
/// as empty. Movable, not copyable. A single object is not thread safe; different objects are.
class FileDescriptor
{
public:
  FileDescriptor() = default;
  /// A negative `fd`, as failed system calls return it, means none.
  explicit FileDescriptor(int fd);
  ~FileDescriptor();
  FileDescriptor(FileDescriptor&& other) noexcept;
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;

  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }
  /// Gives up ownership. @return the descriptor, or -1.
  int release();
  void reset();

private:
  friend struct DescriptorList;
  void enlist();
  void delist();

  int fd_ = -1;
  FileDescriptor* previous_ = nullptr;
  FileDescriptor* next_ = nullptr;
};

/// True in a process that was forked from one that had the library at work. Such a child must leave shared memory
/// alone: it still maps what its parent and the parent's peers use.
bool isForkedChild();

}  // namespace pi_os_transport
