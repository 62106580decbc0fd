#pragma once

#include <ros/callback_queue.h>
#include <ros/connection.h>
#include <ros/message_deserializer.h>
#include <ros/poll_set.h>
#include <ros/publisher.h>
#include <ros/service_client_link.h>
#include <ros/service_manager.h>
#include <ros/service_server_link.h>
#include <ros/topic_manager.h>
#include <ros/transport/transport_tcp.h>
#include <ros/transport_publisher_link.h>
#include <ros/transport_subscriber_link.h>

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <shared_mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "roscpp/options.h"
#include "shm/process_pair.h"
#include "shm/ring_sender.h"
#include "shm/side_channel.h"
#include "shm/slot_pool.h"
#include "shm/wake_board.h"

#include "preload/hooks.h"
#include "roscpp/fallback.h"
#include "roscpp/services/service_statistics.h"

namespace pi_os_transport
{

class ReceiveLink;
class ServiceCaller;
class ServiceResponder;
class TransmitLink;

/// Field of the TCPROS connection header. A subscriber sends the protocol version; a publisher answers with
/// "<version> <socket token> <link token>". Peers without the library ignore the field.
constexpr const char* HEADER_FIELD = "pi_os";
/// Transport of a link in shared memory, as getBusInfo and `rosnode info` show it.
constexpr const char* TRANSPORT_NAME = "SHMROS";
/// Transport of a link through bridges (nanomsg's protocol).
constexpr const char* BRIDGED_TRANSPORT_NAME = "NNROS";

/// The replaced functions of libroscpp.
struct Originals
{
  void (*start)(ros::TopicManager*);
  void (*publish)(ros::TopicManager*, const std::string&, const boost::function<ros::SerializedMessage()>&,
                  ros::SerializedMessage&);
  void (*publisher_publish)(const ros::Publisher*, const boost::function<ros::SerializedMessage()>&,
                            ros::SerializedMessage&);
  void (*add_subscriber_link)(ros::Publication*, const ros::SubscriberLinkPtr&);
  void (*write_header)(ros::Connection*, const ros::M_string&, const ros::WriteFinishedFunc&);
  bool (*handle_header)(ros::TransportSubscriberLink*, const ros::Header&);
  void (*enqueue_message)(ros::TransportSubscriberLink*, const ros::SerializedMessage&, bool, bool);
  std::string (*subscriber_transport_type)(ros::TransportSubscriberLink*);
  std::string (*subscriber_transport_info)(ros::TransportSubscriberLink*);
  bool (*initialize)(ros::TransportPublisherLink*, const ros::ConnectionPtr&);
  bool (*header_received)(ros::TransportPublisherLink*, const ros::ConnectionPtr&, const ros::Header&);
  boost::shared_ptr<void const> (*deserialize)(ros::MessageDeserializer*);
  void (*handle_message)(ros::TransportPublisherLink*, const ros::SerializedMessage&, bool, bool);
  std::string (*publisher_transport_type)(ros::TransportPublisherLink*);
  std::string (*publisher_transport_info)(ros::TransportPublisherLink*);
  void (*add_callback)(ros::CallbackQueue*, const ros::CallbackInterfacePtr&, uint64_t);
  void (*call_available)(ros::CallbackQueue*, ros::WallDuration);
  ros::CallbackQueue::CallOneResult (*call_one)(ros::CallbackQueue*, ros::WallDuration);
  void (*disable)(ros::CallbackQueue*);
  bool (*lookup_service)(ros::ServiceManager*, const std::string&, std::string&, uint32_t&);
  bool (*tcp_connect)(ros::TransportTCP*, const std::string&, int);
  ros::ServiceServerLinkPtr (*service_create_link)(ros::ServiceManager*, const std::string&, bool, const std::string&,
                                                   const std::string&, const ros::M_string&);
  bool (*service_initialize)(ros::ServiceServerLink*, const ros::ConnectionPtr&);
  bool (*service_header_received)(ros::ServiceServerLink*, const ros::ConnectionPtr&, const ros::Header&);
  bool (*service_call)(ros::ServiceServerLink*, const ros::SerializedMessage&, ros::SerializedMessage&);
  void (*service_clear_calls)(ros::ServiceServerLink*);
  void (*service_remove_link)(ros::ServiceManager*, const ros::ServiceServerLinkPtr&);
  bool (*service_handle_header)(ros::ServiceClientLink*, const ros::Header&);
  void (*service_process_response)(ros::ServiceClientLink*, bool, const ros::SerializedMessage&);
};

/// Replaces one function of libroscpp.
template <typename Function>
void takeOver(PiOsShim* shim, PiOsHook hook, Function** original, Function* replacement)
{
  *original = reinterpret_cast<Function*>(shim->original[hook]);
  shim->replacement[hook] = reinterpret_cast<void*>(replacement);
}

/// Call when the peer has closed its connection to this process, for example because it has ended. Drops the TCPROS
/// connection if there is nothing to read: a forked child of the peer may keep that socket open. Network thread,
/// without locks.
void dropIfSilent(const ros::ConnectionPtr& connection);

/// Additional state of roscpp's link objects, found by their connection. A link that reconnects gets a new connection.
/// Never destroyed. Thread safe.
template <typename Link, typename Key = ros::Connection>
class LinkTable
{
public:
  std::shared_ptr<Link> find(const Key* key) const
  {
    std::shared_lock<std::shared_mutex> lock(mutex_);
    const auto found = links_.find(key);
    return found != links_.end() ? found->second : nullptr;
  }
  void insert(const Key* key, std::shared_ptr<Link> link)
  {
    std::unique_lock<std::shared_mutex> lock(mutex_);
    links_[key] = std::move(link);
  }
  void erase(const Key* key)
  {
    std::unique_lock<std::shared_mutex> lock(mutex_);
    links_.erase(key);
  }
  /// Holds `link` until its connection ends, and then calls `ended(reason)`.
  template <typename Ended>
  void hold(const ros::ConnectionPtr& connection, std::shared_ptr<Link> link, Ended ended)
  {
    insert(connection.get(), std::move(link));
    connection->addDropListener(
        [this, key = connection.get(), ended](const ros::ConnectionPtr&, ros::Connection::DropReason reason)
        {
          erase(key);
          ended(reason);
        });
  }
  size_t size() const
  {
    std::shared_lock<std::shared_mutex> lock(mutex_);
    return links_.size();
  }

private:
  mutable std::shared_mutex mutex_;
  std::unordered_map<const Key*, std::shared_ptr<Link>> links_;
};

/// A link whose peer reads messages in this process's pool. Thread safe.
class PoolLink
{
public:
  virtual ~PoolLink() = default;
  /// Takes back what the peer has released, unless the link is busy.
  virtual void collectReleased() = 0;
};

// PoolLink's function for a link that guards its ring by a mutex.
template <typename Mutex>
void collectReleasedFrom(const std::unique_ptr<RingSender>& ring, Mutex* mutex)
{
  const std::unique_lock<Mutex> lock(*mutex, std::try_to_lock);
  if (lock.owns_lock() && ring)
  {
    ring->collect();
  }
}

/// The state of the library in one process. Made when roscpp is first used. Never destroyed, because static destructors
/// may release messages.
class Runtime
{
public:
  static Runtime& instance();

