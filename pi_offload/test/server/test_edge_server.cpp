#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <future>
#include <map>
#include <random>
#include <thread>

#include "server/edge_server.h"
#include "wire/one_way_delay.h"
#include "wire/raw_socket.h"

using namespace pi_offload;

namespace
{

using Bytes = std::vector<uint8_t>;

int64_t nowNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// A door that tasks wait at, until the test lets them through.
class Gate
{
public:
  void pass()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    ++waiting_;
    changed_.notify_all();
    changed_.wait(lock, [&] { return open_ || permits_ > 0; });
    permits_ -= open_ ? 0 : 1;
    --waiting_;
  }
  void awaitWaiting(int count)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!changed_.wait_for(lock, std::chrono::duration<double>(PATIENCE_S), [&] { return waiting_ >= count; }))
    {
      throw std::runtime_error("nobody came to the gate");
    }
  }
  void let(int count)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    permits_ += count;
    changed_.notify_all();
  }
  void open()
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int waiting_ = 0;
  int permits_ = 0;
  bool open_ = false;
};

EdgeServerOptions someOptions(int workers = 1)
{
  EdgeServerOptions options;
  options.replier.host = "127.0.0.1";
  options.admission.workers = workers;
  options.has_position = true;
  options.position = {10.0, -20.0};
  options.range_m = 80.0;
  return options;
}

/// Says back what it got.
ExecutorFactory echo()
{
  return []
  {
    return [](const OffloadRequest& request, double*)
    {
      OffloadReply reply;
      reply.text.assign(request.payload.begin(), request.payload.end());
      reply.accepted = true;
      return reply;
    };
  };
}

ExecutorFactory gated(Gate* gate)
{
  return [gate]
  {
    return [gate](const OffloadRequest& request, double*)
    {
      gate->pass();
      OffloadReply reply;
      reply.text.assign(request.payload.begin(), request.payload.end());
      return reply;
    };
  };
}

struct Vehicle
{
  explicit Vehicle(uint16_t port, std::string name = "car") : name(std::move(name))
  {
    SpRequester::Options options;
    options.address = "127.0.0.1:" + std::to_string(port);
    options.reconnect_s = 0.01;
    SpRequester::Callbacks callbacks;
    callbacks.reply = [this](uint32_t id, const Bytes& body, int64_t)
    {
      const OffloadReply reply = decodeReply(body.data(), body.size());
      EXPECT_EQ(reply.request, id);
      replies.put(reply);
    };
    callbacks.link = [this](bool up, const std::string&) { links.put(up); };
    requester = std::make_unique<SpRequester>(options, callbacks);
    waitUntilUp();
  }
  void waitUntilUp()
  {
    while (!links.take())
    {
    }
  }
  OffloadRequest request(OffloadRequest::Type type, uint32_t id) const
  {
    OffloadRequest request;
    request.type = type;
    request.request = id;
    request.vehicle = name;
    request.sent_ns = nowNs();
    request.remaining_s = 100.0;
    return request;
  }
  void send(const OffloadRequest& request) const
  {
    ASSERT_TRUE(requester->send(static_cast<uint32_t>(request.request), encode(request)));
  }
  void task(uint32_t id, const std::string& payload = "x", double remaining_s = 100.0,
            TaskKind kind = TaskKind::DETECTION) const
  {
    OffloadRequest task = request(OffloadRequest::Type::TASK, id);
    task.payload.assign(payload.begin(), payload.end());
    task.remaining_s = remaining_s;
    task.kind = kind;
    send(task);
  }
  OffloadReply probe(uint32_t id)
  {
    send(request(OffloadRequest::Type::PROBE, id));
    return replies.take();
  }
  std::string name;
  Inbox<OffloadReply> replies;
  Inbox<bool> links;
  std::unique_ptr<SpRequester> requester;
};

