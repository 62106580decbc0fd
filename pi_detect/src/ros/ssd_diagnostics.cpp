#include "ros/ssd_diagnostics.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>

#include <utility>
#include <vector>

namespace pi_detect
{
namespace
{

using pi_node::format;
using pi_node::RecentValues;

using diagnostic_msgs::DiagnosticStatus;

constexpr double RATE_SMOOTHING = 0.1;  ///< weight of the newest picture
constexpr double RATE_PAUSE_S = 2.0;    ///< without a picture, after which the rate is counted anew

}  // namespace

SsdDiagnostics::SsdDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                               const pi_node::WarningBoard* warnings, double input_timeout_s)
  : warnings_(warnings)
  , input_timeout_s_(input_timeout_s)
  , updater_(node, private_node, private_node.getNamespace())
  , updated_at_ns_(pi_node::vehicleNs())
{
  updater_.setHardwareID("none");
  updater_.add("detection", [this](Status& status) { reportDetection(status); });
  updater_.add("input", [this](Status& status) { reportInput(status); });
}

void SsdDiagnostics::addPicture(const DetectionResult& result, double latency_s, double work_s)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const double period_s = pi_node::secondsBetween(worked_at_ns_, pi_node::vehicleNs());
  if (worked_ == 0 || period_s > RATE_PAUSE_S)
  {
    period_s_ = 0.0;
  }
  else
  {
    period_s_ = period_s_ == 0.0 ? period_s : (1.0 - RATE_SMOOTHING) * period_s_ + RATE_SMOOTHING * period_s;
  }
  worked_at_ns_ = pi_node::vehicleNs();
  ++worked_;
  objects_ = result.detections.size();
  latency_ms_.add(1e3 * latency_s);
  work_ms_.add(1e3 * work_s);
  blob_ms_.add(1e3 * result.blob_s);
  forward_ms_.add(1e3 * result.forward_s);
  decode_ms_.add(1e3 * result.decode_s);
}

void SsdDiagnostics::reset()
{
  std::lock_guard<std::mutex> lock(mutex_);
  period_s_ = 0.0;
  for (RecentValues* values : {&latency_ms_, &work_ms_, &blob_ms_, &forward_ms_, &decode_ms_})
  {
    values->clear();
  }
}

double SsdDiagnostics::rate() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return period_s_ > 0.0 && pi_node::secondsBetween(worked_at_ns_, pi_node::vehicleNs()) < RATE_PAUSE_S
             ? 1.0 / period_s_
             : 0.0;
}

void SsdDiagnostics::update(const SsdFigures& figures)
{
  const int64_t now_ns = pi_node::vehicleNs();
  interval_s_ = pi_node::secondsBetween(updated_at_ns_, now_ns);
  updated_at_ns_ = now_ns;
  now_ = figures;
  updater_.setHardwareID(now_.model.empty() ? "none" : now_.model);
  updater_.force_update();
  before_ = std::move(now_);
}

void SsdDiagnostics::reportDetection(Status& status)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const double rate = interval_s_ > 0.0 ? static_cast<double>(worked_ - worked_before_) / interval_s_ : 0.0;
  worked_before_ = worked_;
  if (now_.model.empty())
  {
    const bool failed = !now_.problem.empty();
    status.summary(failed ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN,
                   failed ? now_.problem : "loading " + now_.loading);
  }
  else if (!now_.problem.empty())
  {
    status.summary(DiagnosticStatus::WARN, now_.problem + "; goes on with " + now_.model);
  }
  else if (!now_.notice.empty())
  {
    status.summary(DiagnosticStatus::WARN, now_.notice);
  }
  else if (now_.target.used != now_.target.requested)
  {
    status.summary(DiagnosticStatus::WARN, std::string("on ") + toString(now_.target.used) + " instead of " +
                                               toString(now_.target.requested) + ": " + now_.target.reason);
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK, now_.model + " is ready, nobody listens");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, now_.model + format(", %.1f pictures/s", rate) +
                                             format(", %.0f ms after their stamps", latency_ms_.quantile(0.5)));
  }
  status.add("model", now_.model);
  if (!now_.notice.empty())
  {
    status.add("stands in", now_.notice);
  }
  status.add("target requested", toString(now_.target.requested));
  status.add("target used", toString(now_.target.used));
  status.add("device", now_.target.device.empty() ? "CPU" : now_.target.device);
  status.add("threads of OpenCV", now_.threads);
  status.add("runtime", now_.runtime);
  status.add("pictures out [Hz]", format("%.1f", rate));
  status.add("stamp to published, p50 [ms]", format("%.1f", latency_ms_.quantile(0.5)));
  status.add("stamp to published, p99 [ms]", format("%.1f", latency_ms_.quantile(0.99)));
  status.add("work, mean [ms]", format("%.2f", work_ms_.mean()));
  status.add("work, p99 [ms]", format("%.2f", work_ms_.quantile(0.99)));
  status.add("work: picture to input, mean [ms]", format("%.2f", blob_ms_.mean()));
  status.add("work: network, mean [ms]", format("%.2f", forward_ms_.mean()));
  status.add("work: outputs to detections, mean [ms]", format("%.2f", decode_ms_.mean()));
  status.add("pictures worked on", worked_);
  status.add("objects in the last picture", objects_);
  status.add("calls of detect", now_.calls);
  if (!now_.loading.empty())
  {
    status.add("loading", now_.loading);
  }
}

void SsdDiagnostics::reportInput(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  if (!warnings.empty())
  {
    status.summary(warnings.front().error ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN, warnings.front().text);
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK, "nobody listens, " + now_.topic + " is not subscribed");
  }
  else if (now_.silent_s > input_timeout_s_)
  {
    status.summary(DiagnosticStatus::WARN, "nothing on " + now_.topic + format(" for %.1f s", now_.silent_s) +
                                               "; check that the camera runs and that the topic is its");
  }
  else
  {
    status.summary(DiagnosticStatus::OK, now_.topic + " comes");
  }
  const double rate = interval_s_ > 0.0 ? static_cast<double>(now_.pictures - before_.pictures) / interval_s_ : 0.0;
  status.add("pictures in [Hz]", format("%.1f", rate));
  status.add("pictures that came", now_.pictures);
  status.add("pictures dropped for newer ones", now_.dropped);
  status.add("pictures left out for max_rate_hz", now_.left_out);
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_detect
