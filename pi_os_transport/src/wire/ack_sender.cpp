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
  else if (timer_ == 0)
  {
    timer_ = loop_->after(traffic_ == Traffic::EXPRESS ? ACK_DELAY : ACK_DELAY_BULK,
                          [this]()
                          {
                            timer_ = 0;
                            send();
                          });
  }
}

void AckSender::send()
{
  scheduled_ = false;
  loop_->cancel(std::exchange(timer_, 0));
  if (frames_ != acked_frames_)
  {
    acked_frames_ = frames_;
    unacked_bytes_ = 0;
    send_(frames_);
  }
}

void AckSender::reset()
{
  loop_->cancel(std::exchange(timer_, 0));
  frames_ = 0;
  acked_frames_ = 0;
  unacked_bytes_ = 0;
  scheduled_ = false;
}

}  // namespace pi_os_transport
