#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "roscpp/fallback.h"
#include "roscpp/runtime.h"
#include "roscpp/services/service_statistics.h"
#include "shm/ring_receiver.h"
#include "shm/ring_sender.h"

namespace pi_os_transport
{

/// The client's end of one connection to a service. Requests and answers use one ring in shared memory each, and the
/// calling thread waits for its answer itself.
///
/// The TCPROS connection stays for the header, for the server's death and for calls that find no shared memory. Only
/// one call is under way at a time, as in roscpp. Thread safe, except where noted.
class ServiceCaller : public PairLink, public PoolLink, public std::enable_shared_from_this<ServiceCaller>
{
public:
  enum class Use
  {
    PERSISTENT,
    SINGLE_SHOT,        ///< the connection is for one call
    SINGLE_SHOT_PLAIN,  ///< the same, on TCPROS: another connection to this server gets shared memory
  };
  ServiceCaller(const std::string& service, const ros::ConnectionPtr& connection, Use use);
  ~ServiceCaller() override;

  /// The server's header has come. Network thread, once.
  /// @param field  the server's offer; empty: none.
  /// @return true if the server was reached, so that calls may soon use shared memory.
  bool meet(const std::string& field);
  /// The TCPROS connection has ended: the current call fails.
  void disconnect();

  enum class Outcome
  {
    SUCCESS,
    FAILURE,
    NOT_TAKEN,  ///< the server has not seen the request, and never will
  };
  /// Replaces ServiceServerLink::call.
  /// @param tcp_too  false: a request that cannot use shared memory is NOT_TAKEN.
  Outcome call(ros::ServiceServerLink* link, const ros::SerializedMessage& request, ros::SerializedMessage& response,
               bool tcp_too = true);

  bool singleShot() const { return use_ != Use::PERSISTENT; }
  /// The key of a single-shot connection in IdleServices. Set before the first call, constant afterwards.
  void setKey(const std::string& key) { key_ = key; }
  const std::string& key() const { return key_; }
  /// True while calls can use shared memory.
  bool ready() const { return state_ == State::READY; }
  /// True while calls can use shared memory, or may soon.
  bool promising() const;

  void collectReleased() override { collectReleasedFrom(requests_, &mutex_); }
  void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) override;
  void onPairEnded() override;
  void serve() override;

  /// The token with which the server asks for the ring of requests, in return.
  static Token returnToken(const Token& token) { return Token{token.high, token.low ^ 1}; }

private:
  enum class State
  {
    NEGOTIATING,
    READY,
    REFUSED,  ///< for good
    ENDED,
  };

  void onReturn(const std::shared_ptr<ProcessPair>& pair, const Packet& hello);
  void settle();
  void fail();
  void wakeCalls();
  void leaveAnswers();
  void closeRequests();
  void takeBackRequest();
  bool send(const ros::SerializedMessage& request, uint64_t number);
  Outcome awaitAnswer(ros::ServiceServerLink* link, const std::shared_ptr<RingReceiver>& answers, uint64_t number,
                      ros::SerializedMessage& response);
  Outcome fallBackToTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request,
                        ros::SerializedMessage& response);
  Outcome giveUp(ros::ServiceServerLink* link);

  const boost::weak_ptr<ros::Connection> connection_;
  const Use use_;
  std::string key_;
  const std::shared_ptr<ServiceStatistics> statistics_;
  std::atomic<Fallback> fallback_{Fallback::NEGOTIATING};  ///< why calls use TCPROS now
  Token return_token_;

  std::mutex call_mutex_;  ///< held during a call
  uint64_t calls_ = 0;     ///< number of the last call; with call_mutex_ held

  std::mutex mutex_;                 ///< guards the members below, except changes of state_
  std::condition_variable changed_;  ///< state_, or served_
  std::atomic<State> state_;
  uint64_t served_ = 0;  ///< memory of answers that has come
  std::unique_ptr<RingSender> requests_;
  std::shared_ptr<RingReceiver> answers_;  ///< shared with leases; null once the connection has ended
  bool requests_proven_ = false;
  bool answers_proven_ = false;
  bool taken_back_ = false;  ///< the server never saw the last request
  uint64_t copied_ = 0;
};

}  // namespace pi_os_transport
