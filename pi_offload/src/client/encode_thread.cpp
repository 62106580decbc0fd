#include "client/encode_thread.h"

#include <pthread.h>

#include <exception>
#include <utility>

namespace pi_offload
{

EncodeThread::EncodeThread(size_t max_waiting, PictureEncoder& encoder) : max_waiting_(max_waiting), encoder_(encoder)
{
}

EncodeThread::~EncodeThread()
{
  stop();
}

void EncodeThread::start()
{
  thread_ = std::thread([this] { run(); });
}

void EncodeThread::stop()
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

bool EncodeThread::add(Job job)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (stopping_ || jobs_.size() >= max_waiting_)
    {
      return false;
    }
    jobs_.push_back(std::move(job));
  }
  changed_.notify_one();
  return true;
}

void EncodeThread::run()
{
  pthread_setname_np(pthread_self(), "offload_encode");
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    changed_.wait(lock, [this] { return stopping_ || !jobs_.empty(); });
    if (stopping_)
    {
      return;
    }
    const Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    std::vector<uint8_t> bytes;
    std::string problem;
    try
    {
      bytes = encoder_.encode(job.data->picture, job.encoding);
    }
    catch (const std::exception& error)
    {
      problem = error.what();
    }
    job.done(std::move(bytes), problem);
    lock.lock();
  }
}

}  // namespace pi_offload
