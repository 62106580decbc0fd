#pragma once

#include <gtest/gtest.h>
#include <pi_node/durations.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/offload_client.h"

namespace pi_offload
{

constexpr double TIMEOUT_S = 30.0;  ///< longest that a test waits for what must come

struct Ended
{
  Outcome outcome;
  std::optional<OffloadReply> reply;
};

/// A vehicle whose own detector and recogniser are done at once, or when the test says so.
class VehicleUnderTest
{
public:
  explicit VehicleUnderTest(OffloadClientOptions options = usual())
  {
    OffloadClient::Callbacks callbacks;
    callbacks.run_local = [this](const Task& task)
    {
      ++local_begun;
      if (hold_local)
      {
        return;
      }
      client->engine().onLocalDone(task.id, 0.1, pi_node::monotonicNs());
    };
    callbacks.deliver = [this](const Outcome& outcome, const OffloadReply* reply)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ended_[outcome.task.id].push_back(
          {outcome, reply != nullptr ? std::optional<OffloadReply>(*reply) : std::nullopt});
      changed_.notify_all();
    };
    callbacks.log = [this](bool, const std::string& text)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      logged_.push_back(text);
      changed_.notify_all();
    };
    client = std::make_unique<OffloadClient>(options, callbacks);
    client->setClassesKnown(true);
    client->start();
  }
  ~VehicleUnderTest() { client->stop(); }

  /// Loaded computers must not change what comes out.
  static OffloadClientOptions usual()
  {
    OffloadClientOptions options;
    options.vehicle = "van";
    options.engine.advertisement_valid_s = 60.0;
    options.engine.probe_period_s = 0.05;
    options.engine.probe_period_far_s = 0.05;
    options.link.reconnect_s = 0.02;
    options.link.max_reconnect_s = 0.05;
    options.unanswered_s = 60.0;
    return options;
  }

  /// Everywhere in range. @param node  has an address.
  template <typename Node>
  auto add(const std::string& id, const Node& node) -> decltype(node.address(), void())
  {
    add(id, node.address());
  }
  void add(const std::string& id, const std::string& address)
  {
    NodeDescription description;
    description.id = id;
    description.address = address;
    description.range_m = std::numeric_limits<double>::infinity();
    client->call([&](int64_t now_ns) { client->setNode(description, now_ns); });
  }
  /// Until the engine would use the node.
  bool waitUntilUsed(const std::string& id, TaskKind kind = TaskKind::DETECTION)
  {
    return until(
        [&]
        {
          return client->call(
              [&](int64_t now_ns)
              {
                const Decision decision = client->engine().decide(kind, 2000, 20.0, now_ns);
                return decision.node >= 0 &&
                       client->engine().nodes(now_ns).at(static_cast<size_t>(decision.node)).description.id == id;
              });
        });
  }
  bool waitUntilLink(const std::string& id, bool up)
  {
    return until([&] { return client->call([&](int64_t) { return client->links()[id].up == up; }); });
  }
  template <typename Condition>
  bool until(const Condition& condition)
  {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(TIMEOUT_S);
    std::unique_lock<std::mutex> lock(mutex_);
    while (std::chrono::steady_clock::now() < end)
    {
      lock.unlock();
      const bool holds = condition();
      lock.lock();
      if (holds)
      {
        return true;
      }
      changed_.wait_for(lock, std::chrono::milliseconds(10));
    }
    return false;
  }

  uint64_t show(double deadline_s = 20.0)
  {
    static const std::vector<uint8_t> PIXELS(64 * 48, 50);
    TaskData data;
    data.picture = {PIXELS.data(), 64, 48, 64, Encoding::MONO8};
    return submit(TaskKind::DETECTION, deadline_s, std::move(data));
  }
  uint64_t say(double deadline_s = 20.0)
  {
    TaskData data;
    data.encoding = Encoding::S16LE;
    data.bytes = {1, 2, 3, 4};
    data.options = "stop\ngo";
    return submit(TaskKind::SPEECH, deadline_s, std::move(data));
  }
  uint64_t submit(TaskKind kind, double deadline_s, TaskData data)
  {
    const uint64_t id = ++last_;
    client->call([&](int64_t now_ns) { client->submit(id, kind, now_ns, deadline_s, std::move(data), now_ns); });
    return id;
  }
  /// The one end of a task.
  Ended end(uint64_t task)
  {
    const bool came = until([&] { return ends(task) > 0; });
    EXPECT_TRUE(came) << "task " << task << " did not end";
    std::lock_guard<std::mutex> lock(mutex_);
    return came ? ended_[task].front() : Ended();
  }
  size_t ends(uint64_t task)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return ended_[task].size();
  }
  bool waitForLog(const std::string& part)
  {
    return until(
        [&]
        {
          std::lock_guard<std::mutex> lock(mutex_);
          for (const std::string& text : logged_)
          {
            if (text.find(part) != std::string::npos)
            {
              return true;
            }
          }
          return false;
        });
  }
  void localDone(uint64_t task)
  {
    client->call([&](int64_t now_ns) { client->engine().onLocalDone(task, 0.1, now_ns); });
  }

  std::unique_ptr<OffloadClient> client;
  bool hold_local = false;  ///< set before tasks are submitted
  std::atomic<int> local_begun{0};

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<uint64_t, std::vector<Ended>> ended_;
  std::vector<std::string> logged_;
  uint64_t last_ = 0;
};

}  // namespace pi_offload
