#pragma once

#include <ros/node_handle.h>
#include <xmlrpcpp/XmlRpcValue.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

namespace pi_vehicle
{

/// What a node leaves for its next life, on the parameter server: it outlives a node that is killed, unlike a latched
/// topic. Values are set on a thread of its own, as the master may be slow or gone; of one name the newest counts.
class KeptParameters
{
public:
  explicit KeptParameters(const ros::NodeHandle& private_node);
  /// Sets what is still to be set.
  ~KeptParameters();
  KeptParameters(const KeptParameters&) = delete;
  KeptParameters& operator=(const KeptParameters&) = delete;

  /// Returns at once. @param name  private.
  void keep(const std::string& name, const XmlRpc::XmlRpcValue& value);

  /// *value stays where there is none. @throws std::invalid_argument if it is of another type.
  template <typename Value>
  void find(const std::string& name, const char* type, Value* value) const
  {
    if (node_.hasParam(name) && !node_.getParam(name, *value))
    {
      throw std::invalid_argument("parameter " + node_.resolveName(name) + " is not " + type + ", must be what this " +
                                  "node left there; delete it");
    }
  }

private:
  void run();

  const ros::NodeHandle node_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, XmlRpc::XmlRpcValue> waiting_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace pi_vehicle
