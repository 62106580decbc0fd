#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "bridge/config/bridge_config.h"
#include "bridge/refusals.h"
#include "bridge/ros_graph.h"
#include "event_loop/event_loop.h"
#include "image_codec/image_codec.h"
#include "shm/slot_pool.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// What all parts of a bridge share.
struct BridgeContext
{
  EventLoop* const loop;
  const BridgeConfig config;
  const std::function<void(const std::string&)> log;
  const uint64_t instance;  ///< random number of this process
  Refusals refusals{log};
  std::unique_ptr<SlotPool> pool{};  ///< memory for incoming messages
  std::unique_ptr<FrameTransport> transport{};
  std::unique_ptr<ImageCodec> codec{};
  std::unique_ptr<RosGraph> graph{};  ///< what is registered with the ROS master
  uint32_t next_id = 1;               ///< of links, streams and tunnels
  bool shares_keys = false;           ///< an identity is that of a key, which several devices have
  bool draining = false;              ///< the bridge ends: nothing new is opened
};

}  // namespace pi_os_transport