/// Waits until the statistics are so: they have no event of their own.
bool becomes(const EdgeServer& server, const std::function<bool(const EdgeServer::Statistics&)>& condition)
{
  const int64_t end_ns = nowNs() + static_cast<int64_t>(PATIENCE_S * 1e9);
  while (nowNs() < end_ns)
  {
    if (condition(server.statistics()))
    {
      return true;
    }
    std::this_thread::yield();
  }
  return false;
}

}  // namespace

TEST(OneWayDelay, CountsWhatIsAboveTheFastestOne)
{
  constexpr int64_t MS = 1000000;
  OneWayDelay delay;
  const int64_t offset = -123456789 * MS;  // between the clocks
  EXPECT_EQ(delay.excess(offset, 5 * MS), 0.0);
  EXPECT_NEAR(delay.excess(offset + 100 * MS, 135 * MS), 0.030, 1e-6);
  EXPECT_NEAR(delay.excess(offset + 200 * MS, 202 * MS), 0.0, 1e-6);  // a faster one
  EXPECT_NEAR(delay.excess(offset + 300 * MS, 305 * MS), 0.003, 1e-6);
  // The vehicle's clock is slow by 1 ms per second: an hour later that is not taken for a delay.
  double largest = 0.0;
  for (int64_t second = 1; second < 3600; ++second)
  {
    const int64_t received = second * 1000 * MS;
    largest = std::max(largest, delay.excess(offset + received - second * MS, received));
  }
  EXPECT_LT(largest, 0.07);
  EXPECT_GE(delay.excess(INT64_MIN, INT64_MAX), 0.0);
  EXPECT_GE(delay.excess(INT64_MAX, INT64_MAX), 0.0);
}

TEST(EdgeServer, SaysWhatIsWrongWithItsOptions)
{
  EdgeServerOptions options = someOptions();
  EXPECT_THROW(EdgeServer(options, {}), std::invalid_argument);
  options.max_task_s = 0.0;
  try
  {
    EdgeServer server(options, {echo(), nullptr});
    FAIL() << "it takes anything";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ(error.what(), "server/max_task_s = 0, must be in [0.1, 86400]");
  }
  options = someOptions(2);
  std::atomic<int> made{0};
  const ExecutorFactory failing = [&]() -> Executor
  {
    if (++made == 2)
    {
      throw std::runtime_error("no such model");
    }
    return echo()();
  };
  try
  {
    EdgeServer server(options, {nullptr, failing});
    FAIL() << "it starts without its executor";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_EQ(std::string(error.what()), std::string(toString(TaskKind::SPEECH)) + ", worker 1: no such model");
  }
}

TEST(EdgeServer, TellsItsNetworkBeforeTheFirstPicture)
{
  EdgeServerOptions options = someOptions();
  options.model = "street";
  const ExecutorFactory other = []
  {
    return [](const OffloadRequest&, double*)
    {
      OffloadReply reply;
      reply.model = "coco";
      return reply;
    };
  };
  EdgeServer server(options, {echo(), other});
  Vehicle vehicle(server.port());
  EXPECT_EQ(vehicle.probe(1).model, "street");
  vehicle.task(2);
  EXPECT_EQ(vehicle.replies.take().model, "street");
  vehicle.task(3, "x", 100.0, TaskKind::SPEECH);
  EXPECT_EQ(vehicle.replies.take().model, "coco") << "what the executor says counts";
  vehicle.task(4, "x", 0.0);
  const OffloadReply refused = vehicle.replies.take();
  EXPECT_EQ(refused.status, OffloadReply::Status::REFUSED);
  EXPECT_EQ(refused.model, "street");
}