  /// False in a forked child, where all hooks only call the original.
  bool active() const { return !isForkedChild(); }

  Originals original{};
  PiOsShim* shim = nullptr;
  Options options;  ///< complete once the node has started, constant afterwards

  LinkTable<TransmitLink> transmit_links;
  LinkTable<ReceiveLink> receive_links;
  /// Without a connection any more, but bridges still bring the rest: one for each link of roscpp.
  LinkTable<ReceiveLink, ros::TransportPublisherLink> ending_receive_links;
  LinkTable<ServiceCaller> service_callers;
  LinkTable<ServiceResponder> service_responders;
  ServiceStatisticsTable called_services;
  ServiceStatisticsTable served_services;

  /// The pool of outgoing messages; made by the first call.
  SlotPool& pool();
  /// Shared memory that one subscriber may pin before it has to copy [B].
  uint64_t leaseBudget() const { return (options.pool_limit_mb << 20) / 8; }

  /// The number of links that publish through shared memory now.
  std::atomic<int> active_transmit_links{0};

  /// Arrays of received messages that were not filled with zeros before they were overwritten.
  std::atomic<uint64_t> skipped_zero_fills{0};

  /// Opens the socket for other processes. @return false on failure.
  bool listen();

  /// Called with a HELLO packet with the link's token. Network thread.
  using Claim = std::function<void(const std::shared_ptr<ProcessPair>& pair, const Packet& hello)>;

