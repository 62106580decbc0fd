#include "pi_os_transport/zero_copy/statistics.h"

#include <ros/console.h>

#include <map>
#include <mutex>
#include <sstream>
#include <utility>

#include "pi_os_transport/zero_copy/arena.h"

namespace pi_os_transport::zero_copy
{
namespace
{

struct Registry
{
  static Registry& instance()
  {
    static Registry* registry = new Registry;  // messages may be published by static destructors
    return *registry;
  }

  std::mutex mutex;
  std::map<std::pair<std::string, bool>, std::shared_ptr<TopicCounters>> counters;  ///< by topic; true: publisher
};

}  // namespace

void TopicCounters::countSent(Sent what, bool from_heap)
{
  sent_[what].fetch_add(1, std::memory_order_relaxed);
  if (from_heap)
  {
    from_heap_.fetch_add(1, std::memory_order_relaxed);
  }
  if (what == NO_ROOM && !warned_.exchange(true))
  {
    ROS_WARN(
        "pi_os_transport: messages on %s are copied: what surrounds their largest array takes more than the %zu bytes "
        "before or the %zu bytes behind it, or its elements are padded. Shorten the strings, or publish the smaller "
        "arrays on a topic of their own",
        topic_.c_str(), MemoryBlock::HEADROOM, MemoryBlock::TAILROOM);
  }
}

TopicStatistics TopicCounters::read() const
{
  TopicStatistics now;
  now.topic = topic_;
  now.publisher = publisher_;
  now.in_place = sent_[IN_PLACE];
  now.small = sent_[SMALL];
  now.no_room = sent_[NO_ROOM];
  now.from_heap = from_heap_;
  now.viewed = received_[VIEWED];
  now.without_large = received_[WITHOUT_LARGE];
  now.misaligned = received_[MISALIGNED];
  now.copied = received_[COPIED];
  return now;
}

std::string TopicStatistics::toString() const
{
  std::ostringstream line;
  if (publisher)
  {
    line << topic << ": published " << in_place << " in place (" << from_heap << " of them not in shared memory), "
         << small + no_room << " copied (" << small << " small, " << no_room << " without room around the array)";
  }
  else
  {
    line << topic << ": received " << viewed << " as views, " << without_large << " without large arrays, "
         << misaligned + copied << " copied (" << misaligned << " misaligned, " << copied
         << " not in shared memory or beyond what may be held)";
  }
  return line.str();
}

std::shared_ptr<TopicCounters> countersOf(const std::string& topic, bool publisher)
{
  Registry& registry = Registry::instance();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  std::shared_ptr<TopicCounters>& counters = registry.counters[{topic, publisher}];
  if (!counters)
  {
    counters = std::make_shared<TopicCounters>(topic, publisher);
  }
  return counters;
}

bool isZeroCopyTopic(const std::string& topic)
{
  Registry& registry = Registry::instance();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  return registry.counters.count({topic, true}) != 0;
}

std::vector<TopicStatistics> statistics()
{
  Registry& registry = Registry::instance();
  const std::lock_guard<std::mutex> lock(registry.mutex);
  std::vector<TopicStatistics> all;
  for (const auto& entry : registry.counters)
  {
    all.push_back(entry.second->read());
  }
  return all;
}

}  // namespace pi_os_transport::zero_copy
