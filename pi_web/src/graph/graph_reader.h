#pragma once

#include "graph/peer.h"
#include "protocol/messages.h"

#include <xmlrpcpp/XmlRpcValue.h>

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace pi_web
{

struct MessageType
{
  std::string md5sum;
  std::string definition;
};

/// What the master knows.
struct GraphState
{
  std::map<std::string, std::set<std::string>> publishers;   ///< nodes by topic
  std::map<std::string, std::set<std::string>> subscribers;  ///< likewise
  std::map<std::string, std::set<std::string>> providers;    ///< nodes by service
  std::map<std::string, std::string> types;                  ///< by topic
  std::map<std::string, std::string> service_types;          ///< those that are asked for, as far as known
};

/// Links of topics over one transport, as TCPROS or SHMROS.
struct Links
{
  size_t count = 0;
  std::set<std::string> topics;
};

/// Asks master and nodes. All methods wait for an answer, at most limit_s. Not thread safe.
class GraphReader
{
public:
  /// @param master_uri  as ROS_MASTER_URI. @param caller  our name. @param services  whose types are of interest.
  GraphReader(const std::string& master_uri, const std::string& caller, std::set<std::string> services, double limit_s);

  /// @throws std::runtime_error if the master does not answer.
  GraphState read();
  /// Asks a publisher of the topic for the definition of its messages: with the head of a connection that is closed
  /// before a message. A node that does not answer is not asked again for 10 s. @return whether it is known now.
  bool learnType(const std::string& topic, const std::string& type, const std::set<std::string>& nodes);
  /// Asks the publishers what carries their topics. A node that does not answer is not asked again for 10 s.
  /// @return by transport
  std::map<std::string, Links> links(const GraphState& graph);
  void addType(const std::string& type, const MessageType& definition) { types_[type] = definition; }
  const std::map<std::string, MessageType>& types() const { return types_; }

  /// Calls a method of the master and returns its value. @throws std::runtime_error
  XmlRpc::XmlRpcValue master(const std::string& method, const std::vector<XmlRpc::XmlRpcValue>& arguments) const;
  /// Calls a service with serialised bytes. @throws std::runtime_error with the reason of the service, too.
  Payload call(const std::string& service, std::string_view request, double limit_s) const;

private:
  XmlRpc::XmlRpcValue execute(const std::string& uri, const std::string& method,
                              const std::vector<XmlRpc::XmlRpcValue>& arguments) const;
  std::string serviceType(const std::string& service) const;
  /// Does what asks a node, unless that did not answer within the last 10 s. @param ask  false: it is of no use
  void askNode(const std::string& node, const std::function<bool()>& ask);

  const std::string master_uri_;
  const std::string caller_;
  const std::set<std::string> services_;
  const double limit_s_;
  std::map<std::string, MessageType> types_;
  std::map<std::string, std::string> service_types_;  ///< by service and its address
  std::map<std::string, int64_t> not_before_ns_;      ///< nodes that did not answer
};

}  // namespace pi_web