TEST(EdgeServer, AnswersProbesWithWhatItIs)
{
  EdgeServer server(someOptions(), {echo(), nullptr});
  Vehicle vehicle(server.port());
  OffloadRequest probe = vehicle.request(OffloadRequest::Type::PROBE, 3);
  probe.lease_rate_hz[0] = 4.0;
  vehicle.send(probe);
  const OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::OK);
  EXPECT_EQ(reply.type, OffloadRequest::Type::PROBE);
  const NodeAdvertisement& node = reply.advertisement;
  EXPECT_TRUE(node.has_position);
  EXPECT_EQ(node.position.x, 10.0);
  EXPECT_EQ(node.position.y, -20.0);
  EXPECT_EQ(node.range_m, 80.0);
  EXPECT_TRUE(node.of_kind[0].served);
  EXPECT_FALSE(node.of_kind[1].served);
  EXPECT_EQ(node.of_kind[0].lease_rate_hz, 4.0);
  EXPECT_GT(node.of_kind[0].lease_until_s, 0.0);
  EXPECT_GT(node.capacity_gcycles, 0.0);
  EXPECT_FALSE(node.draining);
  EXPECT_EQ(server.statistics().probes, 1U);
}

TEST(EdgeServer, DoesTasksOfBothKinds)
{
  EdgeServer server(someOptions(2), {echo(), echo()});
  Vehicle vehicle(server.port());
  vehicle.task(1, "picture");
  OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::OK);
  EXPECT_EQ(reply.type, OffloadRequest::Type::TASK);
  EXPECT_EQ(reply.kind, TaskKind::DETECTION);
  EXPECT_EQ(reply.text, "picture");
  EXPECT_TRUE(reply.accepted);
  EXPECT_GE(reply.queue_s, 0.0);
  EXPECT_GE(reply.service_s, 0.0);
  EXPECT_TRUE(reply.advertisement.of_kind[1].served);
  vehicle.task(2, "sound", 100.0, TaskKind::SPEECH);
  reply = vehicle.replies.take();
  EXPECT_EQ(reply.kind, TaskKind::SPEECH);
  EXPECT_EQ(reply.text, "sound");
  EXPECT_EQ(server.statistics().of_kind[0].done, 1U);
  EXPECT_EQ(server.statistics().of_kind[1].done, 1U);
}

TEST(EdgeServer, EachWorkerHasAnExecutorOfItsOwn)
{
  std::atomic<int> made{0};
  std::atomic<bool> shared{false};
  Gate gate;
  const ExecutorFactory factory = [&]
  {
    ++made;
    auto busy = std::make_shared<std::atomic<bool>>(false);
    return [&, busy](const OffloadRequest&, double*)
    {
      shared = busy->exchange(true) || shared;
      gate.pass();
      *busy = false;
      return OffloadReply();
    };
  };
  EdgeServer server(someOptions(3), {factory, nullptr});
  EXPECT_EQ(made, 3);
  Vehicle vehicle(server.port());
  for (uint32_t id = 0; id < 3; ++id)
  {
    vehicle.task(id);
  }
  gate.awaitWaiting(3);
  EXPECT_EQ(server.statistics().running, 3U);
  gate.open();
  for (uint32_t id = 3; id < 8; ++id)
  {
    vehicle.task(id);
  }
  for (int count = 0; count < 8; ++count)
  {
    EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  }
  EXPECT_FALSE(shared);
}

TEST(EdgeServer, RefusesAtOnceAndSaysWhy)
{
  Gate gate;
  EdgeServerOptions options = someOptions();
  options.admission.max_queued_per_vehicle = 2;
  options.max_payload_bytes = 1U << 20U;
  EdgeServer server(options, {gated(&gate), nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1, "x", 100.0, TaskKind::SPEECH);
  OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::REFUSED);
  EXPECT_EQ(reply.text, "not served");
  vehicle.task(2, "x", -0.5);
  EXPECT_EQ(vehicle.replies.take().text, "too late");
  vehicle.task(3, std::string((1U << 20U) + 1, 'x'));
  EXPECT_EQ(vehicle.replies.take().text, "no memory: tasks of 0 bytes are being done, at most 1048576 are taken");
  vehicle.task(10);
  gate.awaitWaiting(1);
  vehicle.task(11);
  vehicle.task(12);
  vehicle.task(13);
  reply = vehicle.replies.take();
  EXPECT_EQ(reply.request, 13U);
  EXPECT_EQ(reply.text, "queue full");
  EXPECT_GT(reply.advertisement.of_kind[0].queue_s, 0.0);
  gate.open();
  for (int count = 0; count < 3; ++count)
  {
    EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  }
}

