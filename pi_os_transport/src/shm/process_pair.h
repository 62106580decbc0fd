#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "shm/file_descriptor.h"
#include "shm/mapped_segment.h"
#include "shm/shared_memory.h"
#include "shm/side_channel.h"
#include "shm/slot_pool.h"
#include "shm/wake_board.h"

namespace pi_os_transport
{

/// Longest packet between two processes: a request to a bridge [B].
constexpr size_t LONGEST_PACKET = 4096;

/// One end of one link between two processes.
class PairLink
{
public:
  virtual ~PairLink() = default;
  /// A packet about this link has come. Network thread, without locks.
  virtual void onPacket(const Packet& packet, SideChannel::Descriptors* descriptors) = 0;
  /// The connection of the two processes has ended. Network thread, without locks.
  virtual void onPairEnded() = 0;
  /// The receiving end: takes what is due from the ring. Any thread, without locks of the pair.
  virtual void serve() {}
};

/// What two processes share for all links between them, in both directions: one socket, the pools' segments that one
/// has mapped of the other, and the way to wake each other. Lives until one of the processes ends.
///
/// All packets of a link carry its number. The end that receives messages chooses it. Thread safe, except where noted.
/// The mutexes are never held while a link is called, so links may call everything with their own locks held.
class ProcessPair : public std::enable_shared_from_this<ProcessPair>
{
public:
  /// What the process does for its pairs. Called on the network thread, except where noted.
  struct Host
  {
    Token token;           ///< of this process's own socket; zero: others cannot connect to it
    int wake_memory = -1;  ///< descriptor of a WakeLayout; -1: no thread of this process sleeps there
    /// A peer has sent HELLO. @return false if its link is not expected.
    std::function<bool(const std::shared_ptr<ProcessPair>&, const Packet& hello)> on_hello;
    /// Bytes that are no Packet. @return false if they are not acceptable; null: none are.
    std::function<bool(const std::shared_ptr<ProcessPair>&, const std::vector<uint8_t>&)> on_request;
    std::function<void(const std::shared_ptr<ProcessPair>&)> on_met;  ///< peerToken() is known; null: of no interest
    /// Any thread: packets wait until the socket is writable; false: no more.
    std::function<void(ProcessPair*, bool wanted)> want_write;
    /// Any thread: receive() has to be called soon.
    std::function<void(const std::shared_ptr<ProcessPair>&)> receive_soon;
    std::function<void(const std::string& shortage)> on_shortage;  ///< any thread; see describeShortage()
  };

  /// @return null on failure, with `*shortage` set, which is empty if the peer has left.
  static std::shared_ptr<ProcessPair> make(SideChannel channel, std::shared_ptr<const Host> host,
                                           std::string* shortage);

  int fd() const { return channel_.fd(); }
  /// True once the peer has introduced itself.
  bool met() const { return met_.load(std::memory_order_acquire); }
  /// Of the peer's own socket; zero before its first packet, or if it has none.
  const Token& peerToken() const { return peer_token_; }

  /// Reads and handles waiting packets, serves links with news. Network thread, without locks.
  /// @return false if the peer has left or broken the rules: call end().
  bool receive();
  /// Sends what waits. Network thread.
  void flush();
  /// Ends all links. Network thread, without locks.
  void end();
  bool ended() const { return ended_.load(std::memory_order_acquire); }

  /// Serves the links with news. Any thread, without locks.
  void serveNews();
  bool hasNews() const { return NewsBoard(own_news_).any(); }

  // Links of this process. Each is held until removed or the pair ends.
  /// @return the number of the link; 0 if there are too many, or the pair has ended.
  uint32_t addReceiver(const std::shared_ptr<PairLink>& link);
  /// The link is not called any more; its number stays in use until leave().
  void removeReceiver(uint32_t number);
  /// Nothing more is read in the memory of this link.
  void leave(uint32_t number);
  /// @return false if the peer uses this number already, or the pair has ended.
  bool addSender(uint32_t number, const std::shared_ptr<PairLink>& link);
  void removeSender(uint32_t number, const PairLink* link);

  /// Sends a packet now, or as soon as the peer reads. @param descriptor  goes with it and is closed here.
  /// @return false if the peer has left, or has too many descriptors on the way; errno tells.
  bool send(const Packet& packet, FileDescriptor descriptor = FileDescriptor());
  bool sendBytes(const std::vector<uint8_t>& bytes);
  /// Tells the peer of a segment, unless it knows it. @return false if that is impossible now.
  bool announce(const SlotPool& pool, uint32_t segment);
  /// These segments are not used any more.
  void retire(const std::vector<uint32_t>& segments);
  /// Wakes the receiver of a link. @param doorbell  other than WAITING_THREAD.
  void wake(uint32_t number, uint32_t doorbell);

  enum class Lookup
  {
    FOUND,
    UNKNOWN,  ///< has not come yet; the link is served when a segment comes
    LOST,     ///< this process had no room for its descriptor
  };
  /// Finds a segment of the peer's pool. @param number  of the link that needs it.
  Lookup findSegment(uint32_t segment, uint32_t number, std::shared_ptr<MappedSegment>* found);

private:
  struct Unsent
  {
    std::vector<uint8_t> bytes;
    FileDescriptor descriptor;
  };
  struct Received
  {
    Packet packet;
    SideChannel::Descriptors descriptors;
    std::vector<uint8_t> request;
    bool shortage = false;
  };

  ProcessPair(SideChannel channel, std::shared_ptr<const Host> host)
    : channel_(std::move(channel)), host_(std::move(host))
  {
  }
  bool introduce(std::string* shortage);
  bool pull();
  bool sort(Received* received);
  bool meet(Received* received);
  void onSegment(Received* received);
  bool handle(Received* received);
  void serve(uint32_t number);
  bool sendLocked(const void* bytes, size_t length, FileDescriptor descriptor);
  std::shared_ptr<PairLink> findLink(uint32_t addressed) const;

  SideChannel channel_;
  const std::shared_ptr<const Host> host_;
  std::atomic<bool> ended_{false};
  std::atomic<bool> met_{false};

  SharedMapping own_news_memory_;
  NewsLayout* own_news_ = nullptr;
  SharedMapping peer_news_memory_;  ///< like those below set by MEET, before any link exists
  SharedMapping peer_wake_memory_;
  NewsLayout* peer_news_ = nullptr;
  WakeLayout* peer_wake_ = nullptr;
  Token peer_token_;

  std::mutex receive_mutex_;  ///< one thread reads the socket; taken before mutex_
  bool closed_ = false;       ///< the peer has left or broken the rules
  std::deque<Received> received_;

  mutable std::mutex mutex_;
  std::map<uint32_t, std::shared_ptr<PairLink>> receivers_;
  std::map<uint32_t, std::shared_ptr<PairLink>> senders_;
  std::vector<uint32_t> numbers_;  ///< by place in the NewsLayout: number of the link; 0: free
  uint32_t next_place_ = 0;
  uint32_t generation_ = 1;
  std::deque<Unsent> unsent_;
  std::vector<uint32_t> announced_;                              ///< segments of this process that the peer knows
  std::map<uint32_t, std::shared_ptr<MappedSegment>> segments_;  ///< of the peer; null: lost
  std::vector<uint32_t> awaiting_;                               ///< links that need a segment which has not come
};

}  // namespace pi_os_transport
