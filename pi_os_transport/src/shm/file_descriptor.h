#pragma once

namespace pi_os_transport
{

/// Owns one file descriptor; -1 means none.
///
/// A child made by fork() closes all descriptors of the library before it runs, and finds this object empty: an open
/// copy would hide the parent's death from its peers. Not thread safe; different objects are independent.
class FileDescriptor
{
public:
  FileDescriptor() = default;
  /// @param fd  negative, as failed system calls return: none.
  explicit FileDescriptor(int fd);
  ~FileDescriptor();
  FileDescriptor(FileDescriptor&& other) noexcept;
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;

  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }
  /// Ends ownership. @return the descriptor, or -1.
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

/// True in a child of a process that uses the library. Such a child must not touch shared memory, which its parent
/// uses.
bool isForkedChild();

}  // namespace pi_os_transport
