#include "ros/utterance_tasks.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace pi_offload
{
namespace
{

constexpr double LONGEST_CALL_S = 60.0;

TaskData dataOf(const pi_speech::RecognizeUtterance::Request& request)
{
  TaskData data;
  data.encoding = Encoding::S16LE;
  data.bytes.reserve(2 * request.samples.size());
  for (const int16_t sample : request.samples)
  {
    data.bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) & 0xFFU));
    data.bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) >> 8U));
  }
  for (std::string command : request.commands)
  {
    std::replace(command.begin(), command.end(), '\n', ' ');
    data.options += (data.options.empty() ? "" : "\n") + command;
  }
  data.speech_s = request.speech_s >= 0.0 && std::isfinite(request.speech_s) ? request.speech_s : 0.0;
  return data;
}

}  // namespace

// The spinner has one thread more than calls may run, so that a call too many is answered at once.
UtteranceTasks::UtteranceTasks(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client,
                               TaskLedger* ledger, pi_node::WarningBoard* warnings)
  : options_(options)
  , client_(client)
  , ledger_(ledger)
  , warnings_(warnings)
  , threads_(static_cast<uint32_t>(options->max_calls) + 1, &queue_)
{
  node.setCallbackQueue(&queue_);
  server_ = node.advertiseService("recognize_utterance", &UtteranceTasks::recognize, this);
}

void UtteranceTasks::start()
{
  threads_.start();
}

void UtteranceTasks::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  server_.shutdown();
  threads_.stop();
}

bool UtteranceTasks::recognize(Service::Request& request, Service::Response& response)
{
  const int64_t began_ns = pi_node::monotonicNs();
  const double usual_s = options_->client.engine.needs[static_cast<size_t>(TaskKind::SPEECH)].deadline_s;
  const bool own_deadline = request.deadline > 0.0 && request.deadline < LONGEST_CALL_S;
  const double deadline_s = own_deadline ? request.deadline : usual_s;
  response.handled = 0;
  if (request.samples.empty() || 2 * request.samples.size() > MAX_PAYLOAD)
  {
    warnings_->warn("recognize_utterance: " + std::to_string(request.samples.size()) + " samples, must be 1 to " +
                    std::to_string(MAX_PAYLOAD / 2) + "; the recogniser does it itself");
    return true;
  }
  struct Running
  {
    std::atomic<int>& count;
    const int now;
    explicit Running(std::atomic<int>& calls) : count(calls), now(++calls) {}
    ~Running() { --count; }
  } const running(calls_running_);
  if (running.now > options_->max_calls)
  {
    warnings_->warn("recognize_utterance: more than " + std::to_string(options_->max_calls) +
                    " calls at a time; the recogniser does it itself");
    return true;
  }
  const auto call = std::make_shared<Call>();
  call->header = request.header;
  const auto data = std::make_shared<TaskData>(dataOf(request));
  client_->post([this, call, data, began_ns, deadline_s](int64_t now_ns)
                { submit(call, data, began_ns, deadline_s, now_ns); });
  const auto until =
      std::chrono::steady_clock::time_point(std::chrono::nanoseconds(began_ns + std::llround(1e9 * deadline_s)));
  std::unique_lock<std::mutex> lock(mutex_);
  changed_.wait_until(lock, until, [this, &call] { return call->done || stopping_; });
  call->done = true;  // a later answer has no caller
  response = call->response;
  return true;
}

void UtteranceTasks::submit(const std::shared_ptr<Call>& call, const std::shared_ptr<TaskData>& data, int64_t began_ns,
                            double deadline_s, int64_t now_ns)
{
  const uint64_t task = ledger_->newTask();
  calls_[task] = call;
  try
  {
    client_->submit(task, TaskKind::SPEECH, began_ns, deadline_s, std::move(*data), now_ns);
  }
  catch (const std::invalid_argument&)
  {
    answer(task, nullptr, "");
    calls_.erase(task);
    throw;
  }
}

void UtteranceTasks::runLocal(const Task& task)
{
  const int64_t now_ns = pi_node::monotonicNs();
  answer(task.id, nullptr, "");
  client_->engine().onLocalDone(task.id, options_->speech_local_s, now_ns);
}

void UtteranceTasks::deliver(const Outcome& outcome, const OffloadReply* reply)
{
  const auto found = calls_.find(outcome.task.id);
  if (found == calls_.end())
  {
    return;
  }
  const std::shared_ptr<Call> call = found->second;
  answer(outcome.task.id, reply, outcome.node);
  calls_.erase(outcome.task.id);
  ledger_->publish(outcome, call->header, outcome.how == Outcome::How::ABANDONED);
}

void UtteranceTasks::answer(uint64_t task, const OffloadReply* reply, const std::string& node)
{
  const auto found = calls_.find(task);
  if (found == calls_.end())
  {
    return;
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    Call& call = *found->second;
    if (call.done)
    {
      return;
    }
    call.done = true;
    call.response.handled = static_cast<uint8_t>(reply != nullptr);
    if (reply != nullptr)
    {
      call.response.text = reply->text;
      call.response.confidence = static_cast<double>(reply->confidence);
      call.response.accepted = static_cast<uint8_t>(reply->accepted);
      call.response.node = node;
    }
  }
  changed_.notify_all();
}

}  // namespace pi_offload
