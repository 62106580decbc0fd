#pragma once

#include <pi_node/durations.h>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <pi_runtime/runtime.h>
#include "core/task_state.h"
#include "units/thread_class.h"
#include "units/unit.h"

namespace pi_runtime
{

using TaskPtr = std::shared_ptr<TaskState>;

/// An admitted stream and its statistics.
struct Stream
{
  StreamRequest request;
  Unit* unit = nullptr;  ///< where its capacity is reserved; null: nowhere, since the unit failed
  PeriodicLoad load;     ///< on that unit, or the last one
  uint64_t jobs = 0;
  uint64_t missed = 0;
  double max_s = 0.0;
  // Constant bandwidth server (Abeni and Buttazzo 1998): a stream that takes longer than admitted delays only itself.
  int64_t used_ns = 0;             ///< run time not yet covered by periods
  int64_t server_deadline_ns = 0;  ///< earliest deadline of its jobs
  std::vector<float> responses_s;  ///< ring of the last
};

/// Implementation of Runtime: placement, dispatch, streams and statistics under one lock. The lock is not held while a
/// task is compiled, moved, started or run.
///
/// The submitting thread starts a task if the executor is asynchronous (OpenCL) and nothing must be compiled or moved.
/// Else the unit's own thread starts it.
class RuntimeCore : public std::enable_shared_from_this<RuntimeCore>
{
public:
  RuntimeCore(const RuntimeOptions& options, std::vector<CustomUnit> units);
  void start();
  /// Cancels tasks that have not begun, waits for running ones, ends the threads.
  void stop();

  TaskHandle submit(TaskRequest request);
  std::string refusalOf(const TaskRequest& request);
  std::vector<TaskHandle> submitBatch(std::vector<TaskRequest> requests);
  std::vector<TaskHandle> submitGraph(GraphRequest request);
  void cancel(TaskState& task);

  Admission admit(const StreamRequest& request);
  Admission amend(StreamId id, const StreamRequest& request);
  void retire(StreamId id);
  void raiseThread() const;
  std::vector<StreamStatus> streams() const;
  std::vector<TaskResult> calibrate(const TaskRequest& request, int runs);

  std::vector<UnitStatus> units() const;
  void setUnitAvailable(const std::string& unit, bool available);
  RuntimeStatistics statistics() const;
  InterCoreOptions interCoreOptions() const;
  void setInterCoreOptions(const InterCoreOptions& options);
  InnerCoreOptions innerCoreOptions() const;
  void setInnerCoreOptions(const InnerCoreOptions& options);
  std::vector<EtcTable::Entry> etcEntries() const;
  void setEtcEntries(const std::vector<EtcTable::Entry>& entries);
  void clearEtc();
  double predict(const CodeletPtr& codelet, double size, const std::string& unit) const;
  TraceRecorder& trace() { return trace_; }
  /// Call without the lock.
  void say(LogLevel level, const std::string& text) const;
  /// As Stage::yield(), for the task whose native function this thread runs; nothing if there is none.
  static void yieldHere();

private:
  using Lock = std::unique_lock<std::mutex>;

  /// Cost of a task on a unit.
  struct Cost
  {
    bool possible = false;
    bool allowed = false;  ///< possible, and within the blocking budget of admitted streams
    int executor = 0;
    double run_s = 0.0;  ///< predicted; 0 if nothing is known
    bool measured = false;
    double plan_s = 0.0;  ///< for planning: run_s or a guess, plus transfers; > 0
    double energy_j = 0.0;
  };
  /// The thread that tries to start tasks.
  enum class Caller : uint8_t
  {
    SUBMITTER,
    COMPLETION,
    WORKER,
  };

  // placement.cpp: which unit.
  Cost costOn(const TaskState& task, Unit& unit) const;
  Cost executorCost(const TaskState& task, Unit& unit, size_t executor) const;
  /// True if some executor can run the task without compiling first.
  bool hasTriedExecutor(const TaskState& task) const;
  /// True if the unit could run the task if it were usable.
  bool supports(const Unit& unit, const TaskState& task) const;
  bool withinBudget(const TaskState& task, const Unit& unit, const Cost& cost) const;
  /// The shortest stretch [s] for which the task holds the unit.
  static double leastPiece(const TaskState& task, const Cost& cost);
  double blockingBudget(const Unit& unit) const;
  double readyIn(const Unit& unit, int64_t now, const TaskState* before) const;
  double runningLeft(const Unit& unit, int64_t now) const;
  Unit* choose(TaskState& task, Cost* cost, TaskResult* refusal);
  Unit* chooseForDeadline(const TaskState& task, const std::vector<Cost>& costs, int64_t now) const;
  TaskResult refusalOf(const TaskState& task, const std::vector<Cost>& costs) const;
  void assign(TaskState& task, Unit& unit, const Cost& cost);
  /// The lane of the task's stream; null: it has none that is usable.
  Unit* laneOf(const TaskState& task) const;
  /// Places and queues a task; ends it if no unit takes it. Ended tasks are appended to `ended`.
  Unit* place(TaskState& task, std::vector<TaskPtr>* ended);
  void placeBatch(Lock& lock, const std::vector<TaskPtr>& batch, std::vector<TaskPtr>* ended);
  /// Places the queued tasks again for which `leaves` is true.
  void replaceQueued(Unit& unit, const std::function<bool(const TaskState&)>& leaves, std::vector<TaskPtr>* ended);
  /// As above, for tasks that would delay streams now.
  void replaceDelaying(Unit& unit, std::vector<TaskPtr>* ended);
  std::string unitNames() const;
  bool steal(Unit& thief, int64_t now);

