#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client/picture_encoder.h"
#include "engine/offload_engine.h"
#include "wire/event_thread.h"
#include "wire/nats_connection.h"
#include "wire/sp_socket.h"
#include "wire/wire_message.h"

namespace pi_offload
{

struct OffloadClientOptions
{
  std::string vehicle;  ///< name at the nodes, 1 to 64 bytes
  EngineOptions engine;
  PictureEncoder::Options encoder;
  SpRequester::Options link;  ///< without the address
  Transport transport = Transport::DIRECT;
  NatsOptions nats;                  ///< `servers` is not used: each node has its own
  std::string network = "accurate";  ///< NATS: that pictures are wanted from
  size_t max_connections = 4;        ///< to nodes in range, or that the vehicle reaches soon
  double unanswered_s = 1.0;         ///< without any answer for longer, the connection is renewed
  size_t max_encoding = 4;           ///< pictures that wait to be encoded; the vehicle does further ones
  bool use_runtime = false;          ///< encoding is a stage of pi_runtime::Runtime::shared(); false: plain calls

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Data of a task: a picture, which is encoded before it is sent, or bytes, which are sent unchanged.
struct TaskData
{
  PictureData picture;                 ///< of DETECTION; without pixels `bytes` is used
  std::shared_ptr<const void> keeper;  ///< keeps the picture's pixels
  Encoding encoding = Encoding::NONE;  ///< of `bytes`
  std::vector<uint8_t> bytes;
  std::string options;    ///< OffloadRequest::options
  double speech_s = 0.0;  ///< OffloadRequest::speech_s
};

/// The vehicle's side: runs the engine on the thread `offload_engine`, holds connections to the nodes in range and
/// ahead, and encodes pictures on the thread `offload_encode`.
///
/// A node may have another network for DETECTION than the vehicle: objects come with the names of their classes.
class OffloadClient
{
public:
  /// Called on the engine thread.
  struct Callbacks
  {
    /// Does the task on the vehicle, then calls the engine's onLocalDone() or onLocalFailed(), also from within.
    std::function<void(const Task& task)> run_local;
    /// The task has ended. @param reply  the node's answer; null if the result is the vehicle's or missing.
    std::function<void(const Outcome& outcome, const OffloadReply* reply)> deliver;
    std::function<void(bool error, const std::string& text)> log;
    /// When to call on_time [ns]; empty or INT64_MAX: never.
    std::function<int64_t()> next_time;
    EventThread::Function on_time;
  };

  /// @throws std::invalid_argument for options.
  OffloadClient(const OffloadClientOptions& options, Callbacks callbacks);
  ~OffloadClient();
  OffloadClient(const OffloadClient&) = delete;
  OffloadClient& operator=(const OffloadClient&) = delete;

  void start();
  /// No callback comes after this. Tasks under way do not end.
  void stop();

  /// Run functions on the engine thread, see EventThread. From any thread.
  void post(EventThread::Function function) { thread_.post(std::move(function)); }
  template <typename Callable>
  auto call(Callable&& callable)
  {
    return thread_.call(std::forward<Callable>(callable));
  }

  // On the engine thread, or before start():

  OffloadEngine& engine() { return engine_; }
  /// Adds a node, or changes the one with this id. @throws std::invalid_argument naming what is wrong.
  void setNode(const NodeDescription& node, int64_t now_ns);
  /// @return false if there is no such node.
  bool removeNode(const std::string& node, int64_t now_ns);
  /// Whether the classes of the vehicle's detector are known, to which those of nodes are matched. Until then DETECTION
  /// is not sent.
  void setClassesKnown(bool known);
  /// @return the decision. @throws std::invalid_argument as OffloadEngine::submit().
  Decision submit(uint64_t task, TaskKind kind, int64_t created_ns, double deadline_s, TaskData data, int64_t now_ns);
  /// The kill switch: while disabled, no task goes to a node and no answer is awaited.
  void setEnabled(bool enabled, int64_t now_ns);
  bool enabled() const { return enabled_; }
  /// @param eta  weight of time in [0, 1], else std::invalid_argument.
  void setEta(double eta);
  double eta() const;
  /// Bytes of the last task of the kind as sent; 0: there was none.
  size_t lastInputBytes(TaskKind kind) const { return last_bytes_[static_cast<size_t>(kind)]; }

  struct LinkStatus
  {
    bool up = false;
    std::string problem;   ///< why it is down
    std::string model;     ///< network of the node; empty: unknown
    uint64_t unasked = 0;  ///< replies to no open request of this vehicle, as replayed ones; they are ignored
  };
  std::map<std::string, LinkStatus> links() const;
  const PictureEncoder& encoder() const { return *encoder_; }
  /// How the stage offload_encode does. Any thread.
  std::string encoding() const;

private:
  struct Impl;

  OffloadEngine::Actions actions();
  EventThread::Callbacks events();

  const OffloadClientOptions options_;
  const Callbacks callbacks_;
  bool enabled_ = true;
  std::array<size_t, TASK_KINDS> last_bytes_{};
  const std::unique_ptr<PictureEncoder> encoder_;
  OffloadEngine engine_;
  std::unique_ptr<Impl> impl_;
  EventThread thread_;
};

}  // namespace pi_offload
