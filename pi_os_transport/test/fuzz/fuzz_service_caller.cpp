// A hostile server: the field of its header, the packets, descriptors and answers that it sends, what it writes into
// the ring of requests.

#include <ros/service_server_link.h>

#include <cstring>
#include <vector>

#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "roscpp/services/links_without_network.h"
#include "roscpp/services/service_caller.h"

namespace pi_os_transport
{
namespace
{

/// Where the server listens; the client comes through the offer of its header.
struct Server
{
  Token socket = Token::random();
  Token link = Token::random();
  SideChannel listener = SideChannel::listen(HeaderOffer::socketName(socket));
  HostilePair pair;
  HostileSender sender;
  HostileReceiver receiver;

  std::string offer(FuzzInput* input) const
  {
    if (input->below(8) != 0)
    {
      return HeaderOffer{socket, link}.toString();
    }
    const std::vector<uint8_t> bytes = input->bytes(input->below(100));
    return std::string(bytes.begin(), bytes.end());
  }
  void accept(FuzzInput* input)
  {
    pair = HostilePair(listener.accept());
    require(static_cast<bool>(pair.channel), "the client has come");
    pair.meet(input);
    pair.receive();
    require(pair.asked != 0 && pair.asked_token == link, "the client asks for the ring of answers");
  }
  /// Asks for the ring of requests.
  void askBack(FuzzInput* input)
  {
    const Token token = input->below(8) != 0 ? ServiceCaller::returnToken(link) : Token{};
    if (pair.channel)
    {
      pair.channel.send(Packet::of(Packet::HELLO, pair.someLink(input, NewsLayout::LINKS + 1), token.high, token.low));
    }
  }
};

/// One call, when all that comes has come: the connection has ended. The answers are those that the ring holds.
void callOnce(ServiceCaller* caller, ros::ServiceServerLink* link, uint64_t number, size_t bytes,
              std::vector<ros::SerializedMessage>* kept)
{
  const std::shared_ptr<RingReceiver> answers = caller->answers_;
  if (!answers || !answers->hasRing())
  {
    return;
  }
  ros::SerializedMessage request;
  request.num_bytes = LENGTH_PREFIX + bytes;
  request.buf.reset(new uint8_t[request.num_bytes]());
  const uint32_t length = static_cast<uint32_t>(bytes);
  std::memcpy(request.buf.get(), &length, sizeof(length));
  link->getConnection()->drop(ros::Connection::TransportDisconnect);  // nothing to wait for over TCPROS
  caller->send(request, number);
  const ServiceCaller::State state = caller->state_.exchange(ServiceCaller::State::ENDED);
  ros::SerializedMessage response;
  if (caller->awaitAnswer(link, answers, number, response) == ServiceCaller::Outcome::SUCCESS)
  {
    sumOf(response.buf.get(), response.num_bytes);
    kept->push_back(response);
  }
  caller->state_ = state;
}

void fuzz(FuzzInput input)
{
  Runtime& runtime = runtimeWithoutPreload();
  const uint32_t live_before = runtime.pool().usage().live_slots;
  Server server;
  const ros::ConnectionPtr connection = makeConnection();
  const auto link = boost::make_shared<ros::ServiceServerLink>("/service", true, "*", "*", ros::M_string());
  link->connection_ = connection;
  const auto caller = std::make_shared<ServiceCaller>("/service", connection, ServiceCaller::Use::PERSISTENT);
  std::vector<ros::SerializedMessage> kept;
  if (caller->meet(server.offer(&input)))
  {
    server.accept(&input);
  }
  uint64_t number = 0;
  for (uint32_t step = 0; step < 200 && !input.empty(); ++step)
  {
    switch (input.below(12))
    {
      case 0:
      case 1:
        server.sender.send(&input, &server.pair);
        break;
      case 2:
        server.receiver.send(&input, &server.pair);
        break;
      case 3:
        server.receiver.receive(&server.pair);
        break;
      case 4:
      case 5:
      case 6:
        server.sender.write(&input, (number + 1) << 1 | input.below(2));
        break;
      case 7:
        server.receiver.write(&input);
        break;
      case 8:
      case 9:
        callOnce(caller.get(), link.get(), ++number, input.below(2) == 0 ? 100 : 300000, &kept);
        break;
      case 10:
        switch (input.below(6))
        {
          case 0:
            server.pair.channel.close();
            break;
          case 1:
            server.askBack(&input);
            break;
          case 2:
            kept.clear();
            break;
          case 3:
            caller->collectReleased();
            runtime.announceRetired();
            break;
          default:
            caller->promising();
            break;
        }
        break;
      default:
        runNetworkThread();
        break;
    }
  }
  connection->drop(ros::Connection::TransportDisconnect);
  caller->disconnect();
  server.pair.channel.close();
  runNetworkThread();
  kept.clear();
  require(runtime.pool().usage().live_slots == live_before, "every request is given back, and once");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
