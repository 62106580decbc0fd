#include "simulation/oracle.h"

#include <algorithm>

namespace pi_offload::simulation
{

std::optional<int64_t> foreseeEnd(const EdgeNode& node, std::vector<PendingArrival> pending, const PendingArrival& mine,
                                  int64_t limit_ns)
{
  EdgeNode copy = node;
  const uint64_t ticket = mine.arrival.task.ticket;
  pending.push_back(mine);
  std::stable_sort(pending.begin(), pending.end(),
                   [](const PendingArrival& a, const PendingArrival& b) { return a.at_ns < b.at_ns; });
  std::vector<EdgeNode::End> ends;
  const auto find = [&]
  { return std::find_if(ends.begin(), ends.end(), [&](const EdgeNode::End& end) { return end.ticket == ticket; }); };
  for (const PendingArrival& next : pending)
  {
    if (next.at_ns > limit_ns || find() != ends.end())
    {
      break;
    }
    copy.advance(next.at_ns, &ends);
    const Admission::Verdict verdict = copy.arrive(next.arrival, &ends);
    if (next.arrival.task.ticket == ticket && verdict != Admission::Verdict::TAKEN)
    {
      return std::nullopt;
    }
  }
  while (find() == ends.end() && copy.nextTime() <= limit_ns)
  {
    copy.advance(copy.nextTime(), &ends);
  }
  const auto end = find();
  return end != ends.end() && end->done ? std::optional<int64_t>(end->at_ns) : std::nullopt;
}

}  // namespace pi_offload::simulation
