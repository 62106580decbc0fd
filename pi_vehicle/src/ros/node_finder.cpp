#include "ros/node_finder.h"

#include "power/process_files.h"

#include <netdb.h>
#include <pthread.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <sys/socket.h>
#include <unistd.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include <chrono>
#include <memory>
#include <utility>

namespace pi_vehicle
{
namespace
{

using XmlRpc::XmlRpcValue;

constexpr double SLICE_S = 0.05;  ///< after which a call looks whether it shall end

double monotonicSeconds()
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

const power::ProcessFiles& processes()
{
  static const power::ProcessFiles files;
  return files;
}

}  // namespace

XmlRpcValue callWithin(double timeout_s, const std::string& uri, const std::string& method,
                       const XmlRpcValue& arguments, const std::atomic<bool>& stop)
{
  std::string host;
  uint32_t port = 0;
  if (!ros::network::splitURI(uri, host, port))
  {
    return XmlRpcValue();
  }
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port), "/");
  if (!client.executeNonBlock(method.c_str(), arguments))
  {
    return XmlRpcValue();
  }
  const double deadline_s = monotonicSeconds() + timeout_s;
  XmlRpcValue answer;
  while (!stop && monotonicSeconds() < deadline_s)
  {
    client._disp.work(SLICE_S);  // seconds, whatever the name of its argument says
    if (client.executeCheckDone(answer))
    {
      const bool good = !client.isFault() && answer.getType() == XmlRpcValue::TypeArray && answer.size() == 3 &&
                        answer[0].getType() == XmlRpcValue::TypeInt && static_cast<int>(answer[0]) == 1;
      const XmlRpcValue value = good ? answer[2] : XmlRpcValue();
      client.close();
      return value;
    }
    if (client._disp._sources.empty())
    {
      break;  // refused, or closed without an answer
    }
  }
  client.close();
  return XmlRpcValue();
}

bool isThisComputer(const std::string& host)
{
  if (host == ros::network::getHost())
  {
    return true;
  }
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  if (::getaddrinfo(host.c_str(), nullptr, &hints, &list) != 0)
  {
    return false;
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(list, ::freeaddrinfo);
  for (const addrinfo* address = list; address != nullptr; address = address->ai_next)
  {
    // Only an address of this computer can be bound to.
    const int descriptor = ::socket(address->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool own = descriptor >= 0 && ::bind(descriptor, address->ai_addr, address->ai_addrlen) == 0;
    if (descriptor >= 0)
    {
      ::close(descriptor);
    }
    if (own)
    {
      return true;
    }
  }
  return false;
}

NodeFinder::NodeFinder(std::vector<std::string> nodes, const Options& options)
  : nodes_(std::move(nodes)), options_(options)
{
  thread_ = std::thread([this] { run(); });
}

NodeFinder::~NodeFinder()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  stopped_.notify_all();
  thread_.join();
}

NodeFinder::Found NodeFinder::found() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return found_;
}

void NodeFinder::run()
{
  pthread_setname_np(pthread_self(), "power_nodes");
  while (!stopping_)
  {
    search();
    std::unique_lock<std::mutex> lock(mutex_);
    ++found_.searches;
    stopped_.wait_for(lock, std::chrono::duration<double>(options_.period_s), [this] { return stopping_.load(); });
  }
}

void NodeFinder::search()
{
  const double now_s = monotonicSeconds();
  for (const std::string& node : nodes_)
  {
    if (stopping_)
    {
      return;
    }
    const auto known = known_.find(node);
    if (known != known_.end())
    {
      const auto process = processes().process(known->second.pid);
      if (process && process->start_ticks == known->second.start_ticks &&
          now_s - known->second.asked_s < options_.again_s)
      {
        continue;
      }
    }
    if (!look(node, now_s))
    {
      return;  // no master, no nodes
    }
  }
}

bool NodeFinder::look(const std::string& node, double now_s)
{
  const auto known = known_.find(node);
  const auto process = known != known_.end() ? processes().process(known->second.pid) : std::nullopt;
  const bool lives = process && process->start_ticks == known->second.start_ticks;
  XmlRpcValue arguments;
  arguments[0] = ros::this_node::getName();
  XmlRpcValue where = arguments;
  where[1] = node;
  const std::string master = "http://" + ros::master::getHost() + ":" + std::to_string(ros::master::getPort()) + "/";

  std::string problem;
  bool master_answers = true;
  int32_t pid = 0;
  XmlRpcValue uri = callWithin(options_.timeout_s, master, "lookupNode", where, stopping_);
  std::string host;
  uint32_t port = 0;
  if (uri.getType() != XmlRpcValue::TypeString)
  {
    // An answer without the node, or none at all? The master always knows its own process.
    XmlRpcValue of_master = callWithin(options_.timeout_s, master, "getPid", arguments, stopping_);
    master_answers = of_master.getType() == XmlRpcValue::TypeInt;
    problem = master_answers ? "is not registered" : "cannot be looked up, as the master does not answer";
  }
  else if (!ros::network::splitURI(static_cast<std::string>(uri), host, port))
  {
    problem = "has no valid address: " + static_cast<std::string>(uri);
  }
  else if (!isThisComputer(host))
  {
    problem = "runs on " + host;
  }
  else
  {
    XmlRpcValue answer = callWithin(options_.timeout_s, static_cast<std::string>(uri), "getPid", arguments, stopping_);
    if (answer.getType() == XmlRpcValue::TypeInt)
    {
      pid = static_cast<int>(answer);
    }
    else
    {
      problem = "does not answer";
    }
  }
  if (stopping_)
  {
    return false;
  }
  if (pid == 0 && lives && (problem == "does not answer" || !master_answers))
  {
    pid = known->second.pid;  // busy, but there
  }
  const auto start = pid > 0 ? processes().process(pid) : std::nullopt;
  if (pid > 0 && !start)
  {
    problem = "says that it is process " + std::to_string(pid) + ", which is not there";
  }
  std::lock_guard<std::mutex> lock(mutex_);
  found_.master = master_answers;
  if (start)
  {
    known_[node] = {pid, start->start_ticks, now_s};
    found_.pids[node] = pid;
    found_.problems.erase(node);
  }
  else
  {
    known_.erase(node);
    found_.pids.erase(node);
    found_.problems[node] = problem;
  }
  return master_answers;
}

}  // namespace pi_vehicle
