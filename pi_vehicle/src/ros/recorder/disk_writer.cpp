#include "ros/recorder/disk_writer.h"

#include <pi_node/formatting.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace pi_vehicle::recorder
{
namespace
{

constexpr size_t BATCH = 2000;                    // messages of one write
constexpr int64_t CLEAN_PERIOD_NS = 10000000000;  // between looks at the budgets
constexpr int64_t RETRY_PERIOD_NS = 1000000000;   // after a failure
constexpr uint64_t FILES_OF_BUDGET = 4;           // a slim file has at most this part of the budget
constexpr int64_t JUMP_NS = 1000000000;           // back by more is a jump of the clock
constexpr double MEGABYTE = 1e6;

std::string megabytes(uint64_t bytes)
{
  return pi_node::format("%.1f MB", static_cast<double>(bytes) / MEGABYTE);
}

/// Messages of before a file, as if they came with its first one.
std::vector<KeptMessagePtr> movedTo(const KeptMessage& first, const std::vector<KeptMessagePtr>& head)
{
  std::vector<KeptMessagePtr> moved;
  for (const KeptMessagePtr& message : head)
  {
    if (message->elapsed_ns < first.elapsed_ns)
    {
      KeptMessage copy = *message;
      copy.stamp_ns = first.stamp_ns;
      moved.push_back(std::make_shared<const KeptMessage>(std::move(copy)));
    }
  }
  return moved;
}

}  // namespace

DiskWriter::DiskWriter(const DiskOptions& options, MessageMemory* memory, IncidentPlan* plan, Log log)
  : options_(options), memory_(memory), plan_(plan), log_(std::move(log)), folder_(options.folder)
{
  slim_.started = true;
  memory_->pin(0);
}

DiskWriter::~DiskWriter()
{
  if (recovery_.joinable())
  {
    recovery_.join();
  }
}

void DiskWriter::tick()
{
  const int64_t now_ns = memory_->completeNs();
  failed_ = false;
  if (!state_.problem.empty() && now_ns - failed_ns_ < RETRY_PERIOD_NS && now_ns >= failed_ns_)
  {
    return;
  }
  try
  {
    folder_.open();
    const uint64_t free_bytes = folder_.freeBytes();
    if (free_bytes < options_.min_free)
    {
      attempt(&slim_, [this] { end(&slim_); });
      attempt(&incident_, [this] { end(&incident_); });
      throw std::runtime_error("the disk is full");
    }
    attempt(&incident_, [this] { writeIncident(); });
    attempt(&slim_, [this] { writeSlim(); });
    if (now_ns - cleaned_ns_ >= CLEAN_PERIOD_NS)
    {
      cleaned_ns_ = now_ns;
      keepBudgets();
    }
  }
  catch (const std::exception& error)
  {
    fail(error.what());
  }
  const std::optional<int64_t> first_ns = plan_->firstNs();
  memory_->pin(std::min({slim_.next, slim_.again, first_ns ? memory_->firstSince(*first_ns) : UINT64_MAX}));
  bool goes_on = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.slim = slim_.bag ? slim_.name : "";
    state_.incident = incident_.bag ? incident_.name : "";
    goes_on = !failed_ && !std::exchange(state_.problem, failed_ ? state_.problem : "").empty();
  }
  if (goes_on)
  {
    recovery_due_ = true;
    log_(Level::INFO, "recording goes on in " + folder_.path().string());
  }
  if (!failed_ && recovery_due_ && !recovering_)
  {
    recover();
  }
}

void DiskWriter::finish()
{
  failed_ns_ = INT64_MIN / 2;  // one more try
  tick();
  if (!failed_)
  {
    attempt(&incident_, [this] { end(&incident_); });
    attempt(&slim_, [this] { end(&slim_); });
  }
}

void DiskWriter::attempt(Stream* stream, const std::function<void()>& action)
{
  try
  {
    action();
  }
  catch (const std::exception& error)
  {
    stream->bag.reset();
    stream->next = std::min(stream->next, stream->again);
    fail(error.what());
  }
}

void DiskWriter::fail(const std::string& problem)
{
  failed_ = true;
  failed_ns_ = memory_->completeNs();
  const uint64_t free_bytes = folder_.freeBytes();
  const std::string text = "nothing is recorded in " + folder_.path().string() + ": " + problem + "; " +
                           megabytes(free_bytes) + " are free there, and " + megabytes(options_.min_free) +
                           " are left to others; make room, or choose another disk by the parameter folder. Recording "
                           "goes on by itself";
  std::unique_lock<std::mutex> lock(mutex_);
  state_.free_bytes = free_bytes;
  const bool is_new = state_.problem.empty();
  state_.problem = text;
  lock.unlock();
  if (is_new)
  {
    log_(Level::ERROR, text);
  }
}

void DiskWriter::writeSlim()
{
  for (bool at_end = false; !at_end;)
  {
    const MessageMemory::Batch batch = memory_->read(slim_.next, BATCH);
    at_end = batch.at_end;
    noteMissed(batch);
    std::vector<KeptMessagePtr> messages;
    std::copy_if(batch.messages.begin(), batch.messages.end(), std::back_inserter(messages),
                 [](const KeptMessagePtr& message) { return message->slim; });
    const auto jump =
        std::find_if(messages.begin(), messages.end(),
                     [last_ns = slim_stamp_ns_](const auto& message) { return message->stamp_ns < last_ns - JUMP_NS; });
    if (jump != messages.end())  // a file has stamps in order
    {
      writeSlim({messages.begin(), jump}, slim_.next);
      end(&slim_);
      messages.erase(messages.begin(), jump);
    }
    writeSlim(messages, batch.next);
  }
  const bool full = slim_.bag && slim_.bag->bytes() > options_.slim_budget / FILES_OF_BUDGET;
  if (slim_.bag && (full || memory_->completeNs() - slim_.begin_ns >= options_.slim_file_ns))
  {
    end(&slim_);
    keepBudgets();
    recovery_due_ = true;  // of what had no room
  }
}

