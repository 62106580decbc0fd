#pragma once

#include "client/offload_client.h"

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/encode_thread.h"
#include "client/node_links.h"

namespace pi_offload
{

/// What the engine asks for becomes messages, and messages become what the engine is told. On the engine thread.
struct OffloadClient::Impl
{
  /// Sent, or about to be.
  struct Request
  {
    std::string node;
    std::optional<uint64_t> task;  ///< none: a probe
    TaskKind kind = TaskKind::DETECTION;
    int64_t begun_ns = 0;     ///< when the engine asked for it
    double deadline_s = 0.0;  ///< after the task was made: when the answer is wanted
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
    std::string told;          ///< problem that was logged last
    std::string warned_model;  ///< of the node, about which there was a warning
    NodeEstimates transfer;    ///< of the link alone: without the time that encoding takes
  };

  explicit Impl(OffloadClient* client)
    : client(*client), encode(client->options_.max_encoding, *client->encoder_), links(linkOptions(), linkCallbacks())
  {
    eta = client->options_.engine.eta;
  }

  NodeLinks::Options linkOptions() const { return {client.options_.link, client.options_.unanswered_s}; }
  NodeLinks::Callbacks linkCallbacks();

  // Actions of the engine.
  bool sendTask(const std::string& node, uint64_t number, const Task& task);
  bool sendProbe(const std::string& node, uint64_t number);
  void cancel(const std::string& node, uint64_t number);
  void deliver(const Outcome& outcome);

  // Events.
  void onEncoded(uint64_t number, Encoding encoding, std::vector<uint8_t> bytes, const std::string& problem);
  void onReply(const std::string& node, const OffloadReply& reply, int64_t received_ns);
  void onLink(const std::string& node, bool up, const std::string& reason);

  bool transmit(uint64_t number, const TaskState& state);
  PictureEncoder::Situation situation(const std::string& node, const Task& task, int64_t now_ns) const;
  OffloadRequest requestFor(const std::string& node, OffloadRequest::Type type, uint64_t number, int64_t now_ns) const;
  /// The node's words with what the vehicle knows better: whether its network is the vehicle's.
  NodeAdvertisement corrected(const std::string& node, const OffloadReply& reply);
  void forgetOld(int64_t now_ns);

  OffloadClient& client;
  std::string model;
  double eta = 0.5;
  std::map<std::string, NodeState> nodes;
  std::map<uint64_t, Request> requests;
  std::map<uint64_t, TaskState> tasks;
  const OffloadReply* result = nullptr;  ///< of the node whose answer is being told to the engine
  uint64_t result_task = 0;
  EncodeThread encode;
  NodeLinks links;
};

}  // namespace pi_offload