TEST(EdgeServer, TasksWhoseTimeIsOverAreNotDone)
{
  Gate gate;
  EdgeServer server(someOptions(), {gated(&gate), nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1);
  gate.awaitWaiting(1);
  vehicle.task(2, "x", 0.5);
  vehicle.task(3);
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.queued + s.admission.expired == 2; }));
  // That time has to pass.
  const int64_t over_ns = nowNs() + 500000000;
  for (uint32_t id = 100; nowNs() < over_ns; ++id)
  {
    vehicle.probe(id);
  }
  gate.let(2);
  std::map<uint64_t, OffloadReply::Status> status;
  for (int count = 0; count < 3; ++count)
  {
    const OffloadReply reply = vehicle.replies.take();
    status[reply.request] = reply.status;
  }
  EXPECT_EQ(status[1], OffloadReply::Status::OK);
  EXPECT_EQ(status[2], OffloadReply::Status::EXPIRED);
  EXPECT_EQ(status[3], OffloadReply::Status::OK);
  EXPECT_EQ(server.statistics().of_kind[0].done, 2U);
}

TEST(EdgeServer, WhatTheWayTookCountsAsPassed)
{
  EdgeServer server(someOptions(), {echo(), nullptr});
  Vehicle vehicle(server.port());
  vehicle.probe(1);
  OffloadRequest late = vehicle.request(OffloadRequest::Type::TASK, 2);
  late.payload = {'x'};
  late.remaining_s = 5.0;
  late.sent_ns -= 10000000000;  // 10 s on its way
  vehicle.send(late);
  const OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::REFUSED);
  EXPECT_EQ(reply.text, "too late");
}

TEST(EdgeServer, CancelledTasksAreNotDoneAndNotAnswered)
{
  Gate gate;
  EdgeServer server(someOptions(), {gated(&gate), nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1);
  gate.awaitWaiting(1);
  vehicle.task(2);
  const auto cancel = [&](uint32_t id)
  {
    vehicle.send(vehicle.request(OffloadRequest::Type::CANCEL, id));
    return vehicle.replies.take();
  };
  OffloadReply reply = cancel(2);
  EXPECT_EQ(reply.type, OffloadRequest::Type::CANCEL);
  EXPECT_EQ(reply.status, OffloadReply::Status::OK);
  EXPECT_EQ(reply.text, "cancelled");
  EXPECT_EQ(cancel(1).text, "it runs: its result is thrown away");
  EXPECT_EQ(cancel(77).text, "not known");
  gate.open();
  vehicle.task(3);
  reply = vehicle.replies.take();
  EXPECT_EQ(reply.request, 3U);
  EXPECT_EQ(server.statistics().of_kind[0].done, 2U);
  EXPECT_EQ(server.statistics().cancelled, 2U);
}

TEST(EdgeServer, ARepeatedTaskIsDoneOnce)
{
  Gate gate;
  EdgeServer server(someOptions(), {gated(&gate), nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1);
  gate.awaitWaiting(1);
  vehicle.task(1);
  vehicle.task(2);
  vehicle.task(2);
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.repeated == 2; }));
  gate.open();
  EXPECT_EQ(vehicle.replies.take().request, 1U);
  EXPECT_EQ(vehicle.replies.take().request, 2U);
  vehicle.probe(3);
  EXPECT_EQ(vehicle.replies.size(), 0U);
  EXPECT_EQ(server.statistics().of_kind[0].done, 2U);
}

