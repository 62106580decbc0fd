// A hostile client of a service: how it comes to the socket of the process, the packets, descriptors and requests that
// it sends, what it writes into the ring of answers.

#include <ros/callback_queue.h>
#include <ros/service_callback_helper.h>
#include <ros/service_client_link.h>
#include <ros/service_publication.h>

#include <cstring>
#include <deque>

#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "roscpp/services/links_without_network.h"
#include "roscpp/services/service_responder.h"

namespace pi_os_transport
{
namespace
{

/// What the service answers with, and through whom.
struct Service : public ros::ServiceCallbackHelper
{
  bool call(ros::ServiceCallbackHelperCallParams& params) override
  {
    sumOf(params.request.buf.get(), params.request.num_bytes);
    if (keeps)
    {
      kept.push_back(params.request);
    }
    params.response.num_bytes = response_bytes;
    params.response.buf.reset(new uint8_t[response_bytes]());
    if (response_bytes > 0)
    {
      params.response.buf[0] = succeeds ? 1 : 0;
    }
    return true;
  }

  bool keeps = false;
  bool succeeds = true;
  size_t response_bytes = 105;
  std::deque<ros::SerializedMessage> kept;
};

std::shared_ptr<ServiceResponder> responder;

/// Goes to the socket of the process, with the token of the responder or without it.
HostilePair come(FuzzInput* input)
{
  HostilePair pair(SideChannel::connect(HeaderOffer::socketName(Runtime::instance().socket_token_)));
  require(static_cast<bool>(pair.channel), "the process listens");
  pair.meet(input);
  Packet hello;
  hello.type = input->below(8) != 0 ? uint32_t{Packet::HELLO} : input->below(15);
  hello.link = pair.someLink(input, NewsLayout::LINKS + 1);
  const Token token = input->below(8) != 0 ? responder->token() : Token{};
  hello.values = {token.high, token.low, input->below(8) == 0 ? uint64_t{1} : 0};
  pair.channel.send(hello);
  return pair;
}

void fuzz(FuzzInput input)
{
  Runtime& runtime = runtimeWithoutPreload();
  const uint32_t live_before = runtime.pool().usage().live_slots;
  ros::CallbackQueue queue;
  const auto service = boost::make_shared<Service>();
  const auto publication = boost::make_shared<ros::ServicePublication>(
      "/service", "*", "a/S", "a/SRequest", "a/SResponse", service, &queue, ros::VoidConstPtr());
  const ros::ConnectionPtr connection = makeConnection();
  const auto link = boost::make_shared<ros::ServiceClientLink>();
  link->connection_ = connection;
  link->parent_ = publication;
  responder = std::make_shared<ServiceResponder>("/service", link, connection);
  connection->addDropListener([](const ros::ConnectionPtr&, ros::Connection::DropReason) { responder->disconnect(); });
  const std::string offer =
      runtime.expect(responder->token(), [](const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
                     { responder->meet(pair, hello); });
  require(HeaderOffer::parse(offer).has_value(), "an offer is read as what was written");

  HostilePair pair;
  HostileSender sender;
  HostileReceiver receiver;
  uint64_t number = 0;
  for (uint32_t step = 0; step < 200 && !input.empty(); ++step)
  {
    switch (input.below(12))
    {
      case 0:
        if (!pair.channel || input.below(16) == 0)
        {
          pair = come(&input);
          runNetworkThread();
        }
        break;
      case 1:
      case 2:
        sender.send(&input, &pair);
        break;
      case 3:
        receiver.send(&input, &pair);
        break;
      case 4:
        receiver.receive(&pair);
        break;
      case 5:
      case 6:
        sender.write(&input, ++number);
        pair.ring(&input);
        break;
      case 7:
        receiver.write(&input);
        break;
      case 8:
        service->keeps = input.below(2) == 0;
        service->succeeds = input.below(4) != 0;
        service->response_bytes = input.below(2) == 0 ? 300005 : input.below(9);
        queue.callAvailable(ros::WallDuration());
        break;
      case 9:
        responder->serve();
        break;
      case 10:
        switch (input.below(6))
        {
          case 0:
            pair.channel.close();
            break;
          case 2:
            service->kept.clear();
            break;
          case 3:
            responder->collectReleased();
            runtime.announceRetired();
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
  queue.callAvailable(ros::WallDuration());
  connection->drop(ros::Connection::TransportDisconnect);
  pair.channel.close();
  runNetworkThread();
  queue.clear();
  service->kept.clear();
  responder.reset();
  require(runtime.pool().usage().live_slots == live_before, "every answer is given back, and once");
}

}  // namespace
}  // namespace pi_os_transport

/// In the place of roscpp's, as the hook of the preloaded library is.
void ros::ServiceClientLink::processResponse(bool, const ros::SerializedMessage& response)
{
  pi_os_transport::responder->respond(response);
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
