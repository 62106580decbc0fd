#pragma once

#include <array>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include <netinet/in.h>

#include "event_loop/event_loop.h"
#include "shm/file_descriptor.h"
#include "wire/frame_transport.h"
#include "wire/sp_socket.h"

namespace pi_os_transport
{

/// The incoming half of SpTransport: accepts connections of other bridges and reads their frames.
class SpReceiver
{
public:
  using SourceId = FrameTransport::SourceId;

  SpReceiver(EventLoop* loop, FrameTransport::Listener* listener);
  ~SpReceiver();

  // As in FrameTransport.
  bool listen(const Endpoint& endpoint, std::string* error);
  uint16_t port() const { return acceptors_.empty() ? uint16_t{0} : acceptors_.front()->port; }
  void closeSource(SourceId source);
  std::string addressOf(SourceId source) const;

private:
  struct Acceptor
  {
    FileDescriptor socket;
    uint16_t port = 0;
    Timer pause;
  };

  struct Source
  {
    enum class Stage
    {
      GREETING,
      LENGTH,
      HEADER,
      PAYLOAD,
    };

    SourceId id = 0;
    FileDescriptor socket;
    std::string address;
    bool closed = false;
    Timer timer;
    Stage stage = Stage::GREETING;
    std::array<uint8_t, FrameHeader::BYTES> head;  ///< of the stage before the payload
    size_t head_bytes = 0;
    FrameHeader header;
    uint32_t length = 0;  ///< of the payload
    uint32_t received = 0;
    uint8_t* payload = nullptr;
  };

  // Handlers hold their own pointer: callbacks may close the connection.
  using SourcePointer = std::shared_ptr<Source>;

  void onAcceptorEvent(Acceptor* acceptor);
  void addSource(FileDescriptor socket, const sockaddr_in& address);
  void onSourceEvent(const SourcePointer& source);
  void takeBytes(const SourcePointer& source, const uint8_t* bytes, size_t count);
  void onHeadBytes(const SourcePointer& source, size_t count);
  void onHeader(const SourcePointer& source);
  void onPayloadBytes(const SourcePointer& source, size_t count);
  void fail(const SourcePointer& source, CloseReason reason, const std::string& detail);
  void shut(Source* source);

  EventLoop* const loop_;
  FrameTransport::Listener* const listener_;
  std::vector<std::unique_ptr<Acceptor>> acceptors_;
  std::unordered_map<SourceId, SourcePointer> sources_;
  SourceId next_source_ = 1;
  std::vector<uint8_t> buffer_;  ///< empty between events
};

}  // namespace pi_os_transport
