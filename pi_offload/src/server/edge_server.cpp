#include "server/edge_server.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <limits>
#include <stdexcept>

#include "server/edge_server_impl.h"
#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

/// Time for the last replies to reach the kernel.
constexpr double FLUSH_S = 2.0;

}  // namespace

void EdgeServerOptions::validate() const
{
  replier.validate();
  if (transport == Transport::NATS)
  {
    requireNatsToken("id", site);
    requireNatsToken("detection/model", network);
    if (nats.servers.empty())
    {
      throw std::invalid_argument("nats/servers = [], must be at least one server for transport nats");
    }
    nats.validate();
  }
  admission.validate();
  const pi_node::OptionCheck check("server");
  constexpr double MOST = std::numeric_limits<double>::max();
  check.range("position/x", position.x, -MOST, MOST);
  check.range("position/y", position.y, -MOST, MOST);
  check.range("range_m", range_m, 0.0, std::numeric_limits<double>::infinity());
  check.range<size_t>("max_payload_bytes", max_payload_bytes, 1U << 20U, size_t{1} << 40U);
  check.range("max_task_s", max_task_s, 0.1, 86400.0);
}

EdgeServer::EdgeServer(const EdgeServerOptions& options, const std::array<ExecutorFactory, TASK_KINDS>& executors,
                       Callbacks callbacks)
{
  EdgeServerOptions checked = options;
  bool any = false;
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    checked.admission.served[kind] = static_cast<bool>(executors[kind]);
    any = any || executors[kind];
  }
  checked.validate();
  if (!any)
  {
    throw std::invalid_argument("server/executors: there is none, must be one for at least one kind of task");
  }
  impl_ = std::make_unique<Impl>(checked, std::move(callbacks));
  for (int number = 0; number < checked.admission.workers; ++number)
  {
    auto worker = std::make_unique<Impl::Worker>();
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      if (!executors[kind])
      {
        continue;
      }
      const std::string name =
          std::string(toString(static_cast<TaskKind>(kind))) + ", worker " + std::to_string(number);
      try
      {
        worker->executors[kind] = executors[kind]();
      }
      catch (const std::exception& error)
      {
        throw std::runtime_error(name + ": " + error.what());
      }
      if (!worker->executors[kind])
      {
        throw std::runtime_error(name + ": the factory made no executor");
      }
    }
    impl_->workers.push_back(std::move(worker));
  }
  {
    // Early requests wait for the mutex until the pointer is set.
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->replier = impl_->makeReplier();
  }
  for (const auto& worker : impl_->workers)
  {
    worker->thread = std::thread([impl = impl_.get(), worker = worker.get()] { impl->work(worker); });
  }
}

EdgeServer::~EdgeServer()
{
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->work_wanted.notify_all();
  for (const auto& worker : impl_->workers)
  {
    worker->thread.join();
  }
  {
    // Requests still come: from now on they see `stop` and leave the replier alone.
    std::unique_lock<std::mutex> lock(impl_->mutex);
    impl_->work_done.wait(lock, [&] { return impl_->sending == 0; });
  }
  impl_->replier.reset();
}

uint16_t EdgeServer::port() const
{
  return impl_->replier->port();
}

bool EdgeServer::drain(double timeout_s)
{
  impl_->replier->leave();
  {
    std::unique_lock<std::mutex> lock(impl_->mutex);
    impl_->admission.setDraining(true);
    if (!impl_->work_done.wait_for(lock, std::chrono::duration<double>(timeout_s),
                                   [&] { return impl_->jobs.empty() && impl_->sending == 0; }))
    {
      return false;
    }
  }
  return impl_->replier->flush(FLUSH_S);
}

EdgeServer::Health EdgeServer::health() const
{
  const bool connected = impl_->replier->connected();
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  const int64_t now_ns = pi_node::monotonicNs();
  Health health;
  health.live = std::none_of(
      impl_->workers.begin(), impl_->workers.end(),
      [&](const std::unique_ptr<Impl::Worker>& worker)
      { return worker->busy && pi_node::secondsBetween(worker->busy_since_ns, now_ns) > impl_->options.max_task_s; });
  health.ready = health.live && connected && !impl_->admission.draining();
  return health;
}

EdgeServer::Statistics EdgeServer::statistics() const
{
  const size_t connections = impl_->replier->connections();
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  Statistics statistics = impl_->counted;
  const NodeAdvertisement node = impl_->admission.advertisement("", pi_node::monotonicNs());
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    statistics.of_kind[kind].served = node.of_kind[kind].served;
    statistics.of_kind[kind].service_s = node.of_kind[kind].service_s;
  }
  statistics.admission = impl_->admission.totals();
  statistics.connections = connections;
  statistics.vehicles = impl_->connection_of.size();
  statistics.queued = impl_->admission.queued();
  statistics.running = impl_->admission.running();
  statistics.workers = impl_->options.admission.workers;
  statistics.draining = impl_->admission.draining();
  return statistics;
}

std::string EdgeServer::metrics() const
{
  return prometheusText(statistics(), health(), impl_->durations);
}

}  // namespace pi_offload
