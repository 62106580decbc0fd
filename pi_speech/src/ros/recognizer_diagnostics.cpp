#include "ros/recognizer_diagnostics.h"
#include <diagnostic_msgs/DiagnosticStatus.h>
#include <pi_node/formatting.h>

#include <vector>

namespace pi_speech
{
namespace
{

using diagnostic_msgs::DiagnosticStatus;
using pi_node::format;

const char* stateOf(const RecognizerFigures& figures)
{
  if (figures.stream.commands == 0)
  {
    return figures.loading.empty() && !figures.problem.empty() ? "error" : "loading";
  }
  return !figures.listening ? "stopped" : figures.subscribed ? "listening" : "waiting for a listener";
}

}  // namespace

RecognizerDiagnostics::RecognizerDiagnostics(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                                             const pi_node::WarningBoard* warnings)
  : warnings_(warnings), updater_(node, private_node, private_node.getNamespace())
{
  updater_.setHardwareID("none");
  updater_.add("recognition", [this](Status& status) { reportRecognition(status); });
  updater_.add("sound", [this](Status& status) { reportSound(status); });
}

void RecognizerDiagnostics::addRecognition(const Recognition& recognition, double latency_s)
{
  std::lock_guard<std::mutex> lock(mutex_);
  decision_ms_.add(1e3 * recognition.work_s);
  if (recognition.accepted)
  {
    ++accepted_;
    fast_ += recognition.fast ? 1 : 0;
    last_command_ = recognition.text + format(" (%.2f)", recognition.confidence);
    last_latency_s_ = latency_s;
    latency_ms_.add(1e3 * latency_s);
  }
  else
  {
    ++rejected_;
    doubtful_ += recognition.doubtful ? 1 : 0;
    last_rejected_ = (recognition.text.empty() ? "" : recognition.text + ": ") + recognition.reason;
  }
}

void RecognizerDiagnostics::addWork(double cpu_s, double sound_s)
{
  std::lock_guard<std::mutex> lock(mutex_);
  cpu_s_ += cpu_s;
  sound_s_ += sound_s;
}

void RecognizerDiagnostics::update(const RecognizerFigures& figures)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    cpu_share_ = sound_s_ > 0.0 ? cpu_s_ / sound_s_ : 0.0;
    cpu_s_ = sound_s_ = 0.0;
  }
  now_ = figures;
  updater_.force_update();
}

void RecognizerDiagnostics::reportRecognition(Status& status)
{
  std::lock_guard<std::mutex> lock(mutex_);
  const std::string number =
      std::to_string(now_.stream.commands) + (now_.stream.commands == 1 ? " command" : " commands");
  if (now_.stream.commands == 0)
  {
    const bool failed = now_.loading.empty() && !now_.problem.empty();
    status.summary(failed ? DiagnosticStatus::ERROR : DiagnosticStatus::WARN,
                   failed ? now_.problem : "loading " + now_.loading);
  }
  else if (!now_.no_network.empty())
  {
    status.summary(DiagnosticStatus::ERROR, now_.no_network);
  }
  else if (!now_.problem.empty())
  {
    status.summary(DiagnosticStatus::WARN, now_.problem + "; goes on with " + number);
  }
  else if (now_.dictation && !now_.dictation->problem.empty())
  {
    status.summary(DiagnosticStatus::WARN, "no dictation: " + now_.dictation->problem);
  }
  else if (!now_.listening)
  {
    status.summary(DiagnosticStatus::OK, "stopped; service start lets it listen");
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK, number + " are ready, nobody listens");
  }
  else
  {
    status.summary(
        DiagnosticStatus::OK,
        "listens for " + number +
            (last_command_.empty() ? std::string()
                                   : ", last " + last_command_ + format(" after %.0f ms", 1e3 * last_latency_s_)));
  }
  status.add("state", stateOf(now_));
  status.add("commands", now_.stream.understood);
  status.add("mode", now_.mode);
  status.add("commands heard in running speech", now_.stream.spotted);
  status.add("words spoken by rules", now_.stream.guessed);
  status.add("heard", accepted_ + rejected_);
  status.add("accepted", accepted_);
  status.add("accepted before the pause", fast_);
  status.add("rejected", rejected_);
  status.add("rejected, but doubtful", doubtful_);
  status.add("last command", last_command_);
  status.add("last rejected", last_rejected_);
  status.add("end of speech to published, p50 [ms]", format("%.0f", latency_ms_.quantile(0.5)));
  status.add("end of speech to published, p95 [ms]", format("%.0f", latency_ms_.quantile(0.95)));
  status.add("work on a decision, p50 [ms]", format("%.1f", decision_ms_.quantile(0.5)));
  status.add("work on a decision, p95 [ms]", format("%.1f", decision_ms_.quantile(0.95)));
  status.add("CPU per time of sound [%]", format("%.2f", 100.0 * cpu_share_));
  status.add("runtime", now_.stream.decisions.text());
  if (now_.stream.decisions.runtime)
  {
    status.add("decisions by the runtime", now_.stream.decisions.stream.jobs);
    status.add("decisions taken back from it, as all units were busy", now_.stream.decisions.plain);
  }
  if (now_.dictation)
  {
    status.add("dictation", now_.dictation->problem.empty() ? "on" : now_.dictation->problem);
    status.add("utterances written down", now_.dictation->written);
    status.add("utterances not written down, as others waited", now_.dictation->dropped);
  }
  if (!now_.loading.empty())
  {
    status.add("loading", now_.loading);
  }
}

void RecognizerDiagnostics::reportSound(Status& status) const
{
  const std::vector<pi_node::WarningBoard::Entry> warnings = warnings_->recent();
  if (!now_.queue.problem.empty())
  {
    status.summary(DiagnosticStatus::ERROR, now_.queue.problem);
  }
  else if (!now_.subscribed)
  {
    status.summary(DiagnosticStatus::OK,
                   now_.topic + " is not subscribed: " + (now_.listening ? "nobody listens" : "stopped"));
  }
  else if (!warnings.empty() && warnings.front().error)
  {
    status.summary(DiagnosticStatus::ERROR, warnings.front().text);
  }
  else if (now_.sound.last.state != SoundState::GOOD)
  {
    status.summary(DiagnosticStatus::WARN, now_.topic + ": " + now_.sound.last.text);
  }
  else if (!warnings.empty())
  {
    status.summary(DiagnosticStatus::WARN, warnings.front().text);
  }
  else
  {
    status.summary(DiagnosticStatus::OK,
                   now_.topic + format(" comes, level %.0f dB of full scale", now_.sound.level_dbfs));
  }
  status.add("format",
             toString(now_.queue.format) + (now_.queue.format_known ? "" : ", by parameters: no audio_info yet"));
  status.add("state of the sound", toString(now_.sound.last.state));
  status.add("level [dB of full scale]", format("%.1f", now_.sound.level_dbfs));
  status.add("noise [dB of full scale]", format("%.1f", now_.stream.noise_dbfs));
  status.add("clipped [%]", format("%.2f", 100.0 * now_.sound.clipped_share));
  status.add("speech", now_.stream.in_speech ? "yes" : "no");
  status.add("messages that came", now_.queue.chunks);
  status.add("messages dropped, as others waited", now_.queue.dropped);
  status.add("messages that could not be used", now_.queue.unusable + now_.stream.damaged);
  status.add("gaps", now_.stream.gaps);
  status.add("times that stamps went back", now_.stream.backs);
  status.add("changes of format", now_.stream.formats);
  status.add("sound that waits [s]", format("%.2f", now_.queue.waiting_s));
  pi_node::addWarnings(warnings, &status);
}

}  // namespace pi_speech
