#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace pi_simulation
{

/// The far end of a serial line on a pseudo-terminal: who opens path() finds a serial port there. Never blocks. Closing
/// it is as an unplugged line for the other end. Not thread safe.
class PseudoTerminal
{
public:
  /// @param link  a symbolic link to path() while this object lives; one that is there is replaced, a file that is not
  /// a
  ///              link is not; empty: none.
  /// @throws std::runtime_error if there is no pseudo-terminal, or the link cannot be made.
  explicit PseudoTerminal(const std::string& link);
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  /// @return 0 where there is nothing, or nobody at the other end.
  size_t read(uint8_t* bytes, size_t size);
  /// @return bytes that were taken; what nobody reads is lost.
  size_t write(const uint8_t* bytes, size_t size);
  const std::string& path() const { return path_; }

private:
  const std::string link_;
  int descriptor_ = -1;
  std::string path_;
};

}  // namespace pi_simulation
