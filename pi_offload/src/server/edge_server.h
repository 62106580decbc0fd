#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "engine/node.h"
#include "server/admission.h"
#include "wire/nats_connection.h"
#include "wire/sp_socket.h"
#include "wire/wire_message.h"

namespace pi_offload
{

/// Does one task. Called from one thread. Fills status, text and result of the reply, and optionally the model; the
/// server fills the rest. An exception becomes a reply FAILED with its text.
/// @param service_s  in: negative; out: time of the task, if it differs from the time of the call [s].
using Executor = std::function<OffloadReply(const OffloadRequest& request, double* service_s)>;
/// Makes an executor; the server's constructor calls it once for each worker. May throw.
using ExecutorFactory = std::function<Executor()>;

struct EdgeServerOptions
{
  SpReplier::Options replier;  ///< address and limits of connections; NATS: idle_timeout_s
  Transport transport = Transport::DIRECT;
  NatsOptions nats;
  std::string site = "site";               ///< NATS: name of the node
  std::string address;                     ///< NATS: of the site's server, told to vehicles
  std::string network = "accurate";        ///< NATS: name of the network that pictures are asked for
  AdmissionOptions admission;              ///< `served` follows from the executors
  std::string model;                       ///< network of DETECTION, sent in each reply; empty: not sent
  bool has_position = false;               ///< the position is sent to vehicles
  Point position;                          ///< in the map [m]
  double range_m = 0.0;                    ///< of the node's network [m]; infinite: everywhere
  size_t max_payload_bytes = 256U << 20U;  ///< of all queued and running tasks; further ones are refused
  double max_task_s = 30.0;                ///< a worker that takes longer hangs, and the server is not live

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// An edge-cloud node without ROS: receives requests of vehicles, lets Admission decide, does tasks on worker threads,
/// and reports its load with each reply. It keeps only leases of a vehicle, so that another server can replace it.
///
/// - PROBE is answered at once, TASK when it is done or refused. A TASK that is repeated on its connection is done
/// once,
///   and the answer goes to the later one.
/// - CANCEL is answered at once with OK and a text; the cancelled task gets no answer.
/// - The delay of a request beyond the fastest recent one of its connection counts against its remaining time.
/// - A connection that ends drops the tasks and leases of its vehicles, except of vehicles with another connection.
/// - A peer that sends anything but a request is disconnected.
///
/// Thread safe.
class EdgeServer
{
public:
  struct Callbacks
  {
    /// For the log: bad requests, failed tasks. Called from any thread; must not throw; may be empty.
    std::function<void(const std::string& text)> event;
  };
  /// Makes the executors, then listens.
  /// @param executors  by kind, at least one; empty: kind not served.
  /// @throws std::invalid_argument for options; std::runtime_error naming the address, or kind and worker of a factory
  ///   that failed.
  EdgeServer(const EdgeServerOptions& options, const std::array<ExecutorFactory, TASK_KINDS>& executors,
             Callbacks callbacks = {});
  ~EdgeServer();  ///< Waits for running tasks; does not answer queued ones. See drain().
  EdgeServer(const EdgeServer&) = delete;
  EdgeServer& operator=(const EdgeServer&) = delete;

  uint16_t port() const;  ///< 0: it does not listen, as with NATS

  /// Refuses new tasks, says so in advertisements, and waits until all tasks are done and answered.
  /// @return false if that took too long; call it again or give up.
  bool drain(double timeout_s);

  struct Health
  {
    bool live = false;   ///< no worker hangs
    bool ready = false;  ///< live, connected and takes tasks
  };
  Health health() const;

  struct Statistics
  {
    struct OfKind
    {
      bool served = false;
      uint64_t done = 0;
      uint64_t failed = 0;
      double service_s = 0.0;  ///< recent mean
    };
    std::array<OfKind, TASK_KINDS> of_kind;
    uint64_t probes = 0;
    uint64_t cancelled = 0;   ///< tasks
    uint64_t repeated = 0;    ///< tasks that came twice
    uint64_t malformed = 0;   ///< messages that are no request
    uint64_t unanswered = 0;  ///< replies for connections that had ended
    Admission::Totals admission;
    size_t connections = 0;
    size_t vehicles = 0;
    size_t queued = 0;
    size_t running = 0;
    int workers = 0;
    bool draining = false;
  };
  Statistics statistics() const;
  std::string metrics() const;  ///< for Prometheus, in text format 0.0.4: statistics, health, histograms of durations

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace pi_offload
