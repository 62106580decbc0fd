#pragma once

// What the links of a node need around them in a test: roscpp's objects without a network, and the library without the
// preloaded part of it. Programs with this header are compiled without access control, as the library itself is.

#include <ros/connection.h>
#include <ros/console.h>
#include <ros/poll_manager.h>
#include <ros/service_manager.h>
#include <ros/topic_manager.h>
#include <ros/transport/transport.h>

#include <boost/make_shared.hpp>

#include <string>

#include "roscpp/runtime.h"
#include "roscpp/topics/header_offer.h"

namespace pi_os_transport
{

/// The runtime of this process, as the preloaded library would have made it.
inline Runtime& runtimeWithoutPreload()
{
  static PiOsShim shim{};
  static const bool made = []()
  {
    shim.version = PI_OS_SHIM_VERSION;
    shim.set_pool = [](const void*, size_t, void (*)(void*)) {};
    shim.set_capture = [](void* (*)(size_t)) {};
    Runtime::instance().shim = &shim;
    Runtime::instance().options.pool_limit_mb = 16;
    ros::console::set_logger_level(ROSCONSOLE_ROOT_LOGGER_NAME, ros::console::levels::Fatal);
    ros::console::notifyLoggerLevelsChanged();
    // Kept for ever: their destructors take it for granted that the node was started.
    static const auto* const polls = new ros::PollManagerPtr(ros::PollManager::instance());
    static const auto* const topics = new ros::TopicManagerPtr(ros::TopicManager::instance());
    static const auto* const services = new ros::ServiceManagerPtr(ros::ServiceManager::instance());
    static_cast<void>(polls);
    static_cast<void>(topics);
    static_cast<void>(services);
    return true;
  }();
  static_cast<void>(made);
  return Runtime::instance();
}

/// What roscpp's network thread would do now.
inline void runNetworkThread()
{
  for (int round = 0; round < 3; ++round)  // what is accepted in the first one speaks in the second
  {
    ros::PollManager::instance()->getPollSet().update(0);
  }
}

/// A TCPROS connection that takes everything and says nothing.
class SilentTransport : public ros::Transport
{
public:
  int32_t read(uint8_t*, uint32_t) override { return 0; }
  int32_t write(uint8_t*, uint32_t size) override { return static_cast<int32_t>(size); }
  void enableWrite() override {}
  void disableWrite() override {}
  void enableRead() override {}
  void disableRead() override {}
  void close() override {}
  const char* getType() override { return "TCPROS"; }
  std::string getTransportInfo() override { return "nowhere"; }
};

inline ros::ConnectionPtr makeConnection()
{
  const auto connection = boost::make_shared<ros::Connection>();
  connection->initialize(boost::make_shared<SilentTransport>(), false, ros::HeaderReceivedFunc());
  return connection;
}

}  // namespace pi_os_transport
