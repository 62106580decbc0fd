#include "evaluation/sequence_reader.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>
#include <pthread.h>

#include <condition_variable>
#include <ctime>
#include <deque>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

namespace pi_slam
{

namespace
{

/// Samples of the IMU that may wait: a recording may have minutes of them before the first picture.
constexpr size_t MAX_WAITING_ITEMS = 10000;

}  // namespace

void SequenceReaderOptions::validate() const
{
  constexpr double YEAR_S = 3.2e7;
  const pi_node::OptionCheck check("reader");
  check.range("start_s", start_s, 0.0, YEAR_S);
  check.range("duration_s", duration_s, 0.0, YEAR_S);
  check.range("pair_tolerance_s", pair_tolerance_s, 0.0, 0.1);
  check.range("read_ahead", read_ahead, 1, 1000);
}

struct SequenceReader::Impl
{
  void run()
  {
    try
    {
      while (true)
      {
        std::optional<SequenceItem> item = source->next();
        std::unique_lock<std::mutex> lock(mutex);
        defects = source->defects();
        if (!item)
        {
          break;
        }
        const bool pair = std::holds_alternative<StereoPair>(*item);
        taken.wait(lock, [&] { return stop || (waiting_pairs < read_ahead && items.size() < MAX_WAITING_ITEMS); });
        if (stop)
        {
          return;
        }
        waiting_pairs += pair ? 1 : 0;
        items.push_back(std::move(*item));
        added.notify_one();
      }
    }
    catch (...)
    {
      const std::lock_guard<std::mutex> lock(mutex);
      failure = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex);
    ended = true;
    cpu_s = pi_node::cpuSeconds(CLOCK_THREAD_CPUTIME_ID);
    added.notify_one();
  }

  std::unique_ptr<SequenceSource> source;
  size_t read_ahead = 1;
  mutable std::mutex mutex;
  std::condition_variable taken;
  std::condition_variable added;
  std::deque<SequenceItem> items;
  size_t waiting_pairs = 0;
  SequenceDefects defects;
  std::exception_ptr failure;
  bool ended = false;
  bool stop = false;
  double cpu_s = 0.0;  // once ended
  std::thread thread;
};

SequenceReader::SequenceReader(std::unique_ptr<SequenceSource> source, int read_ahead) : impl_(std::make_unique<Impl>())
{
  if (!source)
  {
    throw std::invalid_argument("reader: no source; open a recording first");
  }
  pi_node::OptionCheck("reader").range("read_ahead", read_ahead, 1, 1000);
  impl_->source = std::move(source);
  impl_->read_ahead = static_cast<size_t>(read_ahead);
  impl_->thread = std::thread([this] { impl_->run(); });
}

SequenceReader::~SequenceReader()
{
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
    impl_->taken.notify_one();
  }
  impl_->thread.join();
}

const SequenceDescription& SequenceReader::description() const
{
  return impl_->source->description();
}

std::optional<SequenceItem> SequenceReader::next()
{
  std::unique_lock<std::mutex> lock(impl_->mutex);
  impl_->added.wait(lock, [&] { return !impl_->items.empty() || impl_->ended; });
  if (impl_->items.empty())
  {
    if (impl_->failure)
    {
      std::rethrow_exception(std::exchange(impl_->failure, nullptr));
    }
    return std::nullopt;
  }
  SequenceItem item = std::move(impl_->items.front());
  impl_->items.pop_front();
  impl_->waiting_pairs -= std::holds_alternative<StereoPair>(item) ? 1 : 0;
  impl_->taken.notify_one();
  return item;
}

SequenceDefects SequenceReader::defects() const
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  return impl_->defects;
}

double SequenceReader::cpuSeconds() const
{
  const std::lock_guard<std::mutex> lock(impl_->mutex);
  clockid_t clock{};
  return impl_->ended || pthread_getcpuclockid(impl_->thread.native_handle(), &clock) != 0 ? impl_->cpu_s
                                                                                           : pi_node::cpuSeconds(clock);
}

}  // namespace pi_slam