TEST(EdgeServer, AFailingExecutorIsAnAnswer)
{
  const ExecutorFactory failing = []
  {
    return [](const OffloadRequest& request, double*) -> OffloadReply
    {
      OffloadReply reply;
      switch (request.payload.at(0))
      {
        case 'e':
          throw std::runtime_error("the picture is damaged");
        case 'o':
          throw 5;
        case 'n':
          reply.confidence = std::numeric_limits<float>::quiet_NaN();
          break;
        case 'l':
          throw std::runtime_error(std::string(100000, 'l'));
        default:
          break;
      }
      return reply;
    };
  };
  Inbox<std::string> events;
  EdgeServer::Callbacks callbacks;
  callbacks.event = [&](const std::string& text) { events.put(text); };
  EdgeServer server(someOptions(), {failing, nullptr}, callbacks);
  Vehicle vehicle(server.port());
  vehicle.task(1, "e");
  OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::FAILED);
  EXPECT_EQ(reply.text, "the picture is damaged");
  EXPECT_EQ(events.take(), std::string(toString(TaskKind::DETECTION)) + " for car failed: the picture is damaged");
  vehicle.task(2, "o");
  EXPECT_EQ(vehicle.replies.take().text, "the task failed without saying why");
  vehicle.task(3, "n");
  EXPECT_EQ(vehicle.replies.take().text, "reply/confidence: must be finite");
  vehicle.task(4, "l");
  EXPECT_EQ(vehicle.replies.take().text.size(), 4096U);
  vehicle.task(5, "x");
  EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  EXPECT_EQ(server.statistics().of_kind[0].failed, 4U);
  EXPECT_EQ(server.statistics().of_kind[0].done, 1U);
}

TEST(EdgeServer, AnExecutorMayTellItsServiceTime)
{
  const ExecutorFactory timed = []
  {
    return [](const OffloadRequest&, double* service_s)
    {
      *service_s = 0.125;
      return OffloadReply();
    };
  };
  EdgeServer server(someOptions(), {timed, nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1);
  const OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.service_s, 0.125);
  EXPECT_EQ(reply.advertisement.of_kind[0].service_s, 0.125);
}

TEST(EdgeServer, AConnectionThatEndsTakesItsTasksAndLeasesWithIt)
{
  Gate gate;
  EdgeServerOptions options = someOptions();
  EdgeServer server(options, {gated(&gate), nullptr});
  {
    Vehicle vehicle(server.port());
    OffloadRequest probe = vehicle.request(OffloadRequest::Type::PROBE, 1);
    probe.lease_rate_hz[0] = 15.0;  // of 18
    vehicle.send(probe);
    EXPECT_EQ(vehicle.replies.take().advertisement.of_kind[0].lease_rate_hz, 15.0);
    vehicle.task(2);
    gate.awaitWaiting(1);
    vehicle.task(3);
    vehicle.task(4);
    ASSERT_TRUE(becomes(server, [](const auto& s) { return s.queued == 2; }));
  }
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.queued == 0 && s.vehicles == 0 && s.connections == 0; }));
  Vehicle other(server.port(), "other");
  OffloadRequest probe = other.request(OffloadRequest::Type::PROBE, 1);
  probe.lease_rate_hz[0] = 15.0;
  other.send(probe);
  EXPECT_EQ(other.replies.take().advertisement.of_kind[0].lease_rate_hz, 15.0);
  gate.open();
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.unanswered == 1; }));
}

TEST(EdgeServer, AVehicleWithAnotherConnectionIsNotForgotten)
{
  EdgeServer server(someOptions(), {echo(), nullptr});
  auto old = std::make_unique<Vehicle>(server.port());
  old->probe(1);
  Vehicle fresh(server.port());
  OffloadRequest probe = fresh.request(OffloadRequest::Type::PROBE, 1);
  probe.lease_rate_hz[0] = 5.0;
  fresh.send(probe);
  fresh.replies.take();
  old.reset();
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.connections == 1; }));
  EXPECT_EQ(server.statistics().vehicles, 1U);
}

