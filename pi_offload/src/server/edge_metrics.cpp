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

  template <typename Value>
  void add(const char* name, const char* type, const char* help, Value value)
  {
    head(name, type, help);
    out_ << "pi_offload_" << name << " " << value << "\n";
  }
  /// One value for each kind of task. @param value  takes the index of the kind.
  template <typename ValueOf>
  void addByKind(const char* name, const char* type, const char* help, const ValueOf& value)
  {
    head(name, type, help);
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      out_ << "pi_offload_" << name << "{kind=\"" << toString(static_cast<TaskKind>(kind)) << "\"} " << value(kind)
           << "\n";
    }
  }
  std::string text() const { return out_.str(); }

private:
  void head(const char* name, const char* type, const char* help)
  {
    out_ << "# HELP pi_offload_" << name << " " << help << "\n# TYPE pi_offload_" << name << " " << type << "\n";
  }

  std::ostringstream out_;
};

}  // namespace

std::string prometheusText(const EdgeServer::Statistics& statistics, const EdgeServer::Health& health)
{
  MetricsText text;
  const auto& of_kind = statistics.of_kind;
  text.addByKind("tasks_done_total", "counter", "Tasks done.", [&](size_t kind) { return of_kind[kind].done; });
  text.addByKind("tasks_failed_total", "counter", "Tasks that were taken and failed.",
                 [&](size_t kind) { return of_kind[kind].failed; });
  text.addByKind("service_seconds", "gauge", "Recent mean time of a task on a worker.",
                 [&](size_t kind) { return of_kind[kind].service_s; });
  text.add("tasks_taken_total", "counter", "Tasks taken.", statistics.admission.taken);
  text.add("tasks_refused_total", "counter", "Tasks refused.", statistics.admission.refused);
  text.add("tasks_expired_total", "counter", "Tasks taken, but not done in time.", statistics.admission.expired);
  text.add("tasks_cancelled_total", "counter", "Tasks called back by their vehicle.", statistics.cancelled);
  text.add("tasks_repeated_total", "counter", "Tasks that came more than once.", statistics.repeated);
  text.add("probes_total", "counter", "Probes answered.", statistics.probes);
  text.add("malformed_total", "counter", "Messages that were no request.", statistics.malformed);
  text.add("unanswered_total", "counter", "Replies for connections that had ended.", statistics.unanswered);
  text.add("busy_seconds_total", "counter", "Time of all workers on tasks.", statistics.admission.busy_s);
  text.add("workers", "gauge", "Worker threads.", statistics.workers);
  text.add("running", "gauge", "Tasks that run.", statistics.running);
  text.add("queued", "gauge", "Tasks that wait for a worker.", statistics.queued);
  text.add("connections", "gauge", "Open connections.", statistics.connections);
  text.add("vehicles", "gauge", "Vehicles that are connected.", statistics.vehicles);
  text.add("draining", "gauge", "1: takes no more tasks.", statistics.draining ? 1 : 0);
  text.add("live", "gauge", "1: no worker hangs.", health.live ? 1 : 0);
  text.add("ready", "gauge", "1: takes tasks.", health.ready ? 1 : 0);
  return text.text();
}

}  // namespace pi_offload
