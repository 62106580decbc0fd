#include "server/edge_server.h"

#include <sstream>

namespace pi_offload
{
namespace
{

class MetricsText
{
public:
  MetricsText() { out_.precision(12); }
  void family(const char* name, const char* type, const char* help)
  {
    out_ << "# HELP pi_offload_" << name << " " << help << "\n# TYPE pi_offload_" << name << " " << type << "\n";
  }
  template <typename Value>
  void value(const char* name, const std::string& labels, Value value)
  {
    out_ << "pi_offload_" << name << labels << " " << value << "\n";
  }
  template <typename Value>
  void single(const char* name, const char* type, const char* help, Value what)
  {
    family(name, type, help);
    value(name, "", what);
  }
  std::string text() const { return out_.str(); }

private:
  std::ostringstream out_;
};

std::string kindLabel(size_t kind)
{
  return std::string("{kind=\"") + toString(static_cast<TaskKind>(kind)) + "\"}";
}

}  // namespace

std::string prometheusText(const EdgeServer::Statistics& statistics, const EdgeServer::Health& health)
{
  MetricsText text;
  text.family("tasks_done_total", "counter", "Tasks done.");
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    text.value("tasks_done_total", kindLabel(kind), statistics.of_kind[kind].done);
  }
  text.family("tasks_failed_total", "counter", "Tasks that were taken and failed.");
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    text.value("tasks_failed_total", kindLabel(kind), statistics.of_kind[kind].failed);
  }
  text.family("service_seconds", "gauge", "Recent mean time of a task on a worker.");
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    text.value("service_seconds", kindLabel(kind), statistics.of_kind[kind].service_s);
  }
  text.single("tasks_taken_total", "counter", "Tasks taken.", statistics.admission.taken);
  text.single("tasks_refused_total", "counter", "Tasks refused.", statistics.admission.refused);
  text.single("tasks_expired_total", "counter", "Tasks taken, but not done in time.", statistics.admission.expired);
  text.single("tasks_cancelled_total", "counter", "Tasks called back by their vehicle.", statistics.cancelled);
  text.single("tasks_repeated_total", "counter", "Tasks that came more than once.", statistics.repeated);
  text.single("probes_total", "counter", "Probes answered.", statistics.probes);
  text.single("malformed_total", "counter", "Messages that were no request.", statistics.malformed);
  text.single("unanswered_total", "counter", "Replies for connections that had ended.", statistics.unanswered);
  text.single("busy_seconds_total", "counter", "Time of all workers on tasks.", statistics.admission.busy_s);
  text.single("workers", "gauge", "Worker threads.", statistics.workers);
  text.single("running", "gauge", "Tasks that run.", statistics.running);
  text.single("queued", "gauge", "Tasks that wait for a worker.", statistics.queued);
  text.single("connections", "gauge", "Open connections.", statistics.connections);
  text.single("vehicles", "gauge", "Vehicles that are connected.", statistics.vehicles);
  text.single("draining", "gauge", "1: takes no more tasks.", statistics.draining ? 1 : 0);
  text.single("live", "gauge", "1: no worker hangs.", health.live ? 1 : 0);
  text.single("ready", "gauge", "1: takes tasks.", health.ready ? 1 : 0);
  return text.text();
}

}  // namespace pi_offload
