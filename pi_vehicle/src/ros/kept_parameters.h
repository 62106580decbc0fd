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

/// Keeps values of a node on the parameter server, which outlives a node that is killed (a latched topic does not). A
/// thread of its own sets them, as the master may be slow or gone; of one name the newest value counts.
class KeptParameters
{
public:
  explicit KeptParameters(const ros::NodeHandle& private_node);
  /// Sets the values that wait.
  ~KeptParameters();
  KeptParameters(const KeptParameters&) = delete;
  KeptParameters& operator=(const KeptParameters&) = delete;

  /// Returns at once. @param name  private.
  void keep(const std::string& name, const XmlRpc::XmlRpcValue& value);

  /// Leaves *value unchanged if there is none. @throws std::invalid_argument for another type.
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
