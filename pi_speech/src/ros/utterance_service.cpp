#include "ros/utterance_service.h"
#include <pthread.h>

#include <chrono>
#include <utility>

namespace pi_speech
{

UtteranceService::UtteranceService(ros::NodeHandle node, const std::string& service, double deadline_s)
  : node_(std::move(node)), name_(node_.resolveName(service)), deadline_s_(deadline_s), thread_([this] { run(); })
{
  pthread_setname_np(thread_.native_handle(), "speech_remote");
}

UtteranceService::~UtteranceService()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    client_.shutdown();  // a call under way ends
  }
  changed_.notify_all();
  thread_.join();
}

std::optional<Recognition> UtteranceService::ask(const Utterance& utterance, const std::vector<std::string>& commands)
{
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(deadline_s_);
  auto call = std::make_shared<Call>();
  RecognizeUtterance::Request& request = call->service.request;
  request.header.stamp = ros::Time::now();
  request.samples = utterance.samples;
  request.speech_s = static_cast<double>(utterance.speech_end - utterance.speech_begin) / SAMPLE_RATE_HZ;
  request.deadline = deadline_s_;
  request.commands = commands;
  std::unique_lock<std::mutex> lock(mutex_);
  if (busy_)
  {
    return std::nullopt;  // the last call is still unanswered
  }
  next_ = call;
  busy_ = true;
  changed_.notify_all();
  changed_.wait_until(lock, until, [&call] { return call->done; });
  if (!call->done || !call->ok || !call->service.response.handled)
  {
    return std::nullopt;
  }
  const RecognizeUtterance::Response& response = call->service.response;
  Recognition recognition;
  recognition.text = response.text;
  recognition.accepted = response.accepted;
  recognition.confidence = response.confidence;
  recognition.place = response.node;
  recognition.reason = response.accepted ? "" : "rejected by " + response.node;
  return recognition;
}

void UtteranceService::run()
{
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;)
  {
    changed_.wait(lock, [this] { return stopping_ || next_ != nullptr; });
    if (stopping_)
    {
      return;
    }
    const std::shared_ptr<Call> call = std::exchange(next_, nullptr);
    if (!client_.isValid())
    {
      client_ = node_.serviceClient<RecognizeUtterance>(name_, true);
    }
    ros::ServiceClient client = client_;
    lock.unlock();
    const bool ok = client.isValid() && client.call(call->service);
    lock.lock();
    call->ok = ok;
    call->done = true;
    busy_ = false;
    changed_.notify_all();
  }
}

}  // namespace pi_speech
