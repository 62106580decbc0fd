#include "shm/side_channel.h"

#include <sys/random.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <utility>

namespace pi_os_transport
{
namespace
{

constexpr int BACKLOG = 256;

/// Abstract address: a leading zero byte, then the name without a terminator.
socklen_t abstractAddress(const std::string& name, sockaddr_un* address)
{
  std::memset(address, 0, sizeof(*address));
  address->sun_family = AF_UNIX;
  const size_t length = std::min(name.size(), sizeof(address->sun_path) - 1);
  std::memcpy(address->sun_path + 1, name.data(), length);
  return static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + length);
}

bool sameUser(int socket)
{
  ucred peer{};
  socklen_t length = sizeof(peer);
  return getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &peer, &length) == 0 && peer.uid == geteuid();
}

FileDescriptor makeSocket()
{
  return FileDescriptor(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
}

}  // namespace

Token Token::random()
{
  Token token;
  if (getrandom(&token, sizeof(token), 0) != static_cast<ssize_t>(sizeof(token)))
  {
    FILE* source = std::fopen("/dev/urandom", "re");  // for a kernel or sandbox without getrandom()
    if (source == nullptr || std::fread(&token, sizeof(token), 1, source) != 1)
    {
      token = Token{};  // peers then do not find each other and stay on TCPROS
    }
    if (source != nullptr)
    {
      std::fclose(source);
    }
  }
  return token;
}

std::string Token::toString() const
{
  char text[33];
  std::snprintf(text, sizeof(text), "%016" PRIx64 "%016" PRIx64, high, low);
  return text;
}

std::optional<Token> Token::fromString(const std::string& text)
{
  if (text.size() != 32)
  {
    return std::nullopt;
  }
  Token token;
  const char* const middle = text.data() + 16;
  if (std::from_chars(text.data(), middle, token.high, 16).ptr != middle ||
      std::from_chars(middle, middle + 16, token.low, 16).ptr != middle + 16)
  {
    return std::nullopt;
  }
  return token;
}

SideChannel SideChannel::listen(const std::string& name)
{
  FileDescriptor socket = makeSocket();
  sockaddr_un address;
  const socklen_t length = abstractAddress(name, &address);
  if (!socket || bind(socket.get(), reinterpret_cast<sockaddr*>(&address), length) != 0 ||
      ::listen(socket.get(), BACKLOG) != 0)
  {
    return SideChannel();
  }
  return SideChannel(std::move(socket));
}

SideChannel SideChannel::connect(const std::string& name)
{
  FileDescriptor socket = makeSocket();
  sockaddr_un address;
  const socklen_t length = abstractAddress(name, &address);
  if (!socket || ::connect(socket.get(), reinterpret_cast<sockaddr*>(&address), length) != 0)
  {
    return SideChannel();
  }
  if (!sameUser(socket.get()))
  {
    socket.reset();
    errno = EPERM;
    return SideChannel();
  }
  return SideChannel(std::move(socket));
}

SideChannel SideChannel::accept()
{
  for (;;)
  {
    const int fd = accept4(socket_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd < 0)
    {
      if (errno == EINTR || errno == ECONNABORTED)
      {
        continue;
      }
      return SideChannel();
    }
    FileDescriptor socket(fd);
    if (sameUser(fd))
    {
      return SideChannel(std::move(socket));
    }
  }
}

SideChannel::Receive SideChannel::receiveInto(void* bytes, size_t* length, Descriptors* descriptors)
{
  iovec data{bytes, *length};
  alignas(cmsghdr) char control[CMSG_SPACE(MAX_DESCRIPTORS * sizeof(int))];
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof(control);
  const ssize_t received = TEMP_FAILURE_RETRY(recvmsg(socket_.get(), &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT));
  if (received < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
  {
    return Receive::NOTHING;
  }
  if (received < 0)
  {
    return Receive::CLOSED;
  }
  size_t count = 0;  // also an empty packet may carry descriptors, which have to be closed
  for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part))
  {
    if (part->cmsg_level == SOL_SOCKET && part->cmsg_type == SCM_RIGHTS)
    {
      for (size_t offset = 0; CMSG_LEN(offset + sizeof(int)) <= part->cmsg_len; offset += sizeof(int))
      {
        int fd;
        std::memcpy(&fd, CMSG_DATA(part) + offset, sizeof(fd));
        FileDescriptor owned(fd);
        if (count < MAX_DESCRIPTORS)
        {
          (*descriptors)[count++] = std::move(owned);
        }
      }
    }
  }
  if (received == 0)
  {
    *descriptors = {};
    return Receive::CLOSED;
  }
  *length = static_cast<size_t>(received);
  if ((message.msg_flags & MSG_TRUNC) != 0 || ((message.msg_flags & MSG_CTRUNC) != 0 && count == MAX_DESCRIPTORS))
  {
    return Receive::MALFORMED;
  }
  return (message.msg_flags & MSG_CTRUNC) != 0 ? Receive::NO_DESCRIPTORS : Receive::PACKET;
}

SideChannel::Receive SideChannel::receive(Packet* packet, Descriptors* descriptors)
{
  size_t length = sizeof(*packet);
  const Receive result = receiveInto(packet, &length, descriptors);
  const bool received = result == Receive::PACKET || result == Receive::NO_DESCRIPTORS;
  return received && (length != sizeof(*packet) || packet->version != PROTOCOL_VERSION) ? Receive::MALFORMED : result;
}

SideChannel::Receive SideChannel::receiveBytes(std::vector<uint8_t>* bytes, size_t longest, Descriptors* descriptors)
{
  bytes->resize(longest);
  size_t length = longest;
  const Receive result = receiveInto(bytes->data(), &length, descriptors);
  bytes->resize(result == Receive::PACKET || result == Receive::NO_DESCRIPTORS ? length : 0);
  return result;
}

bool SideChannel::send(const Packet& packet, std::initializer_list<int> descriptors)
{
  return sendBytes(&packet, sizeof(packet), descriptors);
}

bool SideChannel::sendBytes(const void* bytes, size_t length, std::initializer_list<int> descriptors)
{
  iovec data{const_cast<void*>(bytes), length};
  alignas(cmsghdr) char control[CMSG_SPACE(MAX_DESCRIPTORS * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  if (descriptors.size() > 0)
  {
    message.msg_control = control;
    message.msg_controllen = CMSG_SPACE(descriptors.size() * sizeof(int));
    cmsghdr* part = CMSG_FIRSTHDR(&message);
    part->cmsg_level = SOL_SOCKET;
    part->cmsg_type = SCM_RIGHTS;
    part->cmsg_len = CMSG_LEN(descriptors.size() * sizeof(int));
    std::memcpy(CMSG_DATA(part), descriptors.begin(), descriptors.size() * sizeof(int));
  }
  const ssize_t sent = TEMP_FAILURE_RETRY(sendmsg(socket_.get(), &message, MSG_NOSIGNAL | MSG_DONTWAIT));
  return sent == static_cast<ssize_t>(length);
}

}  // namespace pi_os_transport