void DiskWriter::writeSlim(std::vector<KeptMessagePtr> messages, uint64_t next)
{
  if (!messages.empty() && !slim_.bag)
  {
    std::vector<KeptMessagePtr> head = memory_->latched();
    head.erase(std::remove_if(head.begin(), head.end(), [](const KeptMessagePtr& message) { return !message->slim; }),
               head.end());
    begin(&slim_, folder_.unusedName(RecordingFolder::SLIM, messages.front()->stamp_ns, ""), *messages.front(), head);
  }
  write(&slim_, messages, next);
  slim_stamp_ns_ = messages.empty() ? slim_stamp_ns_ : messages.back()->stamp_ns;
}

void DiskWriter::writeIncident()
{
  while (const std::optional<Incident> incident = plan_->current())
  {
    const uint64_t first = memory_->firstSince(incident->from_ns);
    if (!std::exchange(incident_.started, true))
    {
      incident_.next = incident_.again = first;
    }
    MessageMemory::Batch batch;
    do
    {
      batch = memory_->read(incident_.next, BATCH, incident->to_ns);
      noteMissed(batch);
      if (!incident_.bag && !batch.messages.empty())
      {
        std::vector<KeptMessagePtr> head = memory_->latched();
        head.insert(head.end(), incident->triggers.begin(), incident->triggers.end());  // those of an earlier part
        begin(&incident_, folder_.unused(incident->name), *batch.messages.front(), head);
      }
      write(&incident_, batch.messages, batch.next);
    } while (!batch.at_end);
    if (!plan_->endIfOver(batch.complete_ns))
    {
      return;
    }
    incident_.started = false;
    end(&incident_);
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ++state_.incidents;
    }
    keepBudgets();
  }
}

void DiskWriter::write(Stream* stream, const std::vector<KeptMessagePtr>& messages, uint64_t next)
{
  const uint64_t from = stream->next;
  if (stream->bag)
  {
    stream->bag->write(messages);
  }
  stream->again = from;
  stream->next = next;
}

void DiskWriter::begin(Stream* stream, const std::string& name, const KeptMessage& first,
                       std::vector<KeptMessagePtr> head)
{
  stream->name = name;
  stream->begin_ns = first.elapsed_ns;
  stream->bag = std::make_unique<BagFile>(folder_.active(name));
  stream->bag->write(movedTo(first, head));
}

void DiskWriter::end(Stream* stream)
{
  if (!stream->bag)
  {
    return;
  }
  stream->bag->finish(folder_.finished(stream->name));
  stream->bag.reset();
  stream->again = stream->next;
  if (stream == &incident_)
  {
    log_(Level::INFO, "recorded " + folder_.finished(stream->name).string());
  }
}

void DiskWriter::keepBudgets()
{
  for (const std::filesystem::path& file : folder_.keepWithin(RecordingFolder::INCIDENT, options_.incidents_budget))
  {
    log_(Level::WARN, "deleted " + file.string() + ": the incidents take more than incidents/budget_mb, " +
                          megabytes(options_.incidents_budget) + "; copy those that count, or raise it");
  }
  folder_.keepWithin(RecordingFolder::SLIM, options_.slim_budget);
  const RecordingFolder::Usage slim = folder_.usage(RecordingFolder::SLIM);
  const RecordingFolder::Usage incidents = folder_.usage(RecordingFolder::INCIDENT);
  const std::lock_guard<std::mutex> lock(mutex_);
  state_.slim_usage = slim;
  state_.incidents_usage = incidents;
  state_.free_bytes = folder_.freeBytes();
}

void DiskWriter::recover()
{
  recovery_due_ = false;
  if (recovery_.joinable())
  {
    recovery_.join();
  }
  std::vector<std::string> own;
  for (const Stream* stream : {&slim_, &incident_})
  {
    if (stream->bag)
    {
      own.push_back(stream->name);
    }
  }
  const std::vector<std::filesystem::path> files = folder_.unfinished(own);
  if (files.empty())
  {
    return;
  }
  recovering_ = true;
  recovery_ = std::thread(
      [this, files]
      {
        for (const std::filesystem::path& file : files)
        {
          try
          {
            log_(Level::INFO, recoverFile(file, messagesIn));
          }
          catch (const std::exception& error)
          {
            log_(Level::WARN, error.what());
          }
        }
        recovering_ = false;
      });
}

void DiskWriter::noteMissed(const MessageMemory::Batch& batch)
{
  if (batch.missed == 0)
  {
    return;
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state_.missed += batch.missed;
  }
  log_(Level::WARN, std::to_string(batch.missed) +
                        " messages left the memory before they were written; raise memory_mb, or take a faster disk");
}

std::string DiskWriter::incidentName(int64_t stamp_ns, const std::string& cause) const
{
  return folder_.unusedName(RecordingFolder::INCIDENT, stamp_ns, cause);
}

DiskWriter::State DiskWriter::state() const
{
  const std::lock_guard<std::mutex> lock(mutex_);
  return state_;
}

}  // namespace pi_vehicle::recorder
