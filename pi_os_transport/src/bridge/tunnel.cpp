#include "bridge/tunnel.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string_view>
#include <utility>

#include "event_loop/if_alive.h"
#include "event_loop/socket_io.h"

namespace pi_os_transport
{
namespace
{

/// Most bytes under way in one direction [B].
constexpr uint64_t WINDOW = 2 << 20;
/// The peer gets new credit after this many bytes [B].
constexpr uint64_t CREDIT_STEP = 256 << 10;
/// Size of a read while the tunnel is EXPRESS. After a full read there is more data, and the tunnel becomes BULK [B].
constexpr uint32_t EXPRESS_CHUNK = 16 << 10;

}  // namespace

Tunnel::Tunnel(EventLoop* loop, Peer* peer, uint32_t id, Side side, FileDescriptor socket, std::string target,
               std::function<void()> on_closed)
  : loop_(loop)
  , peer_(peer)
  , id_(id)
  , side_(side)
  , socket_(std::move(socket))
  , target_(std::move(target))
  , on_closed_(std::move(on_closed))
  , connected_(side == Side::CLIENT)
{
}

Tunnel::~Tunnel()
{
  if (events_ != 0)
  {
    loop_->remove(socket_.get());
  }
}

void Tunnel::start()
{
  setOption(socket_.get(), IPPROTO_TCP, TCP_NODELAY, 1);
  events_ = connected_ ? EPOLLIN : EPOLLOUT;
  loop_->add(socket_.get(), events_, [self = this](uint32_t events) { self->onSocket(events); });
}

FrameHeader Tunnel::headerOf(FrameType type, uint64_t offset) const
{
  return FrameHeader::of(type, side_ == Side::SERVER ? id_ | SERVER_BIT : id_, 0, offset);
}

void Tunnel::onSocket(uint32_t events)
{
  const std::shared_ptr<Tunnel> self = shared_from_this();
  if (!connected_)
  {
    const int error = connectionError(socket_.get());
    if (error != 0)
    {
      local_end_ = true;
      sendClose(true, target_ + ": " + std::strerror(error));
      finish();
      return;
    }
    connected_ = true;
    peer_->control(headerOf(FrameType::TUNNEL_READY));
  }
  if ((events & EPOLLOUT) != 0)
  {
    onWritable();
  }
  if (socket_ && (events & (EPOLLIN | EPOLLHUP | EPOLLERR)) != 0)
  {
    onReadable();
  }
  if (socket_)
  {
    updateEvents();
  }
}

void Tunnel::onReadable()
{
  if (local_end_ || next_ || !resend_.empty() || read_ - credit_ >= WINDOW)
  {
    return;
  }
  auto chunk = std::make_shared<Chunk>();
  chunk->offset = read_;
  const uint32_t most = traffic_ == Traffic::BULK ? peer_->lane(Traffic::BULK).fragmentBytes() : EXPRESS_CHUNK;
  chunk->bytes.resize(most);
  const ssize_t count = TEMP_FAILURE_RETRY(recv(socket_.get(), chunk->bytes.data(), most, MSG_DONTWAIT));
  if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK))
  {
    return;
  }
  if (count <= 0)
  {
    local_end_ = true;
    sendClose(false, "");
    if (end_known_ && written_ == end_)
    {
      finish();
    }
    return;
  }
  chunk->bytes.resize(static_cast<size_t>(count));
  read_ += static_cast<uint64_t>(count);
  next_ = std::move(chunk);
  peer_->offer(shared_from_this());
  peer_->pump();
}

bool Tunnel::sendNext(Peer*, Lane* lane)
{
  if (!next_ && !resend_.empty())
  {
    next_ = resend_.front();
    resend_.pop_front();
  }
  if (!next_)
  {
    return false;
  }
  const Traffic wanted = next_->bytes.size() >= EXPRESS_CHUNK ? Traffic::BULK
                         : unacked_.empty()                   ? Traffic::EXPRESS
                                                              : traffic_;
  if (wanted != traffic_)
  {
    if (unacked_.empty())
    {
      traffic_ = wanted;
      peer_->offer(shared_from_this());
    }
    return false;  // frames of the old class have to arrive first
  }
  FrameHeader header = headerOf(FrameType::TUNNEL_DATA, next_->offset);
  header.session = peer_->theirSecret();
  const iovec piece{next_->bytes.data(), next_->bytes.size()};
  const auto acknowledged = ifAlive(weak_from_this(), [](const auto& self) { self->onAcknowledged(); });
  if (!lane->send(header, &piece, 1, next_, acknowledged))
  {
    peer_->offer(shared_from_this());
    return false;
  }
  unacked_.push_back(std::exchange(next_, nullptr));
  if (resend_.empty() && socket_)
  {
    onReadable();
    if (socket_)
    {
      updateEvents();
    }
  }
  return next_ != nullptr || !resend_.empty();
}

