#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <utility>

#include "event_loop/event_loop.h"
#include "wire/lane.h"

namespace pi_os_transport
{

/// The receiving half of one traffic class from one peer: counts the frames and acknowledges them, small ones together.
class AckSender : public std::enable_shared_from_this<AckSender>
{
public:
  /// @param send  sends an acknowledgement of all `frames` received so far
  AckSender(EventLoop* loop, Traffic traffic, std::function<void(uint64_t frames)> send)
    : loop_(loop), traffic_(traffic), send_(std::move(send))
  {
  }

  /// A frame was received and processed. @param now  the peer waits for the acknowledgement.
  void onFrame(uint32_t bytes, bool now);
  /// Both sides start counting again.
  void reset();

private:
  void send();

  EventLoop* const loop_;
  const Traffic traffic_;
  const std::function<void(uint64_t frames)> send_;
  uint64_t frames_ = 0;
  uint64_t acked_frames_ = 0;
  uint64_t unacked_bytes_ = 0;
  bool scheduled_ = false;  ///< send() follows in this round of the loop
  Timer timer_;
};

}  // namespace pi_os_transport
