// The session with another bridge: greetings, acknowledgements, and the end of connections in any order; and a tunnel
// through it.

#include <sys/socket.h>

#include <memory>

#include "bridge/tunnel.h"
#include "event_loop/event_loop.h"
#include "fuzz_input.h"
#include "wire/fake_frame_transport.h"

namespace pi_os_transport
{
namespace
{

void fuzz(FuzzInput input)
{
  EventLoop loop;
  FakeSession session(&loop);
  session.meet();
  int ends[2];
  require(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends) == 0, "socketpair");
  const FileDescriptor process(ends[0]);
  std::shared_ptr<Tunnel> tunnel;
  tunnel = std::make_shared<Tunnel>(&loop, session.peer.get(), 5,
                                    input.below(2) == 0 ? Tunnel::Side::CLIENT : Tunnel::Side::SERVER,
                                    FileDescriptor(ends[1]), "target", [&tunnel] { tunnel.reset(); });
  tunnel->start();
  session.on_interrupted = [&tunnel]
  {
    if (tunnel)
    {
      tunnel->rewind();
    }
  };
  for (uint32_t step = 0; step < 300 && !input.empty(); ++step)
  {
    FrameHeader header;
    const uint32_t kind = input.below(12);
    header.id = input.below(4);
    header.count = input.below(4);
    header.lane = input.below(4);
    header.offset = input.below(4) == 0 ? input.take<uint64_t>() : input.take<uint8_t>();
    const std::vector<uint8_t> bytes = input.bytes(input.below(60));
    const auto payload = std::make_unique<uint8_t[]>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), payload.get());
    const std::shared_ptr<Tunnel> one = tunnel;
    switch (kind)
    {
      case 0:
      {
        Hello hello;
        if (Hello::decode(bytes.data(), bytes.size(), &hello))
        {
          session.peer->onHello(hello);
        }
        break;
      }
      case 1:
        session.greet(FakeSession::OTHER_INSTANCE + input.below(2));
        break;
      case 2:
        session.peer->onAck(header);
        break;
      case 3:
        session.peer->acknowledge(static_cast<Traffic>(input.below(2)), header.count, input.below(2) == 1);
        break;
      case 4:
        if (session.peer->lane(Traffic::EXPRESS).connected())
        {
          session.interrupt();
        }
        break;
      case 5:
      case 6:
      case 7:
        if (one)
        {
          one->onData(header, payload.get(), static_cast<uint32_t>(bytes.size()));
        }
        break;
      case 8:
        if (one)
        {
          one->onCredit(header);
        }
        break;
      case 9:
        if (one)
        {
          one->onClose(header);
        }
        break;
      case 10:
        send(process.get(), bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
        break;
      default:
        session.peer->pump();
        session.transport.sent.clear();
        break;
    }
    loop.runOnce(std::chrono::milliseconds(0));
    char taken[4096];
    while (recv(process.get(), taken, sizeof(taken), MSG_DONTWAIT) > 0)
    {
    }
  }
  session.on_interrupted = nullptr;
  tunnel.reset();
  loop.runOnce(std::chrono::milliseconds(0));
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
