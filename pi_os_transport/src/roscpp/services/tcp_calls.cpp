#include "roscpp/services/tcp_calls.h"

#include <ros/connection.h>
#include <ros/console.h>

namespace pi_os_transport
{
namespace
{

using CallInfo = ros::ServiceServerLink::CallInfo;
using CallInfoPtr = ros::ServiceServerLink::CallInfoPtr;

CallInfoPtr makeCall(ros::SerializedMessage* response)
{
  const auto call = boost::make_shared<CallInfo>();
  call->resp_ = response;
  call->success_ = false;
  call->finished_ = false;
  call->call_finished_ = false;
  call->caller_thread_id_ = boost::this_thread::get_id();
  return call;
}

void finish(const CallInfoPtr& call)
{
  boost::mutex::scoped_lock lock(call->finished_mutex_);
  call->finished_ = true;
  call->finished_condition_.notify_all();
}

bool await(ros::ServiceServerLink* link, const CallInfoPtr& call)
{
  {
    boost::mutex::scoped_lock lock(call->finished_mutex_);
    while (!call->finished_)
    {
      call->finished_condition_.wait(lock);
    }
  }
  call->call_finished_ = true;
  if (!call->exception_string_.empty())
  {
    ROS_ERROR("Service call failed: service [%s] responded with an error: %s", link->getServiceName().c_str(),
              call->exception_string_.c_str());
  }
  return call->success_;
}

/// Call after endCalls() can find the call; if the connection ends later, endCalls() ends the call.
bool endedBefore(ros::ServiceServerLink* link)
{
  const bool ended = link->connection_->isDropped();
  if (ended)
  {
    endCalls(link);
  }
  return ended;
}

}  // namespace

bool callOverTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request, ros::SerializedMessage& response)
{
  const CallInfoPtr call = makeCall(&response);
  call->req_ = request;
  bool immediate = false;
  {
    boost::mutex::scoped_lock lock(link->call_queue_mutex_);
    immediate = link->call_queue_.empty() && link->header_written_ && link->header_read_;
    link->call_queue_.push(call);
  }
  if (endedBefore(link))
  {
    return false;
  }
  if (immediate)
  {
    link->processNextCall();
  }
  return await(link, call);
}

bool awaitTcpAnswer(ros::ServiceServerLink* link, ros::SerializedMessage& response)
{
  const CallInfoPtr call = makeCall(&response);
  {
    boost::mutex::scoped_lock lock(link->call_queue_mutex_);
    link->current_call_ = call;
  }
  if (endedBefore(link))
  {
    return false;
  }
  link->onRequestWritten(link->connection_);
  return await(link, call);
}

void endCalls(ros::ServiceServerLink* link)
{
  boost::mutex::scoped_lock lock(link->call_queue_mutex_);
  link->dropped_ = true;
  if (link->current_call_)
  {
    finish(link->current_call_);
  }
  for (; !link->call_queue_.empty(); link->call_queue_.pop())
  {
    finish(link->call_queue_.front());
  }
}

}  // namespace pi_os_transport
