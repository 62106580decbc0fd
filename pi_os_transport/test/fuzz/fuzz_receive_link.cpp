// A hostile publisher: the field of its header, the packets, descriptors and messages that it sends. Its messages over
// TCPROS come in between.

#include <ros/callback_queue.h>
#include <ros/subscription.h>
#include <ros/transport_publisher_link.h>

#include <algorithm>
#include <deque>

#include <nlohmann/json.hpp>

#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "roscpp/held_leases.h"
#include "roscpp/services/links_without_network.h"
#include "roscpp/topics/numbered_message.h"
#include "roscpp/topics/receive_link.h"

namespace pi_os_transport
{
namespace
{

std::deque<ros::SerializedMessage> delivered;

void deliver(ros::TransportPublisherLink*, const ros::SerializedMessage& message, bool, bool)
{
  sumOf(message.buf.get(), message.num_bytes);
  delivered.push_back(message);
  require(delivered.size() <= 200 * (RingLayout::CAPACITY + 1), "no more is delivered than was written");
}

void fuzz(FuzzInput input)
{
  Runtime& runtime = runtimeWithoutPreload();
  runtime.original.handle_message = deliver;
  const auto subscription =
      boost::make_shared<ros::Subscription>("/topic", "*", "std_msgs/String", ros::TransportHints());
  const ros::ConnectionPtr connection = makeConnection();
  const auto link =
      boost::make_shared<ros::TransportPublisherLink>(subscription, "http://publisher:1/", ros::TransportHints());
  link->connection_ = connection;
  const auto receiving = std::make_shared<ReceiveLink>(link, connection);
  if (input.below(2) == 0)
  {
    HeldLeases::instance().wanted_ = true;
  }

  const Token socket = Token::random();
  SideChannel listener = SideChannel::listen(HeaderOffer::socketName(socket));
  HostileSender sender;
  const Token token = Token::random();
  std::string offer = HeaderOffer{socket, token}.toString();
  const uint8_t content[8] = {};
  if (input.below(8) == 0)
  {
    const std::vector<uint8_t> bytes = input.bytes(input.below(100));
    offer.assign(bytes.begin(), bytes.end());
  }
  receiving->bridged_ = input.below(4) == 0;
  receiving->meet(offer);
  HostilePair pair(listener.accept());
  if (pair.channel)
  {
    pair.meet(&input);
  }
  bool ended = false;
  for (uint32_t step = 0; step < 200 && !input.empty(); ++step)
  {
    switch (input.below(10))
    {
      case 0:
      case 1:
        sender.send(&input, &pair);
        break;
      case 2:
      case 3:
      case 4:
        sender.write(&input, input.below(3));
        pair.ring(&input);
        break;
      case 5:
        if (!ended)
        {
          const ros::SerializedMessage message = numberedMessage(token, input.below(5), content, input.below(8));
          const size_t skipped = input.below(2) == 0 ? LENGTH_PREFIX : message.num_bytes - 1;
          const size_t length = message.num_bytes - skipped;
          const boost::shared_array<uint8_t> bytes(new uint8_t[length]);
          std::copy_n(message.buf.get() + skipped, length, bytes.get());
          receiving->deliverTcp(link.get(), ros::SerializedMessage(bytes, length));
        }
        break;
      case 6:
        receiving->serve();
        break;
      case 7:
        for (uint32_t count = input.below(200); count > 0 && !delivered.empty(); --count)
        {
          delivered.pop_front();
        }
        break;
      case 8:
        switch (input.below(8))
        {
          case 0:
            pair.channel.close();
            break;
          case 1:
            ended = true;
            receiving->disconnect(input.below(2) == 0);
            break;
          case 2:
          {
            nlohmann::ordered_json object;
            receiving->describe(&object);
            receiving->info();
            break;
          }
          case 3:
            if (!delivered.empty())
            {
              HeldLeases::instance().find(delivered.back().buf.get());
            }
            break;
          default:
            break;
        }
        break;
      default:
        runNetworkThread();
        break;
    }
  }
  receiving->disconnect(input.below(2) == 0);
  pair.channel.close();
  runNetworkThread();
  delivered.clear();
  connection->drop(ros::Connection::Destructing);
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
