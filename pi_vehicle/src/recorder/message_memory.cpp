#include "recorder/message_memory.h"

#include <algorithm>

namespace pi_vehicle::recorder
{

/// Latched messages take at most this part of the memory beyond their time, the newest ones.
constexpr size_t LATCHED_PART = 4;

const std::string& Channel::field(const std::string& name) const
{
  static const std::string none;
  const auto found = header.find(name);
  return found == header.end() ? none : found->second;
}

MessageMemory::MessageMemory(size_t max_bytes, int64_t keep_ns) : max_bytes_(max_bytes), keep_ns_(keep_ns) {}

void MessageMemory::add(KeptMessagePtr message)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  usage_.bytes += message->cost();
  if (message->channel->isLatching())
  {
    keepLatched(message);
  }
  now_ns_ = std::max(now_ns_, message->elapsed_ns);
  messages_.push_back(std::move(message));
  forget();
}

void MessageMemory::keepLatched(const KeptMessagePtr& message)
{
  KeptMessagePtr& last = latched_[{message->channel->topic, message->channel->field("callerid")}];
  latched_bytes_ += message->cost() - (last ? last->cost() : 0);
  last = message;
  while (latched_bytes_ > max_bytes_ / LATCHED_PART)
  {
    const auto oldest =
        std::min_element(latched_.begin(), latched_.end(),
                         [](const auto& a, const auto& b) { return a.second->elapsed_ns < b.second->elapsed_ns; });
    latched_bytes_ -= oldest->second->cost();
    latched_.erase(oldest);
  }
}

void MessageMemory::advance(int64_t now_ns)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  now_ns_ = std::max(now_ns_, now_ns);
  forget();
}

void MessageMemory::pin(uint64_t from)
{
  const std::lock_guard<std::mutex> lock(mutex_);
  pinned_ = from;
}

void MessageMemory::forget()
{
  while (!messages_.empty())
  {
    const bool old = messages_.front()->elapsed_ns < now_ns_ - keep_ns_;
    const bool too_many = usage_.bytes + latched_bytes_ > max_bytes_;
    if (!too_many && (!old || first_ >= pinned_))
    {
      return;
    }
    if (!old)
    {
      ++usage_.forgotten;
      usage_.forgot_ns = now_ns_;
    }
    usage_.bytes -= messages_.front()->cost();
    messages_.pop_front();
    ++first_;
  }
}

MessageMemory::Batch MessageMemory::read(uint64_t from, size_t most, int64_t until_ns) const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  Batch batch;
  batch.missed = from < first_ ? first_ - from : 0;
  batch.next = std::max(from, first_);
  const uint64_t end = first_ + messages_.size();
  for (; batch.next < end && batch.messages.size() < most; ++batch.next)
  {
    const KeptMessagePtr& message = messages_[batch.next - first_];
    if (message->elapsed_ns > until_ns)
    {
      break;
    }
    batch.messages.push_back(message);
  }
  batch.at_end = batch.next >= end || messages_[batch.next - first_]->elapsed_ns > until_ns;
  batch.complete_ns = now_ns_;
  return batch;
}

uint64_t MessageMemory::firstSince(int64_t elapsed_ns) const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found =
      std::lower_bound(messages_.begin(), messages_.end(), elapsed_ns,
                       [](const KeptMessagePtr& message, int64_t time) { return message->elapsed_ns < time; });
  return first_ + static_cast<uint64_t>(found - messages_.begin());
}

uint64_t MessageMemory::end() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return first_ + messages_.size();
}

int64_t MessageMemory::completeNs() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return now_ns_;
}

std::vector<KeptMessagePtr> MessageMemory::latched() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<KeptMessagePtr> messages;
  for (const auto& entry : latched_)
  {
    messages.push_back(entry.second);
  }
  std::sort(messages.begin(), messages.end(),
            [](const KeptMessagePtr& a, const KeptMessagePtr& b) { return a->elapsed_ns < b->elapsed_ns; });
  return messages;
}

MessageMemory::Usage MessageMemory::usage() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  Usage usage = usage_;
  usage.bytes += latched_bytes_;
  usage.messages = messages_.size();
  usage.seconds = messages_.empty() ? 0.0 : 1e-9 * static_cast<double>(now_ns_ - messages_.front()->elapsed_ns);
  return usage;
}

}  // namespace pi_vehicle::recorder