  // dispatch.cpp, runtime_threads.cpp: what a unit does next.
  void pump(Lock& lock, Unit& unit, Caller caller);
  bool mayStart(const Unit& unit, const TaskState& task) const;
  bool takeArbiter(Lock& lock, Unit& unit, const TaskState& task, Caller caller);
  void startTask(Lock& lock, Unit& unit, TaskState& task);
  uint64_t sliceEnd(const Unit& unit, const TaskState& task) const;
  void onFinished(TaskState& task, const ExecutionReport& report);
  void afterGoodRun(Unit& unit, TaskState& task, std::vector<TaskPtr>* ended);
  void afterBadRun(Unit& unit, TaskState& task, const ExecutionReport& report, std::vector<TaskPtr>* ended);
  void blockExecutor(Unit& unit, CodeletRecord& record, size_t executor, const ExecutionReport& report,
                     std::vector<TaskPtr>* ended);
  void takeBack(Unit& unit, TaskState& task, int64_t now, std::vector<TaskPtr>* ended);
  void account(Unit& unit, TaskState& task, const ExecutionReport& report, int64_t now);
  void learn(const Unit& unit, TaskState& task);
  void releaseArbiter(Unit& unit);
  void failUnit(Unit& unit, const std::string& reason, std::vector<TaskPtr>* ended);
  void workerLoop(Unit& unit);
  void watchLoop();
  void checkHanging(int64_t now, std::vector<TaskPtr>* ended);
  void checkHanging(Unit& unit, int64_t now, std::vector<TaskPtr>* ended);
  /// Takes the priority from jobs that use far more than their worst case.
  void checkRunaways();
  void makeLanes();
  void startWorker(Unit& unit);
  void setUpWorker(Unit& unit);
  void pumpAll(Lock& lock, Caller caller);
  void wakeIdleWorkers(const Unit& busy);

  // runtime_core.cpp, runtime_status.cpp: life of a task, what users ask.
  TaskPtr makeTask(TaskRequest request);
  /// Numbers and checks a new task. @return false if it has ended at once.
  bool enroll(TaskState& task, std::vector<TaskPtr>* ended);
  std::string problemOf(const TaskRequest& request) const;
  CodeletRecord& recordOf(const CodeletPtr& codelet);
  /// Ends a task. announce() then notifies waiters and callbacks, without the lock.
  void end(TaskState& task, Outcome outcome, const std::string& message, std::vector<TaskPtr>* ended);
  void endGraphNode(TaskState& task, std::vector<TaskPtr>* ended);
  void countStreamJob(const TaskState& task);
  /// Releases the lock, then writes log lines and announces ended tasks.
  void leave(Lock& lock, const std::vector<TaskPtr>& ended);
  void announce(const std::vector<TaskPtr>& ended) const;
  Unit* findUnit(const std::string& name) const;
  /// Call with the lock; leave() writes the line.
  void note(const std::string& warning);
  // trials.cpp: executors that compile are tried in the background, never on a user's task that another can run.
  struct Trial
  {
    struct Shape
    {
      Access access;
      size_t bytes;  ///< 0: it is a value
    };
    CodeletPtr codelet;
    std::vector<Argument> values;  ///< per argument of the task, of any content where it is a buffer
    std::vector<Shape> buffers;    ///< per argument; the caller's memory may be gone when the trial begins
    uint64_t range;
    int bucket;
    Unit* unit;
    size_t executor;
  };
  /// Queues what the task's codelet has not been tried on, unless the ETC table knows that it is slower there.
  void queueTrials(const TaskState& task);
  void trialLoop();
  static ExecutionReport runTrial(const Trial& trial, double* run_s);
  void endTrial(const Trial& trial, double run_s, const ExecutionReport& report, std::vector<TaskPtr>* ended);

