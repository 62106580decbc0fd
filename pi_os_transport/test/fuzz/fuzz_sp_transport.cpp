// What comes over TCP before anybody knows who speaks: SP headers, lengths, frames.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <array>
#include <memory>

#include "event_loop/event_loop.h"
#include "fuzz_input.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{
namespace
{

class Sink : public FrameTransport::Listener
{
public:
  void onConnected(FrameTransport::ConnectionId) override {}
  void onWritable(FrameTransport::ConnectionId) override {}
  void onClosed(FrameTransport::ConnectionId, CloseReason) override {}
  bool onAccept(const std::string&) override { return true; }
  uint8_t* onHeader(FrameTransport::SourceId, const FrameHeader& header, uint32_t length) override
  {
    require(length <= MAX_PAYLOAD, "no frame is longer than MAX_PAYLOAD");
    place_ = std::make_unique<uint8_t[]>(length);
    return header.count == 77 ? nullptr : place_.get();
  }
  void onFrame(FrameTransport::SourceId, const FrameHeader& header, uint8_t* payload, uint32_t length) override
  {
    require(length == 0 || payload == place_.get(), "the payload lies where it was wanted");
    frames += header.type == FrameType::PING ? 0 : 1;
  }
  void onSourceClosed(FrameTransport::SourceId, CloseReason, const std::string&) override { closed = true; }

  size_t frames = 0;
  bool closed = false;

private:
  std::unique_ptr<uint8_t[]> place_;
};

void fuzz(FuzzInput input)
{
  EventLoop loop;
  Sink sink;
  const std::unique_ptr<FrameTransport> transport = makeSpTransport(&loop, &sink);
  std::string error;
  require(transport->listen({"127.0.0.1", 0}, &error), "listen");
  const FileDescriptor client(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(transport->port());
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const linger reset{1, 0};  // leaves no port behind
  setsockopt(client.get(), SOL_SOCKET, SO_LINGER, &reset, sizeof(reset));
  require(connect(client.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0, "connect");
  if (input.below(8) != 0)
  {
    const uint8_t push[] = {0, 'S', 'P', 0, 0, 0x50, 0, 0};
    send(client.get(), push, sizeof(push), MSG_NOSIGNAL);
  }
  while (!input.empty() && !sink.closed)
  {
    const uint32_t kind = input.below(4);
    std::vector<uint8_t> bytes = input.bytes(input.below(120));
    if (kind != 0)
    {
      // A frame that is one as far as its length and the beginning of its header go.
      FrameHeader header;
      header.type = static_cast<FrameType>(1 + input.below(LAST_FRAME_TYPE));
      header.count = input.below(80);
      const auto head = header.encode();
      std::vector<uint8_t> frame(8);
      frame[7] = static_cast<uint8_t>(head.size() + bytes.size());
      frame.insert(frame.end(), head.begin(), head.end());
      frame.insert(frame.end(), bytes.begin(), bytes.end());
      bytes.swap(frame);
    }
    send(client.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    loop.runOnce(std::chrono::milliseconds(0));
  }
  loop.runOnce(std::chrono::milliseconds(0));
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
