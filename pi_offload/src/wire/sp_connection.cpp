#include "wire/sp_connection.h"

#include <algorithm>
#include <array>
#include <utility>

#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

using pi_os_transport::SP_LENGTH_BYTES;
using pi_os_transport::SpReader;
using pi_os_transport::SpSocket;

constexpr size_t BUFFER_BYTES = 64U << 10U;
/// Budget of one connection before the others have their turn.
constexpr size_t BYTES_PER_TURN = 1U << 20U;
/// Memory for a message grows with the received bytes, not with the announced length.
constexpr size_t FIRST_ROOM = 64U << 10U;

std::string reasonOf(int error)
{
  return error == ECONNRESET || error == EPIPE ? "closed by the other end" : errorText(error);
}

}  // namespace

SpConnection::SpConnection(pi_node::UniqueFd fd, Type own_type, Type peer_type, size_t max_message_bytes,
                           size_t max_queued_bytes)
  : fd_(std::move(fd))
  , own_type_(own_type)
  , peer_type_(peer_type)
  , max_message_bytes_(max_message_bytes)
  , max_queued_bytes_(max_queued_bytes)
  , reader_(peer_type, SP_LENGTH_BYTES)
{
}

bool SpConnection::receive(const Taker& taker, std::string* reason)
{
  taker_ = &taker;
  reason_ = reason;
  std::array<uint8_t, BUFFER_BYTES> buffer;
  const SpReader::Result result = reader_.receive(SpSocket{fd_.get()}, buffer.data(), buffer.size(), BYTES_PER_TURN, this);
  switch (result.end)
  {
    case SpReader::End::CLOSED:
      *reason = "closed by the other end";
      break;
    case SpReader::End::FAILED:
      *reason = reasonOf(result.error);
      break;
    case SpReader::End::NO_PEER:
      *reason = std::string("the other end is not an SP ") + (peer_type_ == Type::REQ ? "REQ" : "REP") + " socket";
      break;
    case SpReader::End::REFUSED:  // the reason is set
    case SpReader::End::NONE:
      break;
  }
  return result.end == SpReader::End::NONE;
}

bool SpConnection::onLength(uint64_t length)
{
  message_ = {};
  if (length > max_message_bytes_)
  {
    *reason_ = "a message of " + std::to_string(length) + " bytes, at most " + std::to_string(max_message_bytes_) +
               " are taken";
    return false;
  }
  return true;
}

iovec SpConnection::place(size_t missing)
{
  const size_t received = message_.size();
  message_.resize(received + std::min(missing, std::max(received, FIRST_ROOM)));
  return {message_.data() + received, message_.size() - received};
}

bool SpConnection::onMessage()
{
  return (*taker_)(std::exchange(message_, {}), reason_);
}

bool SpConnection::greet(std::string* reason)
{
  const int error = pi_os_transport::sendSpHeader(SpSocket{fd_.get()}, own_type_);
  if (error != 0)
  {
    *reason = reasonOf(error);
  }
  return error == 0;
}

bool SpConnection::enqueue(const std::vector<uint32_t>& ids, const std::vector<uint8_t>& body)
{
  const size_t length = 4 * ids.size() + body.size();
  if (SP_LENGTH_BYTES + length + waiting_bytes_ + writer_.unsentBytes() > max_queued_bytes_)
  {
    return false;
  }
  std::vector<uint8_t> message(SP_LENGTH_BYTES + 4 * ids.size());
  message.reserve(SP_LENGTH_BYTES + length);
  pi_os_transport::storeBigEndian<uint64_t>(message.data(), length);
  for (size_t id = 0; id < ids.size(); ++id)
  {
    pi_os_transport::storeBigEndian(message.data() + SP_LENGTH_BYTES + 4 * id, ids[id]);
  }
  message.insert(message.end(), body.begin(), body.end());
  waiting_bytes_ += message.size();
  outgoing_.push_back(std::move(message));
  return true;
}

bool SpConnection::flush(std::string* reason)
{
  while (!outgoing_.empty())
  {
    int error = 0;
    if (writer_.idle())
    {
      std::vector<uint8_t>& first = outgoing_.front();
      waiting_bytes_ -= first.size();
      const iovec piece{first.data(), first.size()};
      error = writer_.begin(SpSocket{fd_.get()}, &piece, 1);
    }
    else
    {
      error = writer_.resume(SpSocket{fd_.get()});
    }
    if (error != 0)
    {
      *reason = reasonOf(error);
      return false;
    }
    if (!writer_.idle())
    {
      return true;
    }
    outgoing_.pop_front();
  }
  return true;
}

bool takeIds(std::vector<uint8_t>* message, size_t most, std::vector<uint32_t>* ids)
{
  ids->clear();
  for (size_t at = 0; at + 4 <= message->size() && ids->size() < most; at += 4)
  {
    ids->push_back(pi_os_transport::loadBigEndian<uint32_t>(message->data() + at));
    if ((ids->back() & SpConnection::LAST_ID) != 0)
    {
      message->erase(message->begin(), message->begin() + static_cast<std::ptrdiff_t>(at + 4));
      return true;
    }
  }
  return false;
}

}  // namespace pi_offload