  /// Registers a link whose peer may fetch its shared memory, more than once.
  /// @return the header field to answer with; empty if this process cannot listen.
  std::string expect(const Token& link, Claim claim);
  void forget(const Token& link);

  /// The connection to the process that listens at `socket`; made if there is none. Network thread.
  /// @return null, with `*reason` set.
  std::shared_ptr<ProcessPair> pairWith(const Token& socket, Fallback* reason);
  /// The connection to this device's bridge; made if there is none. Network thread. @return null if none runs.
  std::shared_ptr<ProcessPair> pairWithBridge();
  /// Calls PairLink::serve() of the links with news. Any thread.
  void serveNews();
  bool hasNews();
  /// A place on the WakeLayout of this process that no other thread uses. @return its Doorbell; 0 if none is free.
  uint32_t takeSleeper();
  void giveSleeper(uint32_t doorbell);
  Sleeper sleeper(uint32_t doorbell) const { return Sleeper(&wake_layout_->sleepers[doorbell - FIRST_SPINNER]); }

  /// Warns, once in this process, of a limit that keeps links or messages on TCPROS. Any thread.
  void warnOfShortage(const std::string& what);
  bool warnedOfShortage() const { return shortage_warned_.load(std::memory_order_relaxed); }

  /// Links with a ring: links in use, and links whose peer still reads old messages.
  void addChannel(const std::shared_ptr<PoolLink>& link);
  void removeChannel(const std::shared_ptr<PoolLink>& link);

  /// Tells peers about segments that the pool has freed.
  void announceRetired();

  /// Calls `ready(events)` on roscpp's network thread whenever `fd` is readable, until unwatch().
  void watch(int fd, const boost::function<void(int)>& ready);
  void unwatch(int fd);
  /// Calls `task` once, soon, on roscpp's network thread. Any thread. @return false if there are no descriptors for it.
  bool later(std::function<void()> task);

private:
  using Pairs = std::vector<std::shared_ptr<ProcessPair>>;

  Runtime() = default;
  bool listenLocked();  // with listen_mutex_ held
  void acceptAll();
  void resumeAccepting();
  void onFirstPacket(const std::shared_ptr<SideChannel>& channel);
  std::shared_ptr<ProcessPair> addPair(SideChannel channel, const Token& token, bool bridge);
  std::shared_ptr<const ProcessPair::Host> host();
  std::shared_ptr<const ProcessPair::Host> makeHost();
  WakeLayout* wakeLayout();  ///< null if there is no memory
  void endPair(const std::shared_ptr<ProcessPair>& pair);
  bool greet(const std::shared_ptr<ProcessPair>& pair, const Packet& hello);
  std::shared_ptr<const Pairs> pairs();
  void runTasks();
  void collectReleased();
  std::vector<std::shared_ptr<PoolLink>> channels() const;

  std::once_flag pool_made_;
  std::unique_ptr<SlotPool> pool_;

  std::mutex listen_mutex_;
  Token socket_token_;
  SideChannel listener_;
  std::chrono::steady_clock::time_point accept_again_;  ///< network thread; zero: accepting
  std::map<Token, Claim> expected_;

  struct KnownPair
  {
    std::shared_ptr<ProcessPair> pair;
    Token token;  ///< of the peer's socket
    bool bridge;
  };
  std::mutex pairs_mutex_;
  std::vector<KnownPair> known_pairs_;
  std::shared_ptr<const Pairs> pairs_ = std::make_shared<const Pairs>();  ///< those of known_pairs_
  std::once_flag host_made_;
  std::shared_ptr<const ProcessPair::Host> host_;
  std::once_flag wake_made_;
  FileDescriptor wake_memory_;
  SharedMapping wake_mapping_;
  WakeLayout* wake_layout_ = nullptr;
  std::array<bool, WakeLayout::SLEEPERS> sleepers_{};  ///< in use

  std::mutex tasks_mutex_;
  FileDescriptor tasks_event_;
  std::vector<std::function<void()>> tasks_;
  std::atomic<bool> shortage_warned_{false};

  mutable std::mutex channels_mutex_;
  std::set<std::shared_ptr<PoolLink>> channels_;
};

}  // namespace pi_os_transport
