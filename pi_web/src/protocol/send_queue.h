#pragma once

#include "protocol/messages.h"

#include <cstdint>
#include <deque>
#include <map>
#include <optional>

namespace pi_web
{

/// What waits to be sent to one client. Answers go first, then small messages in the order of arrival, large ones last.
/// After a large message the next one waits as long as that one took, so that at least half of the connection's time is
/// left to small ones. A lane (one subscription) holds a bounded number of messages, of which the newest stay. Not
/// thread safe.
class SendQueue
{
public:
  static constexpr size_t LARGE_BYTES = 64 * 1024;      ///< above: a large message
  static constexpr size_t MAX_LANE_BYTES = 512 * 1024;  ///< of several small messages in a lane
  static constexpr size_t MAX_ANSWER_BYTES = 16 * 1024 * 1024;

  /// @return false if too many answers wait: the client reads none of them, and is to be disconnected.
  bool pushAnswer(OutMessage message);
  /// @param most  messages in the lane, at least 1; a large message is alone in its lane.
  void push(uint32_t lane, OutMessage message, size_t most);
  /// Forgets what waits in a lane.
  void remove(uint32_t lane);

  /// The next message; it counts as under way until sent() is called.
  /// @param now_ns  steady clock.
  std::optional<OutMessage> next(int64_t now_ns);
  void sent(int64_t now_ns);
  /// When next() may have a message, if it has none now: [ns] of the steady clock; nullopt: after the next push.
  std::optional<int64_t> readyAt() const;

  /// Nothing of this lane waits or is under way: the client has taken all before.
  bool isTaken(uint32_t lane) const { return lanes_.count(lane) == 0 && under_way_ != std::optional<uint32_t>(lane); }
  bool isIdle() const { return !under_way_any_; }
  /// Messages that newer ones replaced.
  uint64_t dropped() const { return dropped_; }
  size_t bytes() const { return bytes_; }

private:
  struct Waiting
  {
    uint64_t number = 0;
    OutMessage message;
  };
  using Lane = std::deque<Waiting>;
  struct Kept
  {
    Lane messages;
    size_t bytes = 0;
  };
  void dropOldest(Kept* lane);

  std::deque<OutMessage> answers_;
  std::map<uint32_t, Kept> lanes_;  ///< none of them is empty
  size_t answer_bytes_ = 0;
  size_t bytes_ = 0;
  uint64_t pushed_ = 0;
  uint64_t dropped_ = 0;
  bool under_way_any_ = false;
  bool under_way_large_ = false;
  std::optional<uint32_t> under_way_;  ///< its lane
  int64_t began_ns_ = 0;
  int64_t large_from_ns_ = 0;
};

}  // namespace pi_web
