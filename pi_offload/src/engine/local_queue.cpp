#include "engine/local_queue.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_offload
{

LocalQueue::LocalQueue(size_t max_waiting, double lost_s) : max_waiting_(max_waiting), lost_s_(lost_s)
{
  if (max_waiting == 0)
  {
    throw std::invalid_argument("max_waiting = 0, must be at least 1");
  }
  if (!(lost_s > 0.0))
  {
    throw std::invalid_argument("lost_s = " + std::to_string(lost_s) + ", must be above 0");
  }
}

std::optional<LocalQueue::Entry> LocalQueue::add(const Entry& entry)
{
  waiting_.push_back(entry);
  if (waiting_.size() <= max_waiting_)
  {
    return std::nullopt;
  }
  const Entry oldest = waiting_.front();
  waiting_.pop_front();
  return oldest;
}

std::optional<LocalQueue::Entry> LocalQueue::next(int64_t now_ns, double local_s, std::vector<Entry>* dropped)
{
  if (working_ && workingFor(now_ns) > lost_s_)
  {
    dropped->push_back(*working_);
    working_.reset();
  }
  if (working_)
  {
    return std::nullopt;
  }
  const int64_t done_ns = now_ns + std::llround(1e9 * local_s);
  while (waiting_.size() > 1 && waiting_.front().deadline_ns < done_ns)
  {
    dropped->push_back(waiting_.front());
    waiting_.pop_front();
  }
  if (waiting_.empty())
  {
    return std::nullopt;
  }
  working_ = waiting_.front();
  began_ns_ = now_ns;
  waiting_.pop_front();
  return working_;
}

LocalQueue::Answer LocalQueue::answered(int64_t stamp_ns, int64_t now_ns)
{
  Answer answer;
  if (!working_ || stamp_ns < working_->stamp_ns)
  {
    return answer;
  }
  answer.expected = true;
  answer.task = working_->task;
  answer.work_s = workingFor(now_ns);
  answer.skipped = stamp_ns > working_->stamp_ns;
  working_.reset();
  return answer;
}

bool LocalQueue::forget(uint64_t task)
{
  const auto entry =
      std::find_if(waiting_.begin(), waiting_.end(), [task](const Entry& other) { return other.task == task; });
  if (entry == waiting_.end())
  {
    return false;
  }
  waiting_.erase(entry);
  return true;
}

bool LocalQueue::giveUp(uint64_t task)
{
  if (!working_ || working_->task != task)
  {
    return false;
  }
  working_.reset();
  return true;
}

std::vector<LocalQueue::Entry> LocalQueue::clear()
{
  std::vector<Entry> entries(waiting_.begin(), waiting_.end());
  if (working_)
  {
    entries.insert(entries.begin(), *working_);
  }
  waiting_.clear();
  working_.reset();
  return entries;
}

double LocalQueue::workingFor(int64_t now_ns) const
{
  return working_ ? 1e-9 * static_cast<double>(now_ns - began_ns_) : 0.0;
}

}  // namespace pi_offload
