#include "server/edge_metrics.h"

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <sstream>
#include <utility>
#include <vector>

namespace pi_offload
{
namespace
{

using prometheus::ClientMetric;
using prometheus::MetricType;

/// From a small network on a quick computer to speech in a full queue [s].
const prometheus::Histogram::BucketBoundaries BOUNDS_S = {0.005, 0.01, 0.02, 0.03, 0.05, 0.075,
                                                          0.1,   0.15, 0.2,  0.3,  0.5,  1.0};

class Families
{
public:
  void add(const char* name, MetricType type, const char* help, double value)
  {
    family(name, type, help).metric.push_back(metricOf(type, value));
  }
  /// One metric for each kind of task. @param metric  takes the index of the kind.
  template <typename MetricOf>
  void addByKind(const char* name, MetricType type, const char* help, const MetricOf& metric)
  {
    prometheus::MetricFamily& added = family(name, type, help);
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      added.metric.push_back(metric(kind));
      added.metric.back().label.push_back({"kind", toString(static_cast<TaskKind>(kind))});
    }
  }
  static ClientMetric metricOf(MetricType type, double value)
  {
    ClientMetric metric;
    (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
    return metric;
  }
  std::string text() const
  {
    std::ostringstream out;
    prometheus::TextSerializer().Serialize(out, families_);
    return out.str();
  }

private:
  prometheus::MetricFamily& family(const char* name, MetricType type, const char* help)
  {
    families_.push_back({"pi_offload_" + std::string(name), help, type, {}});
    return families_.back();
  }

  std::vector<prometheus::MetricFamily> families_;
};

}  // namespace

TaskDurations::TaskDurations() : waiting(BOUNDS_S), service(BOUNDS_S) {}

std::string prometheusText(const EdgeServer::Statistics& statistics, const EdgeServer::Health& health,
                           const std::array<TaskDurations, TASK_KINDS>& durations)
{
  constexpr MetricType COUNTER = MetricType::Counter;
  constexpr MetricType GAUGE = MetricType::Gauge;
  constexpr MetricType HISTOGRAM = MetricType::Histogram;
  Families families;
  const auto count = [&](const char* name, const char* help, auto value)
  { families.add(name, COUNTER, help, static_cast<double>(value)); };
  const auto gauge = [&](const char* name, const char* help, auto value)
  { families.add(name, GAUGE, help, static_cast<double>(value)); };
  const auto count_by_kind = [&](const char* name, const char* help, uint64_t EdgeServer::Statistics::OfKind::*value)
  {
    families.addByKind(name, COUNTER, help,
                       [&](size_t kind)
                       { return Families::metricOf(COUNTER, static_cast<double>(statistics.of_kind[kind].*value)); });
  };
  const auto histogram = [&](const char* name, const char* help, prometheus::Histogram TaskDurations::*of)
  { families.addByKind(name, HISTOGRAM, help, [&](size_t kind) { return (durations[kind].*of).Collect(); }); };
  count_by_kind("tasks_done_total", "Tasks done.", &EdgeServer::Statistics::OfKind::done);
  count_by_kind("tasks_failed_total", "Tasks that were taken and failed.", &EdgeServer::Statistics::OfKind::failed);
  histogram("task_service_seconds", "Time of a task on a worker.", &TaskDurations::service);
  histogram("task_waiting_seconds", "Time from the arrival of a task until a worker takes it.",
            &TaskDurations::waiting);
  count("tasks_taken_total", "Tasks taken.", statistics.admission.taken);
  count("tasks_refused_total", "Tasks refused.", statistics.admission.refused);
  count("tasks_expired_total", "Tasks taken, but not done in time.", statistics.admission.expired);
  count("tasks_cancelled_total", "Tasks called back by their vehicle.", statistics.cancelled);
  count("tasks_repeated_total", "Tasks that came more than once.", statistics.repeated);
  count("probes_total", "Probes answered.", statistics.probes);
  count("malformed_total", "Messages that were no request.", statistics.malformed);
  count("unanswered_total", "Replies for connections that had ended.", statistics.unanswered);
  count("busy_seconds_total", "Time of all workers on tasks.", statistics.admission.busy_s);
  gauge("workers", "Worker threads.", statistics.workers);
  gauge("running", "Tasks that run.", statistics.running);
  gauge("queued", "Tasks that wait for a worker.", statistics.queued);
  gauge("connections", "Open connections.", statistics.connections);
  gauge("vehicles", "Vehicles that are connected.", statistics.vehicles);
  gauge("draining", "1: takes no more tasks.", statistics.draining);
  gauge("live", "1: no worker hangs.", health.live);
  gauge("ready", "1: takes tasks.", health.ready);
  return families.text();
}

}  // namespace pi_offload