  void loadEtc();
  void saveEtc(Lock& lock);

  // graph_run.cpp: tasks that depend on each other.
  void planGraph(Lock& lock, GraphState& graph, const TaskGraph& structure);
  void raiseBarriers(GraphState& graph, const TaskGraph& structure);
  void settle(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended);
  void release(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended);

  /// The unit does more urgent tasks that wait for it, on the thread and within the function of the outer one.
  void letUrgentRun(Unit& unit, TaskState& outer);

  // streams.cpp: what must be on time.
  void refreshBudget(Unit& unit);
  /// Tells other processes of the streams of this one on the unit.
  void publishStreams(const Unit& unit) const;
  /// All admitted loads of the unit, also those of other processes.
  std::vector<PeriodicLoad> loadsOn(const Unit& unit) const;
  double reservedOn(const Unit& unit) const;  ///< part of its time
  void leaveHome(StreamId id, Stream& stream);
  void settleHome(StreamId id, Stream& stream, Unit& unit, const PeriodicLoad& load);
  void fillAdmission(const Stream& stream, Admission* admission);
  static std::string problemOf(const StreamRequest& request);
  static StreamStatus statusOf(StreamId id, const Stream& stream);
  std::chrono::nanoseconds shortestPeriod(const StreamRequest& request);
  void refreshOthersBudgets(std::vector<TaskPtr>* ended);
  /// Moves the streams of a failed unit to other units.
  void moveStreams(Unit& from, std::vector<TaskPtr>* ended);
  /// Tries again to place streams without a unit.
  void housePlaceless(std::vector<TaskPtr>* ended);
  /// Reserves capacity where the stream fits best. @param[out] reason  why it fits nowhere, one clause per unit.
  bool findHome(StreamId id, Stream& stream, std::string* reason, std::vector<TaskPtr>* ended);
  /// The load of the stream's jobs on the unit. @return why it is unknown; empty if it is known.
  std::string loadOn(const Unit& unit, const StreamRequest& request, PeriodicLoad* load);
  void warnOfShortWcet(const Unit& unit, const Stream& stream);
  void beginStreamJob(const TaskState& task);
  void chargeStream(TaskState& task, int64_t run_ns);
  void postponeQueued(StreamId id, int64_t urgency_ns);
  /// As tryHome(), with shorter slices if the usual ones are too long.
  std::string tryHomeInSlices(const Unit& unit, bool sliceable, PeriodicLoad* load) const;
  /// Why the load does not fit on the unit; empty if it does.
  std::string tryHome(const Unit& unit, const PeriodicLoad& load) const;
  /// With a real-time priority if there is one and the load leaves enough for the ordinary class, else without.
  std::string tryHomeInLanes(const Unit& unit, const StreamRequest& request, PeriodicLoad* load) const;

  const RuntimeOptions options_;
  std::vector<std::unique_ptr<Unit>> units_;
  TraceRecorder trace_;

  std::vector<std::unique_ptr<Unit>> lanes_;
  std::vector<Unit*> all_;     ///< units_ and lanes_
  std::string not_real_time_;  ///< why nothing is interrupted; empty: short jobs interrupt

  mutable InheritingMutex mutex_;
  InterCoreOptions inter_core_;
  InnerCoreOptions inner_core_;
  InterCoreScheduler single_scheduler_;
  EtcMatrix single_etc_;
  EtcMatrix single_energy_;
  std::vector<double> single_available_;
  Assignment single_assignment_;
  std::vector<Cost> costs_;
  EtcTable etc_;
  bool etc_changed_ = false;
  bool separate_memory_ = false;  ///< true: some executor has separate memory, so transfers count
  std::map<std::string, CodeletRecord> codelets_;
  std::map<StreamId, Stream> streams_;
  StreamId next_stream_ = 1;
  uint64_t next_task_ = 1;
  uint64_t next_sequence_ = 1;
  bool stopping_ = false;
  int announcing_ = 0;                 ///< threads in log or done callbacks
  std::vector<std::string> warnings_;  ///< not logged yet
  RuntimeStatistics statistics_{};
  std::condition_variable watch_;
  std::condition_variable idle_;  ///< while stopping: a task has ended, a callback has returned, or a worker has left
  std::thread watcher_;
  std::deque<Trial> trials_;
  std::condition_variable trial_queued_;
  std::thread trier_;    ///< from the first trial on
  bool trying_ = false;  ///< it is in an executor

  std::mutex planning_mutex_;  ///< taken before mutex_
  InterCoreScheduler batch_scheduler_;
};

/// Processor time of a thread [ns].
int64_t threadCpuNs(pthread_t thread);

/// For messages, as "12.3 ms".
std::string milliseconds(double seconds);

}  // namespace pi_runtime
