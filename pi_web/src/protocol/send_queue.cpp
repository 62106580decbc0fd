#include "protocol/send_queue.h"

#include <utility>

namespace pi_web
{

bool SendQueue::pushAnswer(OutMessage message)
{
  answer_bytes_ += message.size();
  bytes_ += message.size();
  answers_.push_back(std::move(message));
  return answer_bytes_ <= MAX_ANSWER_BYTES;
}

void SendQueue::dropOldest(Kept* lane)
{
  const size_t size = lane->messages.front().message.size();
  lane->bytes -= size;
  bytes_ -= size;
  lane->messages.pop_front();
}

void SendQueue::push(uint32_t lane, OutMessage message, size_t most)
{
  Kept& kept = lanes_[lane];
  const size_t size = message.size();
  kept.messages.push_back({++pushed_, std::move(message)});
  kept.bytes += size;
  bytes_ += size;
  while (kept.messages.size() > 1 && (kept.messages.size() > most || kept.bytes > MAX_LANE_BYTES || size > LARGE_BYTES))
  {
    dropOldest(&kept);
    ++dropped_;
  }
}

void SendQueue::remove(uint32_t lane)
{
  const auto kept = lanes_.find(lane);
  if (kept != lanes_.end())
  {
    bytes_ -= kept->second.bytes;
    lanes_.erase(kept);
  }
}

std::optional<OutMessage> SendQueue::next(int64_t now_ns)
{
  if (under_way_any_)
  {
    return std::nullopt;
  }
  OutMessage message;
  if (!answers_.empty())
  {
    message = std::move(answers_.front());
    answers_.pop_front();
    answer_bytes_ -= message.size();
    bytes_ -= message.size();
    under_way_large_ = false;
    under_way_.reset();
  }
  else
  {
    auto best = lanes_.end();
    bool best_is_large = false;
    for (auto lane = lanes_.begin(); lane != lanes_.end(); ++lane)
    {
      const Waiting& front = lane->second.messages.front();
      const bool large = front.message.size() > LARGE_BYTES;
      const bool may = !large || now_ns >= large_from_ns_;
      if (may && (best == lanes_.end() || std::make_pair(large, front.number) <
                                              std::make_pair(best_is_large, best->second.messages.front().number)))
      {
        best = lane;
        best_is_large = large;
      }
    }
    if (best == lanes_.end())
    {
      return std::nullopt;
    }
    message = best->second.messages.front().message;
    dropOldest(&best->second);
    under_way_ = best->first;
    under_way_large_ = best_is_large;
    if (best->second.messages.empty())
    {
      lanes_.erase(best);
    }
  }
  under_way_any_ = true;
  began_ns_ = now_ns;
  return message;
}

void SendQueue::sent(int64_t now_ns)
{
  if (under_way_large_)
  {
    large_from_ns_ = now_ns + (now_ns - began_ns_);
  }
  under_way_any_ = false;
  under_way_large_ = false;
  under_way_.reset();
}

std::optional<int64_t> SendQueue::readyAt() const
{
  // Small ones would have been sent at once: what waits beside nothing under way is large.
  return under_way_any_ || lanes_.empty() ? std::nullopt : std::optional<int64_t>(large_from_ns_);
}

}  // namespace pi_web