void Tunnel::onAcknowledged()
{
  if (!unacked_.empty())
  {
    unacked_.pop_front();
  }
  if (unacked_.empty() && next_)
  {
    peer_->offer(shared_from_this());
  }
}

bool Tunnel::onData(const FrameHeader& header, const uint8_t* payload, uint32_t length)
{
  if (header.offset > received_ || received_ - written_ + length > WINDOW + MAX_PAYLOAD ||
      (end_known_ && header.offset + length > end_))
  {
    return false;
  }
  const uint64_t known = received_ - header.offset;  // received before the last interruption
  if (known < length)
  {
    to_write_.emplace_back(payload + known, payload + length);
    received_ = header.offset + length;
    if (connected_)
    {
      onWritable();
      if (socket_)
      {
        updateEvents();
      }
    }
  }
  return true;
}

void Tunnel::onWritable()
{
  while (!to_write_.empty())
  {
    const std::string_view front(reinterpret_cast<const char*>(to_write_.front().data()), to_write_.front().size());
    const size_t before = first_offset_;
    const SendResult result = sendRest(socket_.get(), front, &first_offset_);
    written_ += first_offset_ - before;
    if (result == SendResult::FAILED)
    {
      finish();
      return;
    }
    if (result == SendResult::BLOCKED)
    {
      break;
    }
    to_write_.pop_front();
    first_offset_ = 0;
  }
  sendCredit();
  if (end_known_ && written_ >= end_)
  {
    finish();
  }
}

void Tunnel::sendCredit()
{
  if (written_ - credited_ >= CREDIT_STEP)
  {
    credited_ = written_;
    peer_->control(headerOf(FrameType::TUNNEL_CREDIT, written_));
  }
}

bool Tunnel::onCredit(const FrameHeader& header)
{
  if (header.offset > read_)
  {
    return false;
  }
  credit_ = std::max(credit_, header.offset);
  if (connected_)
  {
    onReadable();
    if (socket_)
    {
      updateEvents();
    }
  }
  return true;
}

void Tunnel::onClose(const FrameHeader& header)
{
  const std::shared_ptr<Tunnel> self = shared_from_this();
  end_known_ = true;
  end_ = header.count != 0 ? written_ : header.offset;
  if (written_ >= end_)
  {
    finish();
  }
}

void Tunnel::sendClose(bool at_once, const std::string& reason)
{
  FrameHeader header = headerOf(FrameType::TUNNEL_CLOSE, read_);
  header.count = at_once ? 1 : 0;
  peer_->control(header, encodeText(reason));
}

void Tunnel::updateEvents()
{
  const bool wants_more = connected_ && !local_end_ && !next_ && resend_.empty() && read_ - credit_ < WINDOW;
  const uint32_t events =
      (wants_more ? uint32_t{EPOLLIN} : 0u) | (!connected_ || !to_write_.empty() ? uint32_t{EPOLLOUT} : 0u);
  if (events == events_)
  {
    return;
  }
  // A socket with nothing to wait for is not watched: its hang-up would be reported without end.
  if (events == 0)
  {
    loop_->remove(socket_.get());
  }
  else if (events_ == 0)
  {
    loop_->add(socket_.get(), events, [self = this](uint32_t ready) { self->onSocket(ready); });
  }
  else
  {
    loop_->change(socket_.get(), events);
  }
  events_ = events;
}

void Tunnel::rewind()
{
  resend_.insert(resend_.begin(), unacked_.begin(), unacked_.end());
  unacked_.clear();
  if (next_)
  {
    resend_.push_back(std::exchange(next_, nullptr));
  }
}

void Tunnel::finish()
{
  if (!socket_)
  {
    return;
  }
  if (!std::exchange(local_end_, true))
  {
    sendClose(true, "");  // the other side waits for this frame
  }
  if (events_ != 0)
  {
    loop_->remove(socket_.get());
    events_ = 0;
  }
  socket_.reset();
  next_.reset();
  if (const std::function<void()> closed = std::exchange(on_closed_, nullptr))
  {
    loop_->defer(closed);  // the caller may still use this tunnel
  }
}

}  // namespace pi_os_transport
