#include "ros/dictation.h"

#include <pthread.h>
#include <ros/console.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <exception>
#include <memory>
#include <utility>

namespace pi_speech
{
namespace
{

constexpr size_t MOST_WAITING = 3;  ///< utterances
constexpr int NICE = 10;

}  // namespace

Dictation::Dictation(const SphinxModel& model, pi_node::WarningBoard* warnings,
                     std::function<void(const std::string& text)> written)
  : model_(model), warnings_(warnings), written_(std::move(written)), thread_([this] { run(); })
{
}

Dictation::~Dictation()
{
  stop();
}

void Dictation::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable())
  {
    thread_.join();
  }
}

void Dictation::add(const Samples& utterance)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!ready_)
    {
      return;
    }
    if (utterances_.size() >= MOST_WAITING)
    {
      utterances_.pop_front();
      ++figures_.dropped;
    }
    utterances_.push_back(utterance);
  }
  changed_.notify_one();
}

Dictation::Figures Dictation::figures() const
{
  std::lock_guard<std::mutex> lock(mutex_);
  return figures_;
}

void Dictation::run()
{
  pthread_setname_np(pthread_self(), "speech_dictate");
  setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), NICE);
  std::unique_ptr<SphinxDecoder> decoder;
  std::string problem;
  try
  {
    decoder = std::make_unique<SphinxDecoder>(model_, std::vector<std::string>(), std::vector<std::string>());
  }
  catch (const std::exception& error)
  {
    problem = error.what();
  }
  std::unique_lock<std::mutex> lock(mutex_);
  if (!decoder)
  {
    figures_.problem = problem;
    lock.unlock();
    ROS_ERROR_STREAM_NAMED("recognizer", "no dictation: " << problem);
    return;
  }
  ready_ = true;
  while (true)
  {
    changed_.wait(lock, [this] { return stopping_ || !utterances_.empty(); });
    if (stopping_)
    {
      return;
    }
    const Samples samples = std::move(utterances_.front());
    utterances_.pop_front();
    lock.unlock();
    std::string text;
    try
    {
      text = decoder->decode(samples).text();
    }
    catch (const std::exception& error)
    {
      warnings_->error(std::string("dictation failed: ") + error.what());
    }
    if (!text.empty())
    {
      written_(text);
    }
    lock.lock();
    figures_.written += text.empty() ? 0 : 1;
  }
}

}  // namespace pi_speech
