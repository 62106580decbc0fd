#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <pi_runtime/runtime.h>
#include "core/task_state.h"
#include "units/unit.h"

namespace pi_runtime
{

using TaskPtr = std::shared_ptr<TaskState>;

/// A stream of jobs and what became of them.
struct Stream
{
  StreamRequest request;
  Unit* unit = nullptr;  ///< where its capacity is reserved; null: nowhere, since the unit failed
  PeriodicLoad load;     ///< on that unit, or the last one
  uint64_t jobs = 0;
  uint64_t missed = 0;
  double max_s = 0.0;
  // Constant bandwidth server (Abeni and Buttazzo 1998): who takes longer than admitted waits, and not the others.
  int64_t used_ns = 0;             ///< of the running job, or what is left over from the periods that it has paid for
  int64_t server_deadline_ns = 0;  ///< no job of the stream is more urgent
  std::vector<float> responses_s;  ///< ring of the last
};

/// What stands behind Runtime: placement, dispatch, streams and statistics under one lock, which is never held while a
/// task is compiled, moved, started or run.
///
/// A unit's tasks are started by whoever makes that possible: the submitting thread where nothing has to be compiled or
/// moved and the executor is asynchronous (OpenCL), else the unit's own thread.
class RuntimeCore : public std::enable_shared_from_this<RuntimeCore>
{
public:
  RuntimeCore(const RuntimeOptions& options, std::vector<CustomUnit> units);
  void start();
  /// Ends what has not begun, waits for what runs, ends the threads.
  void stop();

  TaskHandle submit(TaskRequest request);
  std::vector<TaskHandle> submitBatch(std::vector<TaskRequest> requests);
  std::vector<TaskHandle> submitGraph(GraphRequest request);
  void cancel(TaskState& task);

  Admission admit(const StreamRequest& request);
  void retire(StreamId id);
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

private:
  using Lock = std::unique_lock<std::mutex>;

  /// What running a task on a unit would cost.
  struct Cost
  {
    bool possible = false;
    bool allowed = false;  ///< possible, and it would not hold the unit longer than admitted streams stand
    int executor = 0;
    double run_s = 0.0;  ///< predicted; 0 if nothing is known
    bool measured = false;
    double plan_s = 0.0;  ///< what planning counts: guesses where nothing is known, transfers included; > 0
    double energy_j = 0.0;
  };
  /// Who tries to start tasks.
  enum class Caller : uint8_t
  {
    SUBMITTER,
    COMPLETION,
    WORKER,
  };

  // placement.cpp: which unit.
  Cost costOn(const TaskState& task, Unit& unit) const;
  Cost executorCost(const TaskState& task, Unit& unit, size_t executor) const;
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
  /// Places and queues a task; ends it if no unit takes it. Ended tasks are appended to `ended`.
  Unit* place(TaskState& task, std::vector<TaskPtr>* ended);
  void placeBatch(Lock& lock, const std::vector<TaskPtr>& batch, std::vector<TaskPtr>* ended);
  /// Places those queued tasks anew for which it is true.
  void replaceQueued(Unit& unit, const std::function<bool(const TaskState&)>& leaves, std::vector<TaskPtr>* ended);
  /// As above: what would delay streams now.
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
  void blockExecutor(Unit& unit, const TaskState& task, const ExecutionReport& report, std::vector<TaskPtr>* ended);
  void takeBack(Unit& unit, TaskState& task, int64_t now, std::vector<TaskPtr>* ended);
  void account(Unit& unit, TaskState& task, const ExecutionReport& report, int64_t now);
  void learn(const Unit& unit, TaskState& task);
  void releaseArbiter(Unit& unit);
  void failUnit(Unit& unit, const std::string& reason, std::vector<TaskPtr>* ended);
  void workerLoop(Unit& unit);
  void watchLoop();
  void checkHanging(int64_t now, std::vector<TaskPtr>* ended);
  void pumpAll(Lock& lock, Caller caller);
  void wakeIdleWorkers(const Unit& busy);

