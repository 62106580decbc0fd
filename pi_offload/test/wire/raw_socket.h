#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

/// For tests: longer than anything that is waited for takes on a machine with other work. Never a measure.
constexpr double PATIENCE_S = 30.0;

/// What threads hand to the test.
template <typename Item>
class Inbox
{
public:
  void put(Item item)
  {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      items_.push_back(std::move(item));
    }
    changed_.notify_all();
  }
  /// @throws std::runtime_error if nothing comes.
  Item take(double seconds = PATIENCE_S)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return !items_.empty(); }))
    {
      throw std::runtime_error("nothing came");
    }
    Item item = std::move(items_.front());
    items_.pop_front();
    return item;
  }
  size_t size() const
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    return items_.size();
  }

private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> items_;
};

/// A plain TCP socket on the loopback interface that blocks, but never for ever.
class RawSocket
{
public:
  RawSocket() = default;
  explicit RawSocket(int fd) : fd_(fd) {}
  ~RawSocket() { close(); }
  RawSocket(RawSocket&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  RawSocket& operator=(RawSocket&& other) noexcept
  {
    close();
    fd_ = std::exchange(other.fd_, -1);
    return *this;
  }

  static sockaddr_in loopback(uint16_t port)
  {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return address;
  }
  static RawSocket connectTo(uint16_t port)
  {
    RawSocket socket(::socket(AF_INET, SOCK_STREAM, 0));
    const sockaddr_in address = loopback(port);
    if (::connect(socket.fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0)
    {
      throw std::runtime_error("cannot connect");
    }
    return socket;
  }
  /// @param port  in: 0 for any; out: that it is.
  static RawSocket listenOn(uint16_t* port)
  {
    RawSocket socket(::socket(AF_INET, SOCK_STREAM, 0));
    const int one = 1;
    setsockopt(socket.fd_, SOL_SOCKET, SO_REUSEADDR, &one, sizeof(one));
    sockaddr_in address = loopback(*port);
    socklen_t length = sizeof(address);
    if (::bind(socket.fd_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
        ::listen(socket.fd_, 16) != 0 || getsockname(socket.fd_, reinterpret_cast<sockaddr*>(&address), &length) != 0)
    {
      throw std::runtime_error("cannot listen");
    }
    *port = ntohs(address.sin_port);
    return socket;
  }
  RawSocket accept()
  {
    await();
    return RawSocket(::accept(fd_, nullptr, nullptr));
  }
  void close()
  {
    if (fd_ >= 0)
    {
      ::close(fd_);
    }
    fd_ = -1;
  }
  int fd() const { return fd_; }

  /// @return false if the other end has closed.
  bool write(const std::vector<uint8_t>& bytes)
  {
    for (size_t done = 0; done < bytes.size();)
    {
      const ssize_t count = ::send(fd_, bytes.data() + done, bytes.size() - done, MSG_NOSIGNAL);
      if (count < 0)
      {
        return false;
      }
      done += static_cast<size_t>(count);
    }
    return true;
  }
  bool write(const std::string& text) { return write(std::vector<uint8_t>(text.begin(), text.end())); }
  /// Fewer bytes than wanted: the other end has closed.
  std::vector<uint8_t> read(size_t wanted)
  {
    std::vector<uint8_t> bytes(wanted);
    size_t done = 0;
    while (done < wanted)
    {
      await();
      const ssize_t count = ::recv(fd_, bytes.data() + done, wanted - done, 0);
      if (count <= 0)
      {
        break;
      }
      done += static_cast<size_t>(count);
    }
    bytes.resize(done);
    return bytes;
  }
  std::string readAll()
  {
    std::string all;
    for (std::vector<uint8_t> part = read(1); !part.empty(); part = read(1))
    {
      all.push_back(static_cast<char>(part[0]));
    }
    return all;
  }
  /// Whether the other end closes (or has).
  bool closes()
  {
    while (true)
    {
      await();
      char bytes[4096];
      if (::recv(fd_, bytes, sizeof(bytes), 0) <= 0)
      {
        return true;
      }
    }
  }

private:
  void await() const
  {
    pollfd watched{fd_, POLLIN, 0};
    if (poll(&watched, 1, static_cast<int>(PATIENCE_S * 1e3)) != 1)
    {
      throw std::runtime_error("the other end says nothing");
    }
  }
  int fd_ = -1;
};