TEST(EdgeServer, DrainsWithoutLosingATask)
{
  Gate gate;
  EdgeServer server(someOptions(), {gated(&gate), nullptr});
  EXPECT_TRUE(server.health().ready);
  Vehicle vehicle(server.port());
  vehicle.task(1);
  gate.awaitWaiting(1);
  vehicle.task(2);
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.queued == 1; }));
  EXPECT_FALSE(server.drain(0.0));
  EXPECT_FALSE(server.health().ready);
  EXPECT_TRUE(server.health().live);
  vehicle.task(3);
  OffloadReply reply = vehicle.replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::REFUSED);
  EXPECT_EQ(reply.text, "draining");
  EXPECT_TRUE(reply.advertisement.draining);
  gate.open();
  EXPECT_TRUE(server.drain(PATIENCE_S));
  EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  EXPECT_TRUE(server.statistics().draining);
}

TEST(EdgeServer, EndsWhileVehiclesAskItMore)
{
  for (int round = 0; round < 30; ++round)
  {
    auto server = std::make_unique<EdgeServer>(someOptions(), std::array<ExecutorFactory, TASK_KINDS>{echo(), nullptr});
    Vehicle vehicle(server->port());
    const Bytes probe = encode(vehicle.request(OffloadRequest::Type::PROBE, 1));
    std::atomic<bool> asks{true};
    std::thread asking(
        [&]
        {
          while (asks)
          {
            vehicle.requester->send(1, probe);
          }
        });
    vehicle.replies.take();
    server.reset();
    asks = false;
    asking.join();
  }
}

TEST(EdgeServer, AWorkerThatHangsMakesItNotLive)
{
  Gate gate;
  EdgeServerOptions options = someOptions();
  options.max_task_s = 0.1;
  EdgeServer server(options, {gated(&gate), nullptr});
  EXPECT_TRUE(server.health().live);
  Vehicle vehicle(server.port());
  vehicle.task(1);
  gate.awaitWaiting(1);
  const int64_t end_ns = nowNs() + static_cast<int64_t>(PATIENCE_S * 1e9);
  while (server.health().live && nowNs() < end_ns)
  {
    std::this_thread::yield();
  }
  EXPECT_FALSE(server.health().live);
  EXPECT_FALSE(server.health().ready);
  gate.open();
  vehicle.replies.take();
  ASSERT_TRUE(becomes(server, [](const auto& s) { return s.running == 0; }));
  EXPECT_TRUE(server.health().ready);
}

TEST(EdgeServer, WhatIsNoRequestEndsTheConnection)
{
  Inbox<std::string> events;
  EdgeServer::Callbacks callbacks;
  callbacks.event = [&](const std::string& text) { events.put(text); };
  EdgeServer server(someOptions(), {echo(), nullptr}, callbacks);
  Vehicle vehicle(server.port());
  ASSERT_TRUE(vehicle.requester->send(1, Bytes{1, 2, 3}));
  EXPECT_NE(events.take().find("request: no message of this kind (3 bytes)"), std::string::npos);
  EXPECT_FALSE(vehicle.links.take());
  vehicle.waitUntilUp();
  vehicle.task(2);
  EXPECT_EQ(vehicle.replies.take().status, OffloadReply::Status::OK);
  EXPECT_EQ(server.statistics().malformed, 1U);
}

