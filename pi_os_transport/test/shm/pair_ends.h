#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "shm/process_pair.h"
#include "shm/side_channel.h"

namespace pi_os_transport
{

/// Keeps what comes for a link.
class RecordingLink : public PairLink
{
public:
  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override
  {
    packets.push_back(packet);
    last_descriptors = std::move(*descriptors);
  }
  void onPairEnded() override { ended = true; }
  void serve() override { ++served; }

  std::vector<Packet> packets;
  SideChannel::Descriptors last_descriptors;
  bool ended = false;
  int served = 0;
};

/// A connected socket, both ends in this process.
inline std::pair<SideChannel, SideChannel> connectedChannels()
{
  const std::string name = "pi_os_test/" + Token::random().toString();
  SideChannel listener = SideChannel::listen(name);
  SideChannel connected = SideChannel::connect(name);
  return {std::move(connected), listener.accept()};
}

/// The host of a pair in a test. Its functions do nothing but count.
struct TestHost
{
  explicit TestHost(int wake_memory = -1)
  {
    auto made = std::make_shared<ProcessPair::Host>();
    made->token = Token::random();
    made->wake_memory = wake_memory;
    made->on_hello = [this](const std::shared_ptr<ProcessPair>&, const Packet& hello)
    {
      hellos.push_back(hello);
      return accepts;
    };
    made->want_write = [this](ProcessPair*, bool wanted) { wants_write = wanted; };
    made->receive_soon = [this](const std::shared_ptr<ProcessPair>&) { ++receive_soon; };
    made->on_shortage = [this](const std::string& text) { shortages.push_back(text); };
    host = made;
  }
  TestHost(const TestHost&) = delete;
  TestHost& operator=(const TestHost&) = delete;

  std::shared_ptr<const ProcessPair::Host> host;
  std::vector<Packet> hellos;
  std::vector<std::string> shortages;
  bool accepts = true;
  bool wants_write = false;
  int receive_soon = 0;
};

/// Two ends of a ProcessPair, after they have met.
struct PairEnds
{
  explicit PairEnds(int wake_memory = -1) : receiving_host(wake_memory)
  {
    std::pair<SideChannel, SideChannel> channels = connectedChannels();
    std::string shortage;
    receiving = ProcessPair::make(std::move(channels.first), receiving_host.host, &shortage);
    sending = ProcessPair::make(std::move(channels.second), sending_host.host, &shortage);
    EXPECT_TRUE(receiving && sending) << shortage;
    EXPECT_TRUE(receiving->receive());
    EXPECT_TRUE(sending->receive());
  }
  ~PairEnds()
  {
    receiving->end();
    sending->end();
  }

  TestHost receiving_host;
  TestHost sending_host;
  std::shared_ptr<ProcessPair> receiving;  ///< the subscriber's, by custom
  std::shared_ptr<ProcessPair> sending;
};

}  // namespace pi_os_transport
