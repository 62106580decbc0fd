#include "wire/ack_sender.h"

#include "event_loop/if_alive.h"

namespace pi_os_transport
{
namespace
{

/// Small frames are acknowledged together, after this time or after ACK_BYTES.
constexpr std::chrono::milliseconds ACK_DELAY{20};
constexpr std::chrono::milliseconds ACK_DELAY_BULK{2};
constexpr uint64_t ACK_BYTES = 64 << 10;

}  // namespace

void AckSender::onFrame(uint32_t bytes, bool now)
{
  ++frames_;
  unacked_bytes_ += bytes;
  if (scheduled_)
  {
    return;
  }
  if (now || (traffic_ == Traffic::EXPRESS && unacked_bytes_ >= ACK_BYTES))
  {
    scheduled_ = true;
    loop_->defer(ifAlive(weak_from_this(), [](const auto& self) { self->send(); }));
  }
  else if (!timer_.running())
  {
    timer_.start(loop_, traffic_ == Traffic::EXPRESS ? ACK_DELAY : ACK_DELAY_BULK, [this]() { send(); });
  }
}

void AckSender::send()
{
  scheduled_ = false;
  timer_.stop();
  if (frames_ != acked_frames_)
  {
    acked_frames_ = frames_;
    unacked_bytes_ = 0;
    send_(frames_);
  }
}

void AckSender::reset()
{
  timer_.stop();
  frames_ = 0;
  acked_frames_ = 0;
  unacked_bytes_ = 0;
  scheduled_ = false;
}

}  // namespace pi_os_transport
