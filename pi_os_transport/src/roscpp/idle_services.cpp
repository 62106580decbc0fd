#include "idle_services.h"

#include <ros/connection.h>
#include <ros/poll_manager.h>

#include <algorithm>
#include <utility>

#include "runtime.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST = 16;
constexpr std::chrono::seconds LONGEST{5};

}  // namespace

IdleServices& IdleServices::instance()
{
  static IdleServices* services = new IdleServices;
  return *services;
}

ros::ServiceServerLinkPtr IdleServices::take(const std::string& key)
{
  std::lock_guard<std::mutex> lock(mutex_);
  for (size_t index = idle_.size(); index-- > 0;)
  {
    if (idle_[index].key == key)
    {
      ros::ServiceServerLinkPtr link = std::move(idle_[index].link);
      idle_.erase(idle_.begin() + static_cast<std::ptrdiff_t>(index));
      if (link->isValid())
      {
        return link;
      }
    }
  }
  return ros::ServiceServerLinkPtr();
}

void IdleServices::put(const std::string& key, const ros::ServiceServerLinkPtr& link)
{
  ros::ServiceServerLinkPtr surplus;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    idle_.push_back(Idle{key, link, Clock::now()});
    if (idle_.size() > MOST)
    {
      surplus = std::move(idle_.front().link);
      idle_.erase(idle_.begin());
    }
    if (!std::exchange(polling_, true))
    {
      // roscpp's network thread comes round at least every 100 ms.
      ros::PollManager::instance()->addPollThreadListener([this]() { dropOld(); });
    }
  }
  if (surplus)
  {
    surplus->getConnection()->drop(ros::Connection::Destructing);
  }
}

void IdleServices::dropOld()
{
  if (!Runtime::instance().active())
  {
    return;
  }
  std::vector<Idle> old;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const Clock::time_point now = Clock::now();
    const auto first_kept =
        std::find_if(idle_.begin(), idle_.end(),
                     [now](const Idle& idle) { return idle.link->isValid() && now - idle.since < LONGEST; });
    std::move(idle_.begin(), first_kept, std::back_inserter(old));
    idle_.erase(idle_.begin(), first_kept);
  }
  for (const Idle& idle : old)
  {
    idle.link->getConnection()->drop(ros::Connection::Destructing);
  }
}

}  // namespace pi_os_transport
