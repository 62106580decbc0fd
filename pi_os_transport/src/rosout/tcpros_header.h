#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace pi_os_transport
{

/// The fields of the header that each end of a TCPROS connection sends first.
using TcprosHeader = std::map<std::string, std::string>;

/// @return the bytes for the connection, with their length in front
std::string encodeTcprosHeader(const TcprosHeader& header);
/// @param fields  the bytes behind the length. @return nothing if they are invalid
std::optional<TcprosHeader> decodeTcprosHeader(std::string_view fields);

/// Splits the data of a TCPROS connection into parts: a length of four bytes, and as many bytes.
class TcprosReader
{
public:
  /// @param most_bytes  of one part
  explicit TcprosReader(size_t most_bytes) : most_bytes_(most_bytes) {}

  void feed(std::string_view bytes);
  /// @return the next part, valid until feed(); nothing if it is incomplete
  std::optional<std::string_view> next();
  /// True if a part is longer than allowed: nothing more can be read. Call after next().
  bool isBroken() const { return is_broken_; }

private:
  size_t most_bytes_;
  std::string buffer_;
  size_t at_ = 0;
  bool is_broken_ = false;
};

}  // namespace pi_os_transport
