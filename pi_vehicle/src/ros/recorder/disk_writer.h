#pragma once

#include "recorder/incident_plan.h"
#include "recorder/message_memory.h"
#include "recorder/recording_folder.h"
#include "ros/recorder/bag_file.h"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle::recorder
{

struct DiskOptions
{
  std::string folder;
  int64_t slim_file_ns = 0;       ///< duration of a file of the continuous recording
  uint64_t slim_budget = 0;       ///< of all files of the continuous recording [bytes]
  uint64_t incidents_budget = 0;  ///< of all incidents [bytes]
  uint64_t min_free = 0;          ///< space that is left to others [bytes]
};

/// Writes what is in the memory: the continuous recording, and the incidents of the plan. Nothing throws: while the
/// disk cannot be written to, the problem is logged once and the memory keeps what it can; then recording goes on. One
/// thread calls tick() and finish(), any thread the others.
class DiskWriter
{
public:
  enum class Level
  {
    INFO,
    WARN,
    ERROR
  };
  using Log = std::function<void(Level level, const std::string& text)>;

  /// @param memory  @param plan  outlive this object.
  DiskWriter(const DiskOptions& options, MessageMemory* memory, IncidentPlan* plan, Log log);
  /// Waits for a recovery that is under way.
  ~DiskWriter();
  DiskWriter(const DiskWriter&) = delete;
  DiskWriter& operator=(const DiskWriter&) = delete;

  /// Writes what came since the last call. A message is safe from a kill once this returned.
  void tick();
  /// Writes what there is, and ends all files.
  void finish();

  std::string incidentName(int64_t stamp_ns, const std::string& cause) const;
  std::string incidentPath(const std::string& name) const { return folder_.finished(name).string(); }

  struct State
  {
    std::string problem;   ///< empty: all is well
    std::string slim;      ///< name of the file that is being written; empty: none
    std::string incident;  ///< likewise
    RecordingFolder::Usage slim_usage;
    RecordingFolder::Usage incidents_usage;
    uint64_t free_bytes = 0;
    uint64_t incidents = 0;  ///< finished since the start
    uint64_t missed = 0;     ///< messages that had to leave the memory before they were written
  };
  State state() const;

private:
  /// A file and how far it goes.
  struct Stream
  {
    std::unique_ptr<BagFile> bag;
    std::string name;
    uint64_t next = 0;      ///< message to write
    uint64_t again = 0;     ///< message to write if the disk fails: a kill of the file may cost the last batch
    int64_t begin_ns = -1;  ///< elapsed
    bool started = false;   ///< next is set
  };

  void writeSlim();
  void writeSlim(std::vector<KeptMessagePtr> messages, uint64_t next);
  void writeIncident();
  void write(Stream* stream, const std::vector<KeptMessagePtr>& messages, uint64_t next);
  void begin(Stream* stream, const std::string& name, const KeptMessage& first, std::vector<KeptMessagePtr> head);
  void end(Stream* stream);
  void attempt(Stream* stream, const std::function<void()>& action);
  void fail(const std::string& problem);
  void keepBudgets();
  void recover();
  void noteMissed(const MessageMemory::Batch& batch);

  const DiskOptions options_;
  MessageMemory* const memory_;
  IncidentPlan* const plan_;
  const Log log_;
  RecordingFolder folder_;
  Stream slim_;
  Stream incident_;
  int64_t slim_stamp_ns_ = 0;  ///< of the last message
  bool recovery_due_ = true;
  std::atomic<bool> recovering_{false};
  std::thread recovery_;
  int64_t cleaned_ns_ = INT64_MIN / 2;
  int64_t failed_ns_ = INT64_MIN / 2;
  bool failed_ = false;  ///< in this tick
  mutable std::mutex mutex_;
  State state_;
};

}  // namespace pi_vehicle::recorder
