#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "roscpp/queue_waiter.h"
#include "roscpp/runtime.h"
#include "roscpp/services/service_statistics.h"
#include "shm/ring_receiver.h"
#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// The server's end of one connection to a service, see ServiceCaller. Takes requests from one ring, if possible in the
/// thread that waits for callbacks, and answers through the other ring. Requests over TCPROS, and answers that find no
/// shared memory, are answered over TCPROS. Thread safe, except where noted.
class ServiceResponder : public PairLink, public PoolLink, public std::enable_shared_from_this<ServiceResponder>
{
public:
  ServiceResponder(const std::string& service, const ros::ServiceClientLinkPtr& link,
                   const ros::ConnectionPtr& connection)
    : link_(link), connection_(connection), statistics_(Runtime::instance().served_services.of(service))
  {
  }

  const Token& token() const { return token_; }

  /// The client asks for the ring of answers. Network thread.
  void meet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello);
  /// The TCPROS connection has ended.
  void disconnect();

  /// Replaces ServiceClientLink::processResponse for a request that came through shared memory.
  /// @return false if the request came over TCPROS.
  bool respond(const ros::SerializedMessage& response);

  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override;
  void onPairEnded() override;
  void serve() override;
  void collectReleased() override { collectReleasedFrom(answers_, &mutex_); }

private:
  void startRequests();  // with mutex_ held
  void closeRequests();
  void closeAnswers();
  void drop();

  const boost::weak_ptr<ros::ServiceClientLink> link_;
  const boost::weak_ptr<ros::Connection> connection_;
  const std::shared_ptr<ServiceStatistics> statistics_;
  const Token token_ = Token::random();

  std::mutex mutex_;
  bool ended_ = false;
  std::unique_ptr<RingSender> answers_;
  bool answers_proven_ = false;
  std::shared_ptr<RingReceiver> requests_;  ///< shared with leases; null once the connection has ended
  bool in_use_ = false;                     ///< requests are taken
  std::shared_ptr<QueueWaiter> waiter_;
  uint64_t pending_ = 0;   ///< number of the unanswered request from shared memory; 0: none
  uint64_t taken_ns_ = 0;  ///< when the request was taken
  uint64_t copied_ = 0;
};

}  // namespace pi_os_transport
