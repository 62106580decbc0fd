#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{

/// Reached only when something is broken.
constexpr std::chrono::seconds TEST_DEADLINE{60};

/// Runs the loop until `reached`. @return false if that takes too long
inline bool runUntil(EventLoop* loop, const std::function<bool()>& reached)
{
  const SteadyTime deadline = SteadyClock::now() + TEST_DEADLINE;
  while (!reached())
  {
    if (SteadyClock::now() > deadline)
    {
      return false;
    }
    loop->runOnce(std::chrono::milliseconds(100));
  }
  return true;
}

/// The client's end of a connection of TCP to a server on a loop of the same thread.
class LoopbackClient
{
public:
  LoopbackClient(EventLoop* loop, uint16_t port) : loop_(loop), socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0))
  {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(0, connect(socket_.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)));
  }

  /// What the kernel does not take at once is sent while the loop runs. @return false if the server closed before
  bool send(std::string_view bytes)
  {
    return runUntil(loop_,
                    [&]
                    {
                      const ssize_t size =
                          ::send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
                      if (size > 0)
                      {
                        bytes.remove_prefix(static_cast<size_t>(size));
                      }
                      return bytes.empty() || (size < 0 && errno != EAGAIN);
                    }) &&
           bytes.empty();
  }

  /// Reads, while the loop runs, until `enough` of what has come since the last call.
  std::string receive(const std::function<bool(const std::string&)>& enough)
  {
    std::string received;
    EXPECT_TRUE(runUntil(loop_,
                         [&]
                         {
                           std::array<char, 65536> chunk;
                           ssize_t size = 0;
                           while ((size = recv(socket_.get(), chunk.data(), chunk.size(), MSG_DONTWAIT)) > 0)
                           {
                             received.append(chunk.data(), static_cast<size_t>(size));
                           }
                           return size == 0 || errno != EAGAIN || enough(received);
                         }))
        << received;
    return received;
  }

  /// All up to the end of the connection, which the server has to close.
  std::string receiveAll()
  {
    return receive([](const std::string&) { return false; });
  }

  int get() const { return socket_.get(); }

private:
  EventLoop* loop_;
  FileDescriptor socket_;
};

}  // namespace pi_os_transport
