#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "roscpp/fallback.h"
#include "shm/file_descriptor.h"
#include "shm/ring_receiver.h"
#include "shm/ring_sender.h"
#include "roscpp/runtime.h"
#include "roscpp/services/service_statistics.h"

namespace pi_os_transport
{

/// The client's end of one connection to a service: requests go out through a ring in shared memory, answers come back
/// through another, and the thread that calls waits for its answer itself.
///
/// The TCPROS connection stays: for the header, for the server's death and for every call that finds no shared memory.
/// One call is under way at a time, as in roscpp, so the answers need no order. All methods may be called from any
/// thread unless they say otherwise.
class ServiceCaller : public PoolLink, public std::enable_shared_from_this<ServiceCaller>
{
public:
  enum class Use
  {
    PERSISTENT,
    SINGLE_SHOT,        ///< the client wants the connection for one call
    SINGLE_SHOT_PLAIN,  ///< and this one stays on TCPROS, as another to the same server is about to get shared memory
  };
  ServiceCaller(const std::string& service, const ros::ConnectionPtr& connection, Use use);
  ~ServiceCaller() override;

  /// The server's header has come. Network thread, once.
  /// @param field  what it offers; empty: nothing.
  /// @return true if the server was reached, so that calls may soon go through shared memory.
  bool meet(const std::string& field);
  /// The TCPROS connection has ended: a call under way fails.
  void disconnect();

  enum class Outcome
  {
    SUCCESS,
    FAILURE,
    NOT_TAKEN,  ///< the server has not seen the request, and never will
  };
  /// Replaces ServiceServerLink::call.
  /// @param tcp_too  false: a request that shared memory cannot take is NOT_TAKEN.
  Outcome call(ros::ServiceServerLink* link, const ros::SerializedMessage& request, ros::SerializedMessage& response,
               bool tcp_too = true);

  bool singleShot() const { return use_ != Use::PERSISTENT; }
  /// Under which IdleServices keeps a single-shot connection. Set before the first call, constant afterwards.
  void setKey(const std::string& key) { key_ = key; }
  const std::string& key() const { return key_; }
  /// True while calls can go through shared memory.
  bool ready() const { return state_ == State::READY; }
  /// True while they can, or may soon.
  bool promising() const;

  void collectReleased() override;
  void retire(const std::vector<uint32_t>& segments) override;

private:
  enum class State
  {
    NEGOTIATING,
    READY,
    REFUSED,  ///< for good
    ENDED,
  };

  void onAnswerChannel();
  void onRequestChannel();
  void settle();
  void fail();
  void wake();
  void awaitWake(int doorbell);
  void leaveAnswers();
  void closeRequests();
  void takeBackRequest();
  bool send(const ros::SerializedMessage& request, uint64_t number);
  Outcome awaitAnswer(ros::ServiceServerLink* link, const std::shared_ptr<RingReceiver>& answers, uint64_t number,
                      ros::SerializedMessage& response);
  Outcome fallBackToTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request,
                        ros::SerializedMessage& response);
  Outcome giveUp();

  const boost::weak_ptr<ros::Connection> connection_;
  const Use use_;
  std::string key_;
  const std::shared_ptr<ServiceStatistics> statistics_;
  std::atomic<Fallback> fallback_{Fallback::NEGOTIATING};  ///< why calls would go over TCPROS now
  const FileDescriptor wake_;                              ///< an eventfd: state_ has changed

  std::mutex call_mutex_;  ///< held during a call
  uint64_t calls_ = 0;     ///< number of the last call; with call_mutex_ held

  std::mutex mutex_;  ///< guards what follows, but for changes of state_
  std::atomic<State> state_;
  std::unique_ptr<RingSender> requests_;
  std::shared_ptr<RingReceiver> answers_;  ///< shared with leases; null once the connection has ended
  bool requests_proven_ = false;
  bool answers_proven_ = false;
  bool taken_back_ = false;  ///< the last request: the server never sees it
  uint64_t copied_ = 0;
};

}  // namespace pi_os_transport
