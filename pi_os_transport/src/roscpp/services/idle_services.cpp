#include "roscpp/services/idle_services.h"

#include <ros/connection.h>
#include <ros/poll_manager.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "roscpp/runtime.h"

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

IdleService IdleServices::take(const std::string& key)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = std::find_if(idle_.rbegin(), idle_.rend(),
                                  [&key](const Idle& idle)
                                  { return idle.service.caller->key() == key && idle.service.caller->ready(); });
  if (found == idle_.rend())
  {
    return IdleService();
  }
  const IdleService service = found->service;
  idle_.erase(std::next(found).base());
  return service;
}

bool IdleServices::negotiates(const std::string& key)
{
  std::lock_guard<std::mutex> lock(mutex_);
  return std::any_of(idle_.begin(), idle_.end(),
                     [&key](const Idle& idle)
                     { return idle.service.caller->key() == key && idle.service.caller->promising(); });
}

void IdleServices::put(const IdleService& service)
{
  IdleService surplus;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    idle_.push_back(Idle{service, Clock::now()});
    if (idle_.size() > MOST)
    {
      surplus = idle_.front().service;
      idle_.erase(idle_.begin());
    }
    if (!std::exchange(polling_, true))
    {
      // roscpp's network thread calls its listeners at least every 100 ms.
      ros::PollManager::instance()->addPollThreadListener([this]() { dropOld(); });
    }
  }
  if (surplus.link)
  {
    surplus.link->getConnection()->drop(ros::Connection::Destructing);
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
    const auto first_old = std::stable_partition(
        idle_.begin(), idle_.end(),
        [now](const Idle& idle) { return idle.service.caller->promising() && now - idle.since < LONGEST; });
    std::move(first_old, idle_.end(), std::back_inserter(old));
    idle_.erase(first_old, idle_.end());
  }
  for (const Idle& idle : old)
  {
    idle.service.link->getConnection()->drop(ros::Connection::Destructing);
  }
}

}  // namespace pi_os_transport
