#pragma once

#include <pi_runtime/stage.h>

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/offload_client.h"
#include "wire/nats_socket.h"

namespace pi_offload
{

/// Holds the connections and translates between the engine and the messages of the nodes. On the engine
/// thread.
struct OffloadClient::Impl
{
  /// A request that is sent or waits for its picture.
  struct Request
  {
    std::string node;
    std::optional<uint64_t> task;  ///< none: a probe
    TaskKind kind = TaskKind::DETECTION;
    int64_t begun_ns = 0;     ///< when the engine asked for it
    double deadline_s = 0.0;  ///< after the task was created: when the answer is useless
    int64_t sent_ns = 0;      ///< 0: not yet
    size_t bytes = 0;
  };
  struct TaskState
  {
    Task task;
    std::shared_ptr<const TaskData> data;
    Encoding encoding = Encoding::NONE;
    std::shared_ptr<const std::vector<uint8_t>> payload;  ///< null: not encoded yet
  };
  struct NodeState
  {
    LinkStatus status;
    std::string told;        ///< problem logged last
    NodeEstimates transfer;  ///< of the link, without encoding

    std::string address;
    uint64_t connection = 0;               ///< its number; events of a replaced one are ignored
    int64_t unanswered_since_ns = 0;       ///< 0: no request is unanswered
    std::unique_ptr<Requester> requester;  ///< null: not in range
  };

  explicit Impl(OffloadClient* client)
    : client(*client)
    , eta(client->options_.engine.eta)
    , encode_stage(client->options_.use_runtime ? pi_runtime::Runtime::shared(pi_runtime::RuntimeOptions::forService())
                                                : nullptr,
                   {"offload_encode"})
    , encode_thread("offload_encode", EventThread::Callbacks())
  {
  }

  /// Sets the address; a connection to another one ends.
  void setAddress(const std::string& node, const std::string& address);
  /// Connects to nodes in range, then to those that come in range next; ends other connections.
  void chooseLinks(int64_t now_ns);
  void connect(const std::string& node, NodeState& state);
  std::unique_ptr<Requester> makeRequester(const std::string& address, Requester::Callbacks callbacks) const;
  /// @return false if it is not connected or too much waits; then nothing is sent.
  bool send(const std::string& node, const OffloadRequest& request, int64_t now_ns);

  // Actions of the engine.
  bool sendTask(const std::string& node, uint64_t number, const Task& task);
  bool sendProbe(const std::string& node, uint64_t number);
  void cancel(const std::string& node, uint64_t number);
  void deliver(const Outcome& outcome);

  // Events.
  void onEncoded(uint64_t number, Encoding encoding, std::vector<uint8_t> bytes, const std::string& problem);
  void onReply(const std::string& node, const OffloadReply& reply, int64_t received_ns);
  /// Nobody works at the node, or at any other that its site can reach.
  void onUnserved(const std::string& node, uint32_t id, int64_t received_ns);
  void onLink(const std::string& node, NodeState& state, bool up, const std::string& reason);

  bool encode(uint64_t number, const std::shared_ptr<const TaskData>& data, Encoding encoding);
  bool transmit(uint64_t number, const TaskState& state);
  PictureEncoder::Situation situation(const std::string& node, const Task& task, int64_t now_ns) const;
  OffloadRequest requestFor(const std::string& node, OffloadRequest::Type type, uint64_t number, int64_t now_ns) const;
  /// The node's advertisement, without DETECTION if its network differs from the vehicle's.
  NodeAdvertisement corrected(const std::string& node, const OffloadReply& reply);
  void forgetOld(int64_t now_ns);

  OffloadClient& client;
  bool classes_known = false;
  double eta;
  std::map<std::string, NodeState> nodes;
  uint64_t last_connection = 0;
  int64_t choose_links_ns = 0;  ///< when to do it next
  std::map<uint64_t, Request> requests;
  std::map<uint64_t, TaskState> tasks;
  const OffloadReply* result = nullptr;  ///< being handed to the engine
  uint64_t result_task = 0;
  std::atomic<size_t> pictures_waiting{0};
  pi_runtime::Stage encode_stage;
  EventThread encode_thread;
};

}  // namespace pi_offload
