#include "ros/kept_parameters.h"

#include <pthread.h>

namespace pi_vehicle
{

KeptParameters::KeptParameters(const ros::NodeHandle& private_node)
  : node_(private_node), thread_(&KeptParameters::run, this)
{
  pthread_setname_np(thread_.native_handle(), "kept_parameters");
}

KeptParameters::~KeptParameters()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

void KeptParameters::keep(const std::string& name, const XmlRpc::XmlRpcValue& value)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    waiting_[name] = value;
  }
  changed_.notify_one();
}

void KeptParameters::run()
{
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    changed_.wait(lock, [this] { return stopping_ || !waiting_.empty(); });
    if (waiting_.empty())
    {
      return;
    }
    const auto [name, value] = *waiting_.begin();
    waiting_.erase(waiting_.begin());
    lock.unlock();
    node_.setParam(name, value);
    lock.lock();
  }
}

}  // namespace pi_vehicle
