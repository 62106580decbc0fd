// A bridge between a hostile one, hostile publishers and hostile processes of its own device: all frames of a session,
// requests, and what comes through rings and pairs of processes.

#include <memory>
#include <string>
#include <vector>

#include "bridge/bridge.h"
#include "fuzz_input.h"
#include "fuzz_peers.h"
#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

const std::string PEER_ADDRESS = "192.0.2.1";  // of no device
constexpr FrameTransport::SourceId SOURCE = 1;

std::string someName(FuzzInput* input)
{
  return std::string(input->below(3), static_cast<char>('a' + input->below(3)));
}

class Rig
{
public:
  explicit Rig(FuzzInput* input)
    : input_(input)
    , publisher_socket_(Token::random())
    , publisher_(SideChannel::listen("pi_os/" + publisher_socket_.toString()))
    , bridge_(&loop_, config(), [](const std::string&) {})
  {
    auto transport = std::make_unique<FakeFrameTransport>();
    transport_ = transport.get();
    bridge_.context_.transport = std::move(transport);
    bridge_.start();
    session_ = bridge_.sessions_.first();
    runUntil(&loop_, [this] { return transport_->open.size() == TRAFFIC_CLASSES; });
    for (const FrameTransport::ConnectionId connection : std::vector<FrameTransport::ConnectionId>(transport_->open))
    {
      bridge_.dispatcher_.onConnected(connection);
    }
    greet(1);
    require(session_->peer->up(), "the bridges have met");
  }

  ~Rig()
  {
    bridge_.onLost(session_->peer.get(), input_->below(2) == 1);
    process_.channel.close();
    subscriber_.channel.close();
    loop_.runOnce(std::chrono::milliseconds(0));
    require(bridge_.context_.pool->usage().live_slots == 0, "every message is given back");
  }

  void step()
  {
    switch (input_->below(16))
    {
      case 0:
      case 1:
      case 2:
      case 3:
        sendFrame();
        break;
      case 4:
        openLink();
        break;
      case 5:
        acceptBridge();
        break;
      case 6:
        sender_.send(input_, &process_);
        break;
      case 7:
        sender_.write(input_, input_->below(3));
        process_.ring(input_);
        break;
      case 8:
        request();
        break;
      case 9:
        receiver_.send(input_, &subscriber_);
        break;
      case 10:
        receiver_.receive(&subscriber_);
        break;
      case 11:
        receiver_.write(input_);
        break;
      case 12:
        transport_->sent.clear();
        session_->peer->pump();
        break;
      case 13:
        interrupt();
        break;
      default:
        loop_.runOnce(std::chrono::milliseconds(0));
        break;
    }
  }

private:
  BridgeConfig config() const
  {
    BridgeConfig config;
    config.socket = "fuzz/" + publisher_socket_.toString();
    config.listen.clear();
    config.peers = {{PEER_ADDRESS, BRIDGE_PORT}};
    config.pool_limit_mb = 8;
    config.max_message_mb = 1;
    config.master = "http://127.0.0.1:1";  // nobody answers
    return config;
  }

  void greet(uint64_t instance)
  {
    Hello hello;
    hello.instance = instance;
    hello.secret = 77;
    hello.echo = session_->peer->secret();
    hello.port = BRIDGE_PORT;
    hello.address = PEER_ADDRESS;
    hello.fixed = true;
    hello.max_message_bytes = 1 << 20;
    FrameHeader header;
    header.type = FrameType::HELLO;
    feed(header, hello.encode());
  }

  /// In a place of exactly its size, except where the bridge wants it elsewhere.
  void feed(const FrameHeader& header, const std::vector<uint8_t>& bytes)
  {
    const uint32_t length = static_cast<uint32_t>(bytes.size());
    uint8_t* const place = bridge_.dispatcher_.onHeader(SOURCE, header, length);
    if (place == nullptr)
    {
      return;
    }
    const auto exact = std::make_unique<uint8_t[]>(length);
    uint8_t* const payload = header.type == FrameType::FRAGMENT ? place : exact.get();
    std::copy(bytes.begin(), bytes.end(), payload);
    bridge_.dispatcher_.onFrame(SOURCE, header, payload, length);
  }

