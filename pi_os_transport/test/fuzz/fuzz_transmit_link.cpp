// A hostile subscriber, or bridge: how it comes to the socket of the process, its packets, what it writes into the ring
// while messages are published; and anybody who asks the process for its state, in which names of peers occur.

#include <ros/publication.h>
#include <ros/service_manager.h>
#include <ros/topic_manager.h>
#include <ros/transport_subscriber_link.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <string>
#include <vector>

#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "roscpp/services/links_without_network.h"
#include "roscpp/topics/outbox_writer.h"
#include "roscpp/topics/transmit_link.h"

namespace pi_os_transport
{
namespace
{

/// True if brackets and quotes match and all characters are those of ASCII that JSON allows.
bool looksLikeJson(const std::string& text)
{
  std::string open;
  bool in_string = false;
  for (size_t i = 0; i < text.size(); ++i)
  {
    const char c = text[i];
    if (c < 0x20 || c == 0x7f)
    {
      return false;
    }
    if (in_string)
    {
      i += c == '\\' ? 1 : 0;
      in_string = c != '"';
    }
    else if (c == '"')
    {
      in_string = true;
    }
    else if (c == '{' || c == '[')
    {
      open += c;
    }
    else if (c == '}' || c == ']')
    {
      if (open.empty() || open.back() != (c == '}' ? '{' : '['))
      {
        return false;
      }
      open.pop_back();
    }
  }
  return !in_string && open.empty() && !text.empty() && text.front() == '{';
}

void askForState()
{
  SideChannel asking = SideChannel::connect(HeaderOffer::socketName(Runtime::instance().socket_token_));
  Packet packet;
  packet.type = Packet::QUERY;
  asking.send(packet);
  runNetworkThread();
  Descriptors descriptors;
  require(asking.receive(&packet, &descriptors) == SideChannel::Receive::PACKET && packet.type == Packet::STATE,
          "who asks gets an answer");
  std::string state(packet.values[0], '\0');
  require(pread(descriptors[0].get(), state.data(), state.size(), 0) == static_cast<ssize_t>(state.size()),
          "the state is as long as it says");
  require(looksLikeJson(state), "the state is JSON, whatever peers call themselves");
}

std::string someName(FuzzInput* input)
{
  const std::vector<uint8_t> bytes = input->bytes(input->below(12));
  return std::string(bytes.begin(), bytes.end());
}

HostilePair come(FuzzInput* input, const Token& token)
{
  HostilePair pair(SideChannel::connect(HeaderOffer::socketName(Runtime::instance().socket_token_)));
  pair.meet(input);
  Packet hello;
  hello.type = input->below(8) != 0 ? uint32_t{Packet::HELLO} : input->below(15);
  hello.link = pair.someLink(input, NewsLayout::LINKS + 1);
  hello.values = {token.high, token.low, input->below(2)};
  if (input->below(8) == 0)
  {
    hello.values[0] = input->take<uint64_t>();
  }
  pair.channel.send(hello);
  runNetworkThread();
  return pair;
}

void publish(FuzzInput* input, TransmitLink* transmitting, ros::TransportSubscriberLink* link, uint64_t serial)
{
  const uint32_t length = input->below(4) == 0 ? 300000 : 100;
  ros::SerializedMessage message;
  uint8_t* const pooled = input->below(2) == 0 ? Runtime::instance().pool().allocate(length + LENGTH_PREFIX) : nullptr;
  if (pooled != nullptr)
  {
    message.buf =
        boost::shared_array<uint8_t>(pooled, [](uint8_t* memory) { Runtime::instance().pool().release(memory); });
  }
  else
  {
    message.buf.reset(new uint8_t[length + LENGTH_PREFIX]);
  }
  message.num_bytes = length + LENGTH_PREFIX;
  message.message_start = message.buf.get() + LENGTH_PREFIX;
  transmitting->enqueue(link, message, input->below(2) == 0 ? serial : 0);
  OutboxWriter::flush();
}

void fuzz(FuzzInput input)
{
  Runtime& runtime = runtimeWithoutPreload();
  runtime.options.bridge = "fuzz";  // bridges may come
  const uint32_t live_before = runtime.pool().usage().live_slots;
  const std::string topic = "/" + someName(&input);
  const std::string definition = someName(&input);
  const auto publication =
      boost::make_shared<ros::Publication>(topic, "std_msgs/String", "*", definition, input.below(4), false, false);
  publication->latch_ = input.below(4) == 0;
  const ros::ConnectionPtr connection = makeConnection();
  const auto link = boost::make_shared<ros::TransportSubscriberLink>();
  link->connection_ = connection;
  link->parent_ = publication;
  link->header_written_ = true;
  link->destination_caller_id_ = someName(&input);
  publication->subscriber_links_.push_back(link);
  std::vector<ros::PublicationPtr>& advertised = ros::TopicManager::instance()->advertised_topics_;
  advertised.push_back(publication);

  const auto transmitting = std::make_shared<TransmitLink>(topic, link, connection);
  runtime.transmit_links.insert(connection.get(), transmitting);
  runtime.expect(transmitting->token(), [&transmitting](const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
                 { transmitting->meet(pair, hello); });
  HostilePair pair;
  HostileReceiver receiver;
  for (uint32_t step = 0; step < 200 && !input.empty(); ++step)
  {
    switch (input.below(12))
    {
      case 0:
        if (!pair.channel || input.below(8) == 0)
        {
          pair = come(&input, transmitting->token());
          receiver = HostileReceiver();
        }
        break;
      case 1:
        receiver.send(&input, &pair);
        break;
      case 2:
        receiver.receive(&pair);
        break;
      case 3:
      case 4:
        receiver.write(&input);
        break;
      case 5:
      case 6:
      case 7:
        publish(&input, transmitting.get(), link.get(), step + 1);
        break;
      case 8:
        connection->onWriteable(connection->getTransport());
        break;
      case 9:
        switch (input.below(8))
        {
          case 0:
            pair.channel.close();
            break;
          case 1:
            transmitting->info();
            askForState();
            break;
          case 2:
            transmitting->collectReleased();
            runtime.announceRetired();
            break;
          case 3:
            transmitting->disconnect();
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
  advertised.pop_back();
  publication->subscriber_links_.clear();
  runtime.transmit_links.erase(connection.get());
  transmitting->disconnect();
  pair.channel.close();
  runNetworkThread();
  connection->drop(ros::Connection::Destructing);
  link->outbox_ = {};
  connection->write_buffer_.reset();
  connection->write_callback_.clear();
  require(runtime.pool().usage().live_slots == live_before, "every message is given back, and once");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
