#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "server/edge_metrics.h"
#include "server/edge_server.h"
#include "wire/one_way_delay.h"

namespace pi_offload
{

/// Requests come on the replier's thread; each worker has a thread. The mutex guards what they share.
struct EdgeServer::Impl
{
  /// Connection, vehicle, number of the request.
  using Key = std::tuple<uint64_t, std::string, uint64_t>;
  struct Job
  {
    Replier::Peer peer;
    OffloadRequest request;
    int64_t received_ns = 0;
    int64_t deadline_ns = 0;
    bool running = false;
    bool cancelled = false;  ///< while it ran
    size_t payload_bytes = 0;
  };
  struct Link
  {
    OneWayDelay delay;
    std::set<std::string> vehicles;
  };
  struct Worker
  {
    std::array<Executor, TASK_KINDS> executors;
    bool busy = false;
    int64_t busy_since_ns = 0;
    std::thread thread;
  };
  using Outgoing = std::vector<std::pair<Replier::Peer, OffloadReply>>;

  Impl(const EdgeServerOptions& options, Callbacks callbacks)
    : options(options), callbacks(std::move(callbacks)), admission(options.admission)
  {
  }

  std::unique_ptr<Replier> makeReplier();
  std::vector<uint8_t> status() const;
  void onRequest(const Replier::Peer& peer, const std::vector<uint8_t>& body, int64_t received_ns);
  void onTask(const Replier::Peer& peer, OffloadRequest request, double excess_s, int64_t now_ns, Outgoing* out);
  std::string onCancel(const Replier::Peer& peer, const OffloadRequest& request);
  void onClosed(uint64_t connection);
  void work(Worker* worker);
  OffloadReply execute(Worker* worker, const OffloadRequest& request, double* service_s);
  void answerExpired(int64_t now_ns, Outgoing* out);
  void eraseJob(uint64_t ticket);
  OffloadReply replyTo(const OffloadRequest& request, OffloadReply::Status status, int64_t now_ns) const;
  void send(std::unique_lock<std::mutex>* lock, Outgoing out);
  void log(const std::string& text) const;

  const EdgeServerOptions options;
  const Callbacks callbacks;

  mutable std::mutex mutex;
  std::condition_variable work_wanted;
  std::condition_variable work_done;
  Admission admission;
  std::map<uint64_t, Job> jobs;  ///< by ticket; queued and running
  std::map<Key, uint64_t> tickets;
  std::map<uint64_t, Link> links;
  std::map<std::string, uint64_t> connection_of;  ///< that a vehicle used last
  size_t payload_bytes = 0;
  size_t sending = 0;  ///< threads that send replies
  uint64_t next_ticket = 1;
  std::array<TaskDurations, TASK_KINDS> durations;
  Statistics counted;
  bool stop = false;  ///< requests are not taken any more, and the replier is not used by them

  std::vector<std::unique_ptr<Worker>> workers;
  std::unique_ptr<Replier> replier;
};

}  // namespace pi_offload