TEST(EdgeServer, RandomRequestsNeverEndIt)
{
  EdgeServer server(someOptions(2), {echo(), echo()});
  std::mt19937 random(17);
  OffloadRequest good;
  good.type = OffloadRequest::Type::TASK;
  good.vehicle = "car";
  good.remaining_s = 1.0;
  good.options = "go";
  good.payload = {1, 2, 3};
  const Bytes bytes = encode(good);
  const auto frame = [](const Bytes& body)
  {
    Bytes all{0,    0, 0, 0, 0, 0, static_cast<uint8_t>((body.size() + 4) >> 8U), static_cast<uint8_t>(body.size() + 4),
              0x80, 0, 0, 1};
    all.insert(all.end(), body.begin(), body.end());
    return all;
  };
  for (int round = 0; round < 500; ++round)
  {
    RawSocket socket = RawSocket::connectTo(server.port());
    bool alive = socket.write(Bytes{0, 'S', 'P', 0, 0, 48, 0, 0});
    for (unsigned count = random() % 10; count > 0 && alive; --count)
    {
      Bytes changed = bytes;
      for (unsigned changes = random() % 3; changes > 0; --changes)
      {
        changed[random() % changed.size()] = static_cast<uint8_t>(random());
      }
      alive = socket.write(frame(changed));
    }
  }
  Vehicle vehicle(server.port(), "sane");
  EXPECT_EQ(vehicle.probe(1).status, OffloadReply::Status::OK);
  EXPECT_TRUE(becomes(
      server, [](const auto& s) { return s.connections == 1 && s.queued == 0 && s.running == 0 && s.vehicles == 1; }));
  EXPECT_GT(server.statistics().malformed, 10U);
  // How many come through depends on how fast connections end; some do.
  EXPECT_GT(server.statistics().admission.taken + server.statistics().admission.refused, 0U);
}

TEST(EdgeServer, FiftyVehiclesShareItAndEachTaskIsAnsweredOnce)
{
  // Each vehicle has one task under way in each round.
  EdgeServerOptions options = someOptions(2);
  options.admission.max_queued = 64;
  const ExecutorFactory quick = []
  {
    return [](const OffloadRequest&, double* service_s)
    {
      *service_s = 0.001;
      return OffloadReply();
    };
  };
  EdgeServer server(options, {quick, nullptr});
  std::vector<std::unique_ptr<Vehicle>> vehicles;
  for (int count = 0; count < 50; ++count)
  {
    vehicles.push_back(std::make_unique<Vehicle>(server.port(), "car" + std::to_string(count)));
  }
  constexpr uint32_t ROUNDS = 20;
  for (uint32_t round = 0; round < ROUNDS; ++round)
  {
    for (const auto& vehicle : vehicles)
    {
      vehicle->task(round);
    }
    for (const auto& vehicle : vehicles)
    {
      const OffloadReply reply = vehicle->replies.take();
      EXPECT_EQ(reply.request, round);
      EXPECT_EQ(reply.status, OffloadReply::Status::OK) << reply.text;
    }
  }
  for (const auto& vehicle : vehicles)
  {
    EXPECT_EQ(vehicle->replies.size(), 0U);
  }
  EXPECT_EQ(server.statistics().of_kind[0].done, 50U * ROUNDS);
  EXPECT_EQ(server.statistics().vehicles, 50U);
}

TEST(EdgeServer, MetricsAreAsPrometheusReadsThem)
{
  EdgeServer server(someOptions(), {echo(), nullptr});
  Vehicle vehicle(server.port());
  vehicle.task(1);
  vehicle.replies.take();
  const std::string text = server.metrics();
  const std::string kind = toString(TaskKind::DETECTION);
  EXPECT_NE(
      text.find("# TYPE pi_offload_tasks_done_total counter\npi_offload_tasks_done_total{kind=\"" + kind + "\"} 1\n"),
      std::string::npos)
      << text;
  EXPECT_NE(text.find("\npi_offload_ready 1\n"), std::string::npos);
  EXPECT_NE(text.find("\npi_offload_workers 1\n"), std::string::npos);
  for (const std::string histogram : {"task_service", "task_waiting"})
  {
    const std::string name = "pi_offload_" + histogram + "_seconds";
    EXPECT_NE(text.find("# TYPE " + name + " histogram\n"), std::string::npos);
    EXPECT_NE(text.find("\n" + name + "_count{kind=\"" + kind + "\"} 1\n"), std::string::npos);
    EXPECT_NE(text.find("\n" + name + "_bucket{kind=\"" + kind + "\",le=\"+Inf\"} 1\n"), std::string::npos);
  }
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
  {
    EXPECT_TRUE(line.rfind("# HELP pi_offload_", 0) == 0 || line.rfind("# TYPE pi_offload_", 0) == 0 ||
                line.rfind("pi_offload_", 0) == 0)
        << line;
  }
}
