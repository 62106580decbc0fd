#pragma once

#include <unistd.h>

#include <utility>

namespace pi_node
{

/// Owns a file descriptor; -1 means none. Not thread safe.
class UniqueFd
{
public:
  UniqueFd() = default;
  explicit UniqueFd(int fd) : fd_(fd) {}
  ~UniqueFd() { reset(); }
  UniqueFd(UniqueFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  UniqueFd& operator=(UniqueFd&& other) noexcept
  {
    if (this != &other)
    {
      reset();
      fd_ = std::exchange(other.fd_, -1);
    }
    return *this;
  }
  UniqueFd(const UniqueFd&) = delete;
  UniqueFd& operator=(const UniqueFd&) = delete;

  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }
  /// @return false if close() failed, for example because a written file did not reach the disk; errno tells why.
  bool reset() { return fd_ < 0 || ::close(std::exchange(fd_, -1)) == 0; }

private:
  int fd_ = -1;
};

}  // namespace pi_node
