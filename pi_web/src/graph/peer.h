#pragma once

#include <pi_node/unique_fd.h>

#include <cstdint>
#include <map>
#include <string>

namespace pi_web
{

/// A TCP connection to a node or master with one deadline for all that is done with it: nobody else can make the caller
/// wait. Methods throw std::runtime_error naming the peer. Not thread safe.
class Peer
{
public:
  /// Connects. @param host  name or IPv4 address.
  Peer(const std::string& host, uint16_t port, double limit_s);

  void write(const std::string& bytes);
  /// @throws also if the peer closes before.
  std::string read(size_t bytes);
  /// A little-endian length in front, and so many bytes. @param most  longest that is taken.
  std::string readBlock(size_t most);
  /// What comes until the peer closes.
  std::string readAll(size_t most);

private:
  void wait(short events) const;
  std::string readSome(size_t most);

  const std::string name_;
  const int64_t until_ns_;
  pi_node::UniqueFd socket_;
};

/// Host and port of "http://host:port/" and "rosrpc://host:port". @throws std::runtime_error for other texts.
std::pair<std::string, uint16_t> addressOf(const std::string& uri);

using HeaderFields = std::map<std::string, std::string>;

/// The header of a connection of TCPROS. decode takes what follows its length.
std::string encodeHeader(const HeaderFields& fields);
HeaderFields decodeHeader(const std::string& bytes);

}  // namespace pi_web
