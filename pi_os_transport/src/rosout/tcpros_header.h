#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace pi_os_transport
{

/// The fields with which the two ends of a TCPROS connection introduce themselves.
using TcprosHeader = std::map<std::string, std::string>;

/// @return with its length in front, as it goes over the connection.
std::string encodeTcprosHeader(const TcprosHeader& header);
/// @param fields  all behind the length. @return nothing if they are none.
std::optional<TcprosHeader> decodeTcprosHeader(std::string_view fields);

/// Cuts what comes over a TCPROS connection into its parts: a length in four bytes, and as many bytes.
class TcprosReader
{
public:
  /// @param most_bytes  of one part
  explicit TcprosReader(size_t most_bytes) : most_bytes_(most_bytes) {}

  void feed(std::string_view bytes);
  /// @return the next part, valid until feed(); nothing if it is not complete.
  std::optional<std::string_view> next();
  /// A part was announced that is longer than allowed: nothing can be read any more. To be asked after next().
  bool isBroken() const { return is_broken_; }

private:
  size_t most_bytes_;
  std::string buffer_;
  size_t at_ = 0;
  bool is_broken_ = false;
};

}  // namespace pi_os_transport
