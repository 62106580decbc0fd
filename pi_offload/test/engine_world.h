#pragma once

#include "engine/offload_engine.h"

#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace pi_offload_test
{
using pi_offload::Decision;
using pi_offload::EngineOptions;
using pi_offload::NodeAdvertisement;
using pi_offload::NodeDescription;
using pi_offload::OffloadEngine;
using pi_offload::Outcome;
using pi_offload::Point;
using pi_offload::RequestTiming;
using pi_offload::Task;
using pi_offload::TaskKind;
using pi_offload::VehicleState;

constexpr double INFINITE = std::numeric_limits<double>::infinity();
constexpr double NOT_A_NUMBER = std::numeric_limits<double>::quiet_NaN();
constexpr size_t PICTURE_BYTES = 60000;  // 0.48 Mbit

inline int64_t ms(double milliseconds)
{
  return static_cast<int64_t>(milliseconds * 1e6);
}

inline NodeDescription node(const std::string& id, double range = INFINITE, Point position = {})
{
  NodeDescription description;
  description.id = id;
  description.address = "192.168.1.10:5555";
  description.range_m = range;
  description.position = position;
  description.capacity_gcycles = 100.0;
  return description;
}

inline NodeAdvertisement advertisement(double service_s = 0.02, double queue_s = 0.0)
{
  NodeAdvertisement a;
  for (NodeAdvertisement::OfKind& of_kind : a.of_kind)
  {
    of_kind.served = true;
    of_kind.service_s = service_s;
    of_kind.queue_s = queue_s;
  }
  a.capacity_gcycles = 100.0;
  return a;
}

inline RequestTiming timing(double total_s, double service_s = 0.02, double queue_s = 0.0)
{
  RequestTiming t;
  t.total_s = total_s;
  t.service_s = service_s;
  t.queue_s = queue_s;
  return t;
}

/// An engine, and all that it asked for. The policy is `paper`: it takes a connected node in range without looking at
/// deviations, so that the tests say where a task goes.
struct World
{
  struct Sent
  {
    std::string node;
    uint64_t request = 0;
    uint64_t task = 0;
  };

  explicit World(const EngineOptions& options = withPolicy("paper")) : engine(options, actions()) {}

  static EngineOptions withPolicy(const std::string& name)
  {
    EngineOptions options;
    options.policy_name = name;
    return options;
  }

  OffloadEngine::Actions actions()
  {
    OffloadEngine::Actions a;
    a.send = [this](const std::string& id, uint64_t request, const Task& task)
    {
      if (link)
      {
        sent.push_back({id, request, task.id});
      }
      return link;
    };
    a.probe = [this](const std::string& id, uint64_t request)
    {
      probes.push_back({id, request, 0});
      return link;
    };
    a.run_local = [this](const Task& task, double frequency)
    {
      locals.push_back(task.id);
      local_ghz.push_back(frequency);
    };
    a.cancel = [this](const std::string& id, uint64_t request) { cancelled.push_back({id, request, 0}); };
    a.deliver = [this](const Outcome& outcome) { outcomes.push_back(outcome); };
    return a;
  }

  /// A node that has answered its probe.
  void addNode(const NodeDescription& description, const NodeAdvertisement& a = advertisement())
  {
    engine.setNode(description, now);
    answerProbes(description.id, a);
  }

  void answerProbes(const std::string& id, const NodeAdvertisement& a = advertisement())
  {
    engine.onTime(now);
    const std::vector<Sent> asked = std::exchange(probes, {});
    for (const Sent& probe : asked)
    {
      if (probe.node == id)
      {
        engine.onProbeReply(id, probe.request, 0.004, a, now);
      }
      else
      {
        probes.push_back(probe);
      }
    }
  }

  Decision submit(uint64_t id, TaskKind kind = TaskKind::DETECTION)
  {
    Task task;
    task.id = id;
    task.kind = kind;
    task.created_ns = now;
    task.input_bytes = PICTURE_BYTES;
    return engine.submit(task, now);
  }

  bool reply(const Sent& request, double total_s = 0.06)
  {
    return engine.onReply(request.node, request.request, timing(total_s), advertisement(), now);
  }

  void advance(double milliseconds)
  {
    now += ms(milliseconds);
    engine.onTime(now);
  }

  OffloadEngine::NodeStatus status(const std::string& id)
  {
    for (const OffloadEngine::NodeStatus& s : engine.nodes(now))
    {
      if (s.description.id == id)
      {
        return s;
      }
    }
    throw std::runtime_error("no node " + id);
  }

  bool link = true;
  int64_t now = ms(1000);
  std::vector<Sent> sent;
  std::vector<Sent> probes;
  std::vector<Sent> cancelled;
  std::vector<uint64_t> locals;
  std::vector<double> local_ghz;
  std::vector<Outcome> outcomes;
  OffloadEngine engine;
};

inline VehicleState at(double x, double y, double heading = 0.0, double speed = 3.0)
{
  VehicleState state;
  state.known = true;
  state.position = {x, y};
  state.heading = heading;
  state.speed = speed;
  return state;
}

inline std::string errorOf(const std::function<void()>& function)
{
  try
  {
    function();
  }
  catch (const std::invalid_argument& e)
  {
    return e.what();
  }
  return "";
}

}  // namespace pi_offload_test
