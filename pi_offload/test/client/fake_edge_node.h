#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "wire/sp_socket.h"
#include "wire/wire_message.h"

namespace pi_offload
{

/// A node that answers by script, in the test's process.
class FakeEdgeNode
{
public:
  enum class Behaviour
  {
    ANSWER,
    HOLD,    ///< tasks are answered by release()
    REFUSE,  ///< tasks are not taken
    FAIL,
    SILENT,  ///< nothing is answered, probes neither
  };

  FakeEdgeNode() { start(0); }
  ~FakeEdgeNode() { kill(); }
  FakeEdgeNode(const FakeEdgeNode&) = delete;
  FakeEdgeNode& operator=(const FakeEdgeNode&) = delete;

  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  uint16_t port() const { return port_; }

  /// All connections break, none can be made.
  void kill()
  {
    std::unique_ptr<SpReplier> ended;
    {
      const std::lock_guard<std::mutex> nobody_replies(replying_);
      const std::lock_guard<std::mutex> lock(mutex_);
      ended = std::move(replier_);
      held_.clear();
    }
  }
  /// At the same address again.
  void revive() { start(port_); }

  void set(Behaviour behaviour)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    behaviour_ = behaviour;
  }
  /// @param in_all  told in every reply, as EdgeServer does; else with detections only.
  void setModel(const std::string& model, bool in_all = true)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    model_ = model;
    tells_model_ = in_all;
  }
  void setObjects(const std::vector<DetectedObject>& objects)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    objects_ = objects;
  }
  void setSpeech(const std::string& text, float confidence, bool accepted)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    text_ = text;
    confidence_ = confidence;
    accepted_ = accepted;
  }

  /// Answers what is held, the oldest first.
  void release()
  {
    std::vector<std::pair<SpReplier::Peer, OffloadRequest>> held;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      held.swap(held_);
    }
    for (const auto& [peer, request] : held)
    {
      reply(peer, replyTo(request, OffloadReply::Status::OK));
    }
  }

  /// Sends an answer as if it were asked for. @param request  its number; @return false if nobody ever asked.
  bool answerUnasked(uint64_t request)
  {
    std::optional<std::pair<SpReplier::Peer, OffloadRequest>> last;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      last = last_task_;
    }
    if (last)
    {
      last->second.request = request;
      reply(last->first, replyTo(last->second, OffloadReply::Status::OK));
    }
    return last.has_value();
  }

  std::vector<OffloadRequest> requests(OffloadRequest::Type type) const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    std::vector<OffloadRequest> found;
    for (const OffloadRequest& request : requests_)
    {
      if (request.type == type)
      {
        found.push_back(request);
      }
    }
    return found;
  }
  size_t tasks() const { return requests(OffloadRequest::Type::TASK).size(); }
  bool waitFor(OffloadRequest::Type type, size_t count, double timeout_s = 30.0) const
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(timeout_s),
                             [&]
                             {
                               size_t found = 0;
                               for (const OffloadRequest& request : requests_)
                               {
                                 found += request.type == type ? 1 : 0;
                               }
                               return found >= count;
                             });
  }
  bool waitForTasks(size_t count) const { return waitFor(OffloadRequest::Type::TASK, count); }

private:
  void start(uint16_t port)
  {
    SpReplier::Options options;
    options.host = "127.0.0.1";
    options.port = port;
    SpReplier::Callbacks callbacks;
    callbacks.request = [this](const SpReplier::Peer& peer, std::vector<uint8_t> body, int64_t)
    { onRequest(peer, decodeRequest(body.data(), body.size())); };
    auto replier = std::make_unique<SpReplier>(options, std::move(callbacks));
    port_ = replier->port();
    std::lock_guard<std::mutex> lock(mutex_);
    replier_ = std::move(replier);
  }

  void onRequest(const SpReplier::Peer& peer, const OffloadRequest& request)
  {
    Behaviour behaviour = Behaviour::ANSWER;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      requests_.push_back(request);
      if (request.type == OffloadRequest::Type::TASK)
      {
        last_task_ = {peer, request};
      }
      behaviour = behaviour_;
      if (behaviour == Behaviour::HOLD && request.type == OffloadRequest::Type::TASK)
      {
        held_.emplace_back(peer, request);
      }
    }
    changed_.notify_all();
    if (behaviour == Behaviour::SILENT || request.type == OffloadRequest::Type::CANCEL)
    {
      return;
    }
    if (request.type == OffloadRequest::Type::PROBE || behaviour == Behaviour::ANSWER)
    {
      reply(peer, replyTo(request, OffloadReply::Status::OK));
    }
    else if (behaviour == Behaviour::REFUSE)
    {
      reply(peer, replyTo(request, OffloadReply::Status::REFUSED));
    }
    else if (behaviour == Behaviour::FAIL)
    {
      reply(peer, replyTo(request, OffloadReply::Status::FAILED));
    }
  }

  OffloadReply replyTo(const OffloadRequest& request, OffloadReply::Status status) const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    OffloadReply reply;
    reply.status = status;
    reply.type = request.type;
    reply.request = request.request;
    reply.kind = request.kind;
    for (NodeAdvertisement::OfKind& of_kind : reply.advertisement.of_kind)
    {
      of_kind.served = true;
      of_kind.service_s = 0.001;
      of_kind.lease_until_s = 60.0;
      of_kind.lease_rate_hz = 100.0;
    }
    reply.advertisement.capacity_gcycles = 100.0;
    if (tells_model_)
    {
      reply.model = model_;
    }
    if (status != OffloadReply::Status::OK)
    {
      reply.text = "as the script says";
    }
    else if (request.type == OffloadRequest::Type::TASK && request.kind == TaskKind::DETECTION)
    {
      reply.model = model_;
      reply.objects = objects_;
    }
    else if (request.type == OffloadRequest::Type::TASK)
    {
      reply.text = text_;
      reply.confidence = confidence_;
      reply.accepted = accepted_;
    }
    return reply;
  }

  void reply(const SpReplier::Peer& peer, const OffloadReply& reply)
  {
    std::lock_guard<std::mutex> lock(replying_);
    SpReplier* replier = nullptr;
    {
      std::lock_guard<std::mutex> inner(mutex_);
      replier = replier_.get();
    }
    if (replier != nullptr)
    {
      replier->reply(peer, encode(reply));
    }
  }

  mutable std::mutex mutex_;  ///< of all below
  mutable std::condition_variable changed_;
  std::mutex replying_;
  uint16_t port_ = 0;
  Behaviour behaviour_ = Behaviour::ANSWER;
  std::string model_ = "street";
  bool tells_model_ = true;
  std::string text_ = "stop";
  float confidence_ = 0.9F;
  bool accepted_ = true;
  std::vector<DetectedObject> objects_{{"car", 0.75F, 10.0F, 20.0F, 30.0F, 40.0F}};
  std::vector<OffloadRequest> requests_;
  std::optional<std::pair<SpReplier::Peer, OffloadRequest>> last_task_;
  std::vector<std::pair<SpReplier::Peer, OffloadRequest>> held_;
  std::unique_ptr<SpReplier> replier_;
};

}  // namespace pi_offload