  // runtime_core.cpp, runtime_status.cpp: life of a task, what users ask.
  TaskPtr makeTask(TaskRequest request);
  /// Numbers and checks a new task. @return false if it has ended at once.
  bool enroll(TaskState& task, std::vector<TaskPtr>* ended);
  std::string problemOf(const TaskRequest& request) const;
  CodeletRecord& recordOf(const CodeletPtr& codelet);
  /// Ends a task. It is told to those who wait by announce(), without the lock.
  void end(TaskState& task, Outcome outcome, const std::string& message, std::vector<TaskPtr>* ended);
  void endGraphNode(TaskState& task, std::vector<TaskPtr>* ended);
  void countStreamJob(const TaskState& task);
  /// Gives the lock back, and then tells those concerned what has happened under it: log lines, ended tasks.
  void leave(Lock& lock, const std::vector<TaskPtr>& ended);
  void announce(const std::vector<TaskPtr>& ended) const;
  Unit* findUnit(const std::string& name) const;
  /// Without the lock.
  void say(LogLevel level, const std::string& text) const;
  /// With the lock: said by leave().
  void note(const std::string& warning);
  void loadEtc();
  void saveEtc(Lock& lock);

  // graph_run.cpp: tasks that depend on each other.
  void planGraph(Lock& lock, GraphState& graph, const TaskGraph& structure);
  void raiseBarriers(GraphState& graph, const TaskGraph& structure);
  void settle(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended);
  void release(GraphState& graph, uint32_t node, std::vector<TaskPtr>* ended);

  // streams.cpp: what must be on time.
  void refreshBudget(Unit& unit);
  void refreshOthersBudgets(std::vector<TaskPtr>* ended);
  /// Takes the streams of a unit that is out elsewhere.
  void moveStreams(Unit& from, std::vector<TaskPtr>* ended);
  /// Gives the streams without a place another try.
  void housePlaceless(std::vector<TaskPtr>* ended);
  /// Reserves capacity where the stream fits best. @param[out] reason  why it fits nowhere, one clause per unit.
  bool findHome(StreamId id, Stream& stream, std::string* reason, std::vector<TaskPtr>* ended);
  /// What jobs of the stream are on the unit. @return why it cannot be said; empty if it can.
  std::string loadOn(const Unit& unit, const StreamRequest& request, PeriodicLoad* load);
  void warnOfShortWcet(const Unit& unit, const Stream& stream);
  void beginStreamJob(const TaskState& task);
  void chargeStream(TaskState& task, int64_t run_ns);
  void postponeQueued(StreamId id, int64_t urgency_ns);
  /// As tryHome(), with shorter slices if the usual ones are too long.
  std::string tryHomeInSlices(const Unit& unit, bool sliceable, PeriodicLoad* load) const;
  /// Why the load does not fit on the unit; empty if it does.
  std::string tryHome(const Unit& unit, const PeriodicLoad& load) const;

  const RuntimeOptions options_;
  std::vector<std::unique_ptr<Unit>> units_;
  TraceRecorder trace_;

  mutable std::mutex mutex_;
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
  bool separate_memory_ = false;  ///< some executor has memory of its own: transfers count
  std::map<std::string, CodeletRecord> codelets_;
  std::map<StreamId, Stream> streams_;
  StreamId next_stream_ = 1;
  uint64_t next_task_ = 1;
  uint64_t next_sequence_ = 1;
  bool stopping_ = false;
  int announcing_ = 0;                 ///< threads in log or done callbacks
  std::vector<std::string> warnings_;  ///< not said yet
  RuntimeStatistics statistics_{};
  std::condition_variable watch_;
  std::condition_variable idle_;  ///< while stopping: a task has ended, a callback has returned, or a worker has left
  std::thread watcher_;

  std::mutex planning_mutex_;  ///< taken before mutex_
  InterCoreScheduler batch_scheduler_;
};

int64_t steadyNow();
/// For messages, as "12.3 ms".
std::string milliseconds(double seconds);

}  // namespace pi_runtime
