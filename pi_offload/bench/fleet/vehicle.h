#pragma once

#include "engine/offload_engine.h"
#include "wire/sp_socket.h"
#include "wire/wire_message.h"

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "fleet.h"

namespace pi_offload_bench
{

/// One of the fleet, with a connection to each server. Thread safe.
class Vehicle
{
public:
  /// @param begin_ns, end_ns  tasks that come between count.
  Vehicle(size_t number, const FleetOptions& options, const FleetInputs& inputs, int64_t begin_ns, int64_t end_ns);
  ~Vehicle();
  Vehicle(const Vehicle&) = delete;
  Vehicle& operator=(const Vehicle&) = delete;

  void create(pi_offload::TaskKind kind, int64_t now_ns);  ///< a task
  void onTime(int64_t now_ns);                             ///< to be called every few milliseconds
  bool busy() const;                                       ///< a task that counts has not ended
  /// Its part of the fleet's.
  std::array<FleetTally, pi_offload::TASK_KINDS> tally() const;

private:
  enum class End
  {
    IN_TIME,
    REFUSED,
    GIVEN_BACK,
    KEPT,
    LATE,
    FAILED,
  };
  /// On its way to a server and back.
  struct Request
  {
    size_t server = 0;
    uint64_t number = 0;  ///< that the server knows it by
    uint64_t task = 0;    ///< 0: a probe or a cancellation
    int64_t sent_ns = 0;
    size_t bytes = 0;
  };
  struct TaskState
  {
    pi_offload::TaskKind kind = pi_offload::TaskKind::DETECTION;
    int64_t created_ns = 0;
    size_t picture = 0;
    size_t asked = 0;  ///< servers
  };
  struct Server
  {
    std::string id;
    std::unique_ptr<pi_offload::SpRequester> link;
    bool up = false;
    pi_offload::NodeAdvertisement said;
    int64_t asked_ns = 0;  ///< last
  };

  void makeEngine();
  size_t serverOf(const std::string& id) const;
  bool send(size_t server, pi_offload::OffloadRequest request, uint64_t task);
  bool sendTask(size_t server, uint64_t number, uint64_t task, double deadline_s);
  pi_offload::OffloadRequest requestOf(size_t server, pi_offload::OffloadRequest::Type type, uint64_t number) const;
  size_t shorterQueue(pi_offload::TaskKind kind) const;
  void ask(uint64_t task, size_t server);
  void onReply(size_t server, uint32_t id, const std::vector<uint8_t>& body, int64_t received_ns);
  void onAnswer(const Request& request, const pi_offload::OffloadReply& reply, int64_t received_ns);
  void onEngineAnswer(const Request& request, const pi_offload::OffloadReply& reply, int64_t received_ns);
  void onLink(size_t server, bool up);
  void endTask(uint64_t task, End end, int64_t now_ns);
  bool counts(const TaskState& task) const { return task.created_ns >= begin_ns_ && task.created_ns < end_ns_; }

  const FleetOptions& options_;
  const FleetInputs& inputs_;
  const int64_t begin_ns_;
  const int64_t end_ns_;
  const std::string name_;

  mutable std::mutex mutex_;
  std::vector<Server> servers_;
  size_t current_ = 0;  ///< server that is asked first, and for leases
  uint64_t next_task_ = 1;
  uint64_t next_number_ = 1;
  uint32_t next_id_ = 1;
  std::map<uint64_t, TaskState> tasks_;
  std::map<uint32_t, Request> requests_;
  std::array<FleetTally, pi_offload::TASK_KINDS> tally_;
  std::array<int64_t, pi_offload::TASK_KINDS> served_ns_;  ///< last
  std::unique_ptr<pi_offload::OffloadEngine> engine_;
  struct LocalRun
  {
    uint64_t task = 0;
    int64_t done_ns = 0;
  };
  std::deque<LocalRun> local_;
};

}  // namespace pi_offload_bench
