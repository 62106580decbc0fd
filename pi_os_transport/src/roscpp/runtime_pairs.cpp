// The connections of a process with the library to others, see Runtime.

#include <poll.h>
#include <ros/console.h>
#include <ros/poll_manager.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "bridge/bridge_request.h"
#include "roscpp/runtime.h"
#include "roscpp/topics/header_offer.h"
#include "shm/event.h"

namespace pi_os_transport
{

WakeLayout* Runtime::wakeLayout()
{
  std::call_once(wake_made_,
                 [this]()
                 {
                   std::string shortage;
                   wake_memory_ = makeSharedMemory("pi_os_wake", sizeof(WakeLayout), &shortage);
                   wake_mapping_ =
                       wake_memory_ ? SharedMapping(wake_memory_.get(), sizeof(WakeLayout), true) : SharedMapping();
                   wake_layout_ = reinterpret_cast<WakeLayout*>(wake_mapping_.data());
                   if (wake_layout_ != nullptr)
                   {
                     wake_layout_->magic = WakeLayout::MAGIC;
                     sealSharedMemory(wake_memory_.get(), false);
                   }
                 });
  return wake_layout_;
}

std::shared_ptr<const ProcessPair::Host> Runtime::host()
{
  std::call_once(host_made_, [this]() { host_ = makeHost(); });
  return host_;
}

std::shared_ptr<const ProcessPair::Host> Runtime::makeHost()
{
  auto made = std::make_shared<ProcessPair::Host>();
  {
    std::lock_guard<std::mutex> lock(listen_mutex_);
    listenLocked();
    made->token = socket_token_;
  }
  made->wake_memory = wakeLayout() != nullptr ? wake_memory_.get() : -1;
  made->on_hello = [this](const std::shared_ptr<ProcessPair>& pair, const Packet& hello) { return greet(pair, hello); };
  made->want_write = [](ProcessPair* pair, bool wanted)
  {
    ros::PollSet& polls = ros::PollManager::instance()->getPollSet();
    wanted ? polls.addEvents(pair->fd(), POLLOUT) : polls.delEvents(pair->fd(), POLLOUT);
  };
  made->receive_soon = [this](const std::shared_ptr<ProcessPair>& pair)
  {
    later(
        [this, pair]()
        {
          if (!pair->ended() && !pair->receive())
          {
            endPair(pair);
          }
        });
  };
  made->on_shortage = [this](const std::string& shortage) { warnOfShortage(shortage); };
  return made;
}

std::shared_ptr<ProcessPair> Runtime::addPair(SideChannel channel, const Token& token, bool bridge)
{
  std::string shortage;
  const bool can_work_later = later([]() {});
  shortage = can_work_later ? "" : describeShortage(errno);
  const std::shared_ptr<ProcessPair> pair =
      can_work_later ? ProcessPair::make(std::move(channel), host(), &shortage) : nullptr;
  if (!pair)
  {
    if (!shortage.empty())
    {
      warnOfShortage(shortage);
    }
    return nullptr;
  }
  {
    std::lock_guard<std::mutex> lock(pairs_mutex_);
    known_pairs_.push_back(KnownPair{pair, token, bridge});
    auto all = std::make_shared<Pairs>(*pairs_);
    all->push_back(pair);
    pairs_ = std::move(all);
  }
  watch(pair->fd(),
        [this, pair](int events)
        {
          if (pair->ended())
          {
            return;
          }
          if ((events & POLLOUT) != 0)
          {
            pair->flush();
          }
          if (!pair->receive())
          {
            endPair(pair);
          }
        });
  return pair;
}

void Runtime::endPair(const std::shared_ptr<ProcessPair>& pair)
{
  {
    std::lock_guard<std::mutex> lock(pairs_mutex_);
    known_pairs_.erase(std::remove_if(known_pairs_.begin(), known_pairs_.end(),
                                      [&pair](const KnownPair& known) { return known.pair == pair; }),
                       known_pairs_.end());
    auto rest = std::make_shared<Pairs>(*pairs_);
    rest->erase(std::remove(rest->begin(), rest->end(), pair), rest->end());
    pairs_ = std::move(rest);
  }
  unwatch(pair->fd());
  pair->end();
}

std::shared_ptr<ProcessPair> Runtime::pairWith(const Token& socket, Fallback* reason)
{
  {
    std::lock_guard<std::mutex> lock(pairs_mutex_);
    for (const KnownPair& known : known_pairs_)
    {
      if (!known.bridge && known.token == socket)
      {
        return known.pair;
      }
    }
  }
  *reason = Fallback::UNREACHABLE;
  SideChannel channel = SideChannel::connect(HeaderOffer::socketName(socket));
  if (!channel)
  {
    const std::string shortage = describeShortage(errno);
    *reason = errno == EPERM ? Fallback::OTHER_USER : shortage.empty() ? Fallback::UNREACHABLE : Fallback::NO_MEMORY;
    if (!shortage.empty())
    {
      warnOfShortage(shortage);
    }
    return nullptr;
  }
  std::shared_ptr<ProcessPair> pair = addPair(std::move(channel), socket, false);
  *reason = Fallback::NO_MEMORY;
  return pair;
}

std::shared_ptr<ProcessPair> Runtime::pairWithBridge()
{
  {
    std::lock_guard<std::mutex> lock(pairs_mutex_);
    for (const KnownPair& known : known_pairs_)
    {
      if (known.bridge)
      {
        return known.pair;
      }
    }
  }
  SideChannel channel =
      options.bridge.empty() ? SideChannel() : SideChannel::connect(BridgeRequest::socketName(options.bridge));
  return channel ? addPair(std::move(channel), Token(), true) : nullptr;
}

bool Runtime::greet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
{
  Claim claim;
  {
    std::lock_guard<std::mutex> lock(listen_mutex_);
    const auto found = expected_.find(Token{hello.values[0], hello.values[1]});
    if (found != expected_.end() && !(hello.values[2] != 0 && options.bridge.empty()))
    {
      claim = found->second;  // not erased: a bridge may come again
    }
  }
  if (claim)
  {
    claim(pair, hello);
  }
  return static_cast<bool>(claim);
}

std::shared_ptr<const Runtime::Pairs> Runtime::pairs()
{
  std::lock_guard<std::mutex> lock(pairs_mutex_);
  return pairs_;
}

void Runtime::serveNews()
{
  const std::shared_ptr<const Pairs> all = pairs();
  for (const std::shared_ptr<ProcessPair>& pair : *all)
  {
    pair->serveNews();
  }
}

bool Runtime::hasNews()
{
  const std::shared_ptr<const Pairs> all = pairs();
  return std::any_of(all->begin(), all->end(), [](const auto& pair) { return pair->hasNews(); });
}

uint32_t Runtime::takeSleeper()
{
  std::lock_guard<std::mutex> lock(pairs_mutex_);
  const auto free = std::find(sleepers_.begin(), sleepers_.end(), false);
  if (wakeLayout() == nullptr || free == sleepers_.end())
  {
    return 0;
  }
  *free = true;
  return FIRST_SPINNER + static_cast<uint32_t>(free - sleepers_.begin());
}

void Runtime::giveSleeper(uint32_t doorbell)
{
  std::lock_guard<std::mutex> lock(pairs_mutex_);
  sleepers_[doorbell - FIRST_SPINNER] = false;
}

bool Runtime::later(std::function<void()> task)
{
  std::lock_guard<std::mutex> lock(tasks_mutex_);
  if (!tasks_event_)
  {
    tasks_event_ = makeEvent();
    if (!tasks_event_)
    {
      return false;
    }
    watch(tasks_event_.get(), [this](int) { runTasks(); });
  }
  tasks_.push_back(std::move(task));
  signalEvent(tasks_event_.get());
  return true;
}

void Runtime::runTasks()
{
  std::vector<std::function<void()>> tasks;
  {
    std::lock_guard<std::mutex> lock(tasks_mutex_);
    if (!clearEvent(tasks_event_.get()))
    {
      return;
    }
    tasks.swap(tasks_);
  }
  for (const std::function<void()>& task : tasks)
  {
    task();
  }
}

void Runtime::warnOfShortage(const std::string& what)
{
  if (!shortage_warned_.exchange(true))
  {
    ROS_WARN("pi_os_transport: %s. What finds no room in shared memory stays on TCPROS; raise the limit", what.c_str());
  }
}

}  // namespace pi_os_transport
