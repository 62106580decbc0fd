#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "bridge/service_probe.h"
#include "event_loop/event_loop.h"
#include "master/host_resolver.h"
#include "master/node_caller.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// What the nodes have registered with the ROS master: decides which ports are services, and which devices belong to
/// this robot. Never blocks the loop. A master that does not answer knows nothing.
class RosGraph
{
public:
  /// Gets the reason of a refusal; "" is a yes. May be called before the question has returned.
  using Answer = std::function<void(const std::string& refusal)>;

  /// @param master  "" takes ROS_MASTER_URI, and without that the port of roscore on this device
  RosGraph(EventLoop* loop, const std::string& master);

  /// Whether `service` is registered at this address of this device, and its server answers there. A yes holds for 2 s.
  void findService(const std::string& service, const Endpoint& at, Answer answer);
  /// Whether a registered node runs on the device with this address. Bounded: refuses when too many are asked for.
  void findDevice(const std::string& address, Answer answer);

  const std::string& master() const { return master_; }

private:
  struct Search;

  void ask(const std::string& method, const std::string& argument, std::function<void(const RpcValue* value)> done);
  void onRegistration(const std::string& service, const Endpoint& at, const RpcValue* uri, const Answer& answer);
  void probe(const std::string& service, const Endpoint& at, const Answer& answer);
  void startSearch();
  void lookUpNext(const std::shared_ptr<Search>& search);
  void onHost(const std::string& address);
  void endSearch(const std::string& refusal);

  EventLoop* const loop_;
  const std::string master_;
  NodeCaller caller_;
  HostResolver resolver_;
  std::map<std::string, SteadyTime> served_;  ///< services found, until when; by name and place
  std::map<ServiceProbe*, std::shared_ptr<ServiceProbe>> probes_;
  std::multimap<std::string, Answer> wanted_;  ///< devices that the next search looks for
  std::multimap<std::string, Answer> sought_;  ///< those of the search under way
  std::shared_ptr<Search> search_;
  SteadyTime next_search_;
  Timer search_timer_;
};

}  // namespace pi_os_transport
