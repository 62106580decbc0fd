// libpi_os_transport_roscpp.so: attaches to roscpp and contains the hooks of a node's start. The other hooks are in
// {transmit,receive,latch,deserialize,queue,service}_hooks.cpp. These files are compiled without access control,
// because the hooks replace member functions of roscpp.

#include <ros/console.h>
#include <ros/param.h>
#include <ros/this_node.h>

#include <climits>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "roscpp/held_leases.h"
#include "roscpp/hooks.h"
#include "roscpp/runtime.h"
#include "roscpp/topics/header_offer.h"
#include "roscpp_version.h"

namespace pi_os_transport
{
namespace
{

void loadParameters(Options* options)
{
  std::vector<std::string> errors;
  for (const std::string& group : {std::string("/pi_os"), ros::this_node::getName() + "/pi_os"})
  {
    XmlRpc::XmlRpcValue values;
    if (!ros::param::get(group, values) || values.getType() != XmlRpc::XmlRpcValue::TypeStruct)
    {
      continue;
    }
    options->load(
        [&values](const std::string& name) -> std::optional<std::string>
        {
          if (!values.hasMember(name))
          {
            return std::nullopt;
          }
          XmlRpc::XmlRpcValue& value = values[name];
          switch (value.getType())
          {
            case XmlRpc::XmlRpcValue::TypeString:
              return static_cast<std::string>(value);
            case XmlRpc::XmlRpcValue::TypeInt:
              return std::to_string(static_cast<int>(value));
            case XmlRpc::XmlRpcValue::TypeBoolean:
              return static_cast<bool>(value) ? "1" : "0";
            default:
              return value.toXml();
          }
        },
        [&group](const std::string& name) { return group + "/" + name; }, &errors);
  }
  options->loadEnvironment(&errors);
  for (const std::string& error : errors)
  {
    ROS_ERROR("pi_os_transport: %s", error.c_str());
  }
}

void start(ros::TopicManager* self)
{
  Runtime& runtime = Runtime::instance();
  runtime.original.start(self);
  if (runtime.active())
  {
    static std::once_flag once;
    std::call_once(once,
                   [&runtime]()
                   {
                     loadParameters(&runtime.options);
                     runtime.listen();
                   });
  }
}

void writeHeader(ros::Connection* self, const ros::M_string& fields, const ros::WriteFinishedFunc& written)
{
  Runtime& runtime = Runtime::instance();
  ros::M_string extended = fields;
  runtime.original.write_header(self, OfferScope::extend(&extended) ? extended : fields, written);
}

/// The file behind a link as libroscpp.so.4d. Its name has the version, which differs where the link does not.
std::string fileBehind(const char* path)
{
  char resolved[PATH_MAX];
  return realpath(path, resolved) != nullptr ? resolved : path;
}

/// True if `file` is the libroscpp that this library was compiled for, whose private members it uses.
bool isKnownRoscpp(const std::string& file)
{
  return file.substr(file.rfind('/') + 1) == ROSCPP_FILE_NAME;
}

int attach(PiOsShim* shim)
{
  if (shim->version != PI_OS_SHIM_VERSION)
  {
    ROS_WARN(
        "pi_os_transport: libpi_os_transport.so and libpi_os_transport_roscpp.so are of different builds; topics and "
        "services of "
        "this node stay on TCPROS. Install both from one build");
    return 1;
  }
  const std::string roscpp = fileBehind(shim->roscpp_path);
  if (!isKnownRoscpp(roscpp))
  {
    ROS_WARN(
        "pi_os_transport: this node runs with %s, but the library was built for %s; topics and services of this node "
        "stay on TCPROS. Build pi_os_transport against the installed roscpp",
        roscpp.c_str(), ROSCPP_FILE_NAME);
    return 1;
  }
  Runtime& runtime = Runtime::instance();
  runtime.shim = shim;
  Originals& original = runtime.original;
  shim->zero_copy = &HeldLeases::api();
  takeOver(shim, PI_OS_TOPIC_MANAGER_START, &original.start, start);
  takeOver(shim, PI_OS_CONNECTION_WRITE_HEADER, &original.write_header, writeHeader);
  attachTransmitHooks(shim);
  attachReceiveHooks(shim);
  attachLatchHooks(shim);
  attachDeserializeHooks(shim);
  attachQueueHooks(shim);
  attachServiceHooks(shim);
  return 0;
}

}  // namespace
}  // namespace pi_os_transport

extern "C" __attribute__((visibility("default"))) int pi_os_transport_attach(PiOsShim* shim)
{
  return pi_os_transport::attach(shim);
}