  void sendFrame()
  {
    FrameHeader header;
    header.type = static_cast<FrameType>(1 + input_->below(LAST_FRAME_TYPE));
    header.id = input_->below(4);
    header.session = input_->below(16) != 0 ? session_->peer->secret() : input_->take<uint64_t>();
    header.count = input_->below(4) | (input_->below(4) == 0 ? FROM_SUBSCRIBER : 0);
    if (header.type == FrameType::MESSAGE || header.type == FrameType::BEGIN)
    {
      header.count &= ~COMPRESSED;  // would start a worker
    }
    header.lane = input_->below(3);
    header.offset = input_->below(4) == 0 ? input_->take<uint64_t>() : input_->take<uint8_t>();
    feed(header, input_->bytes(input_->below(100)));
  }

  /// Asks for a link with the publisher here.
  void openLink()
  {
    FrameHeader header;
    header.type = FrameType::LINK_OPEN;
    header.id = input_->below(4);
    header.session = session_->peer->secret();
    LinkOpen open{publisher_socket_.toString(),
                  Token{}.toString(),
                  someName(input_),
                  someName(input_),
                  someName(input_),
                  someName(input_)};
    feed(header, open.encode());
  }

  /// The bridge comes to the publisher as a subscriber would.
  void acceptBridge()
  {
    if (SideChannel accepted = publisher_.accept())
    {
      process_ = HostilePair(std::move(accepted));
      process_.meet(input_);
    }
  }

  /// A process here asks for something; for a link, it stays as the subscriber.
  void request()
  {
    SideChannel channel = SideChannel::connect(BridgeRequest::socketName(bridge_.config().socket));
    BridgeRequest request;
    request.kind = static_cast<BridgeRequest::Kind>(1 + input_->below(4));
    request.address = input_->below(8) != 0 ? PEER_ADDRESS : someName(input_);
    request.socket_token = publisher_socket_.toString();
    request.link_token = Token{}.toString();
    request.topic = someName(input_);
    request.type = someName(input_);
    request.publisher = someName(input_);
    request.subscriber = someName(input_);
    request.port = 1;
    request.link = input_->below(16) != 0 ? NewsLayout::LINKS + 1 : input_->take<uint32_t>();
    const std::vector<uint8_t> packet = input_->below(8) != 0 ? request.encode() : input_->bytes(60);
    HostilePair pair(std::move(channel));
    if (request.kind == BridgeRequest::LINK)
    {
      pair.meet(input_);
    }
    pair.channel.sendBytes(packet.data(), packet.size());
    loop_.runOnce(std::chrono::milliseconds(0));
    loop_.runOnce(std::chrono::milliseconds(0));
    if (request.kind == BridgeRequest::LINK)
    {
      subscriber_ = std::move(pair);
      receiver_ = HostileReceiver();
    }
  }

  void interrupt()
  {
    switch (input_->below(6))
    {
      case 0:
        greet(1 + input_->below(2));
        break;
      case 1:
        if (session_->peer->lane(Traffic::EXPRESS).connected())
        {
          const FrameTransport::ConnectionId connection = session_->peer->lane(Traffic::EXPRESS).connection();
          transport_->close(connection);
          bridge_.dispatcher_.onClosed(connection, CloseReason::UNREACHABLE);
        }
        break;
      case 2:
        process_.channel.close();
        break;
      case 3:
        subscriber_.channel.close();
        break;
      case 4:
        bridge_.dispatcher_.onSourceClosed(SOURCE, CloseReason::MALFORMED, "");
        break;
      default:
        require(!bridge_.status().empty(), "there is a status at any time");
        break;
    }
  }

  FuzzInput* input_;
  EventLoop loop_;
  Token publisher_socket_;
  SideChannel publisher_;
  Bridge bridge_;
  FakeFrameTransport* transport_ = nullptr;
  Session* session_ = nullptr;
  HostilePair process_;     ///< the publisher's end
  HostilePair subscriber_;  ///< the subscriber's end
  HostileSender sender_;
  HostileReceiver receiver_;
};

void fuzz(FuzzInput input)
{
  Rig rig(&input);
  for (uint32_t step = 0; step < 200 && !input.empty(); ++step)
  {
    rig.step();
  }
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
