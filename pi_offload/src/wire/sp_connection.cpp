#include "wire/sp_connection.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace pi_offload
{
namespace
{

constexpr size_t BUFFER_BYTES = 64U << 10U;
/// What one connection may bring before the others have their turn.
constexpr size_t BYTES_PER_TURN = 1U << 20U;
/// Memory for a message grows with what has come of it, not with what was announced.
constexpr size_t FIRST_ROOM = 64U << 10U;

std::array<uint8_t, 8> greetingOf(uint16_t type)
{
  return {0, 'S', 'P', 0, static_cast<uint8_t>(type >> 8U), static_cast<uint8_t>(type & 0xffU), 0, 0};
}

void putBigEndian(uint8_t* out, uint64_t value, size_t bytes)
{
  for (size_t byte = 0; byte < bytes; ++byte)
  {
    out[byte] = static_cast<uint8_t>(value >> (8 * (bytes - 1 - byte)));
  }
}

uint64_t getBigEndian(const uint8_t* in, size_t bytes)
{
  uint64_t value = 0;
  for (size_t byte = 0; byte < bytes; ++byte)
  {
    value = value << 8U | in[byte];
  }
  return value;
}

std::string reasonOf(int error)
{
  return error == ECONNRESET || error == EPIPE ? "closed by the other end" : errorText(error);
}

}  // namespace

SpConnection::SpConnection(UniqueFd fd, uint16_t own_type, uint16_t peer_type, size_t max_message_bytes,
                           size_t max_queued_bytes)
  : fd_(std::move(fd))
  , peer_type_(peer_type)
  , max_message_bytes_(max_message_bytes)
  , max_queued_bytes_(max_queued_bytes)
{
  const auto greeting = greetingOf(own_type);
  outgoing_.emplace_back(greeting.begin(), greeting.end());
  queued_bytes_ = greeting.size();
}

bool SpConnection::receive(const Sink& sink, std::string* reason)
{
  std::array<uint8_t, BUFFER_BYTES> buffer;
  for (size_t turn_bytes = 0; turn_bytes < BYTES_PER_TURN;)
  {
    // The rest of a large message goes straight to its place.
    const bool straight = stage_ == Stage::MESSAGE && length_ - received_ >= BUFFER_BYTES / 4;
    uint8_t* place = buffer.data();
    size_t room = buffer.size();
    if (straight)
    {
      makeRoom();
      place = message_.data() + received_;
      room = message_.size() - received_;
    }
    const ssize_t count = recv(fd_.get(), place, room, MSG_DONTWAIT);
    if (count < 0 && isTemporary(errno))
    {
      return true;
    }
    if (count <= 0)
    {
      *reason = count == 0 ? "closed by the other end" : reasonOf(errno);
      return false;
    }
    const auto taken = static_cast<size_t>(count);
    turn_bytes += taken;
    if (!(straight ? onMessageBytes(taken, sink, reason) : takeBytes(buffer.data(), taken, sink, reason)))
    {
      return false;
    }
    if (taken < room)
    {
      return true;  // that was all there is
    }
  }
  return true;
}

void SpConnection::makeRoom()
{
  if (message_.size() == received_)
  {
    message_.resize(std::min(length_, received_ + std::max(received_, FIRST_ROOM)));
  }
}

bool SpConnection::takeBytes(const uint8_t* bytes, size_t count, const Sink& sink, std::string* reason)
{
  while (count > 0)
  {
    size_t taken = 0;
    if (stage_ == Stage::MESSAGE)
    {
      makeRoom();
      taken = std::min(count, message_.size() - received_);
      std::memcpy(message_.data() + received_, bytes, taken);
      if (!onMessageBytes(taken, sink, reason))
      {
        return false;
      }
    }
    else
    {
      taken = std::min(count, head_.size() - head_bytes_);
      std::memcpy(head_.data() + head_bytes_, bytes, taken);
      head_bytes_ += taken;
      if (!onHead(sink, reason))
      {
        return false;
      }
    }
    bytes += taken;
    count -= taken;
  }
  return true;
}

/// More of the SP header or of a length has come.
bool SpConnection::onHead(const Sink& sink, std::string* reason)
{
  if (stage_ == Stage::GREETING)
  {
    const auto expected = greetingOf(peer_type_);
    if (std::memcmp(head_.data(), expected.data(), head_bytes_) != 0)
    {
      *reason = std::string("the other end is not an SP ") + (peer_type_ == REQ ? "REQ" : "REP") + " socket";
      return false;
    }
    if (head_bytes_ == GREETING_BYTES)
    {
      head_bytes_ = 0;
      stage_ = Stage::LENGTH;
    }
    return true;
  }
  if (head_bytes_ < LENGTH_BYTES)
  {
    return true;
  }
  const uint64_t length = getBigEndian(head_.data(), LENGTH_BYTES);
  if (length > max_message_bytes_)
  {
    *reason = "a message of " + std::to_string(length) + " bytes, at most " + std::to_string(max_message_bytes_) +
              " are taken";
    return false;
  }
  head_bytes_ = 0;
  length_ = length;
  received_ = 0;
  message_ = {};
  stage_ = Stage::MESSAGE;
  return length_ != 0 || onMessageBytes(0, sink, reason);
}

bool SpConnection::onMessageBytes(size_t count, const Sink& sink, std::string* reason)
{
  received_ += count;
  if (received_ < length_)
  {
    return true;
  }
  stage_ = Stage::LENGTH;
  return sink(std::exchange(message_, {}), reason);
}

bool SpConnection::enqueue(const std::vector<uint32_t>& ids, const std::vector<uint8_t>& body)
{
  const size_t length = 4 * ids.size() + body.size();
  if (LENGTH_BYTES + length + queued_bytes_ > max_queued_bytes_)
  {
    return false;
  }
  std::vector<uint8_t> message(LENGTH_BYTES + 4 * ids.size());
  message.reserve(LENGTH_BYTES + length);
  putBigEndian(message.data(), length, LENGTH_BYTES);
  for (size_t id = 0; id < ids.size(); ++id)
  {
    putBigEndian(message.data() + LENGTH_BYTES + 4 * id, ids[id], 4);
  }
  message.insert(message.end(), body.begin(), body.end());
  queued_bytes_ += message.size();
  outgoing_.push_back(std::move(message));
  return true;
}

bool SpConnection::flush(std::string* reason)
{
  while (!outgoing_.empty())
  {
    const std::vector<uint8_t>& first = outgoing_.front();
    const ssize_t count = send(fd_.get(), first.data() + sent_, first.size() - sent_, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count < 0)
    {
      if (errno == EINTR)
      {
        continue;
      }
      if (isTemporary(errno))
      {
        return true;
      }
      *reason = reasonOf(errno);
      return false;
    }
    sent_ += static_cast<size_t>(count);
    queued_bytes_ -= static_cast<size_t>(count);
    if (sent_ == first.size())
    {
      outgoing_.pop_front();
      sent_ = 0;
    }
  }
  return true;
}

bool takeIds(std::vector<uint8_t>* message, size_t most, std::vector<uint32_t>* ids)
{
  ids->clear();
  for (size_t at = 0; at + 4 <= message->size() && ids->size() < most; at += 4)
  {
    ids->push_back(static_cast<uint32_t>(getBigEndian(message->data() + at, 4)));
    if ((ids->back() & SpConnection::LAST_ID) != 0)
    {
      message->erase(message->begin(), message->begin() + static_cast<std::ptrdiff_t>(at + 4));
      return true;
    }
  }
  return false;
}

}  // namespace pi_offload
