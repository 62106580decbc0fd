// The drive with pi_runtime: what a child process of bench_runtime does for the variants that use it.
#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <thread>

#include <pi_runtime/runtime.h>
#include "drive_streams.h"
#include "drive_work.h"
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Admission;
using pi_runtime::Argument;
using pi_runtime::BufferPtr;
using pi_runtime::CodeletPtr;
using pi_runtime::NO_STREAM;
using pi_runtime::QueueOrder;
using pi_runtime::Runtime;
using pi_runtime::RuntimeOptions;
using pi_runtime::StreamId;
using pi_runtime::StreamRequest;
using pi_runtime::TaskRequest;
using pi_runtime::TaskResult;

constexpr int CALIBRATION_RUNS = 8;
/// What an inertial reading on the same unit can wait for within its deadline.
constexpr std::chrono::microseconds SLICE{4000};

/// How a variant uses the runtime.
struct Variant
{
  const char* name;
  bool one_unit;          ///< there is no other one
  bool sliced;            ///< detection
  bool admitted;          ///< streams with deadlines; else a static map, first come first served
  bool preemption;        ///< short jobs interrupt long ones
  const char* front_end;  ///< unit of the static map
  const char* detection;
};

constexpr Variant VARIANTS[] = {
    {"ours", false, false, true, true, "", ""},
    {"ours_uninterrupted", false, false, true, false, "", ""},
    {"ours_one_unit", true, false, true, true, "", ""},
    {"ours_one_unit_uninterrupted", true, true, true, false, "", ""},
    {"static_one_unit", false, false, false, false, "cpu0", "cpu0"},
    {"static_two_units", false, false, false, false, "cpu0", "cpu1"},
};

const Variant& variantOf(const std::string& name)
{
  for (const Variant& variant : VARIANTS)
  {
    if (variant.name == name)
    {
      return variant;
    }
  }
  throw std::invalid_argument("no variant " + name);
}

/// A stream whose jobs are tasks of one codelet.
class TaskStream
{
public:
  /// @param unit  that its tasks must run on; empty: any.
  TaskStream(Runtime* runtime, CodeletPtr codelet, const char* unit, uint64_t range,
             std::vector<std::vector<Argument>> arguments, const Rhythm& rhythm)
    : runtime_(runtime)
    , codelet_(std::move(codelet))
    , unit_(unit)
    , range_(range)
    , arguments_(std::move(arguments))
    , longest_s_(rhythm.longest_s)
    , stream_(codelet_->name, rhythm.period_s, rhythm.deadline_s, [this](const DriveStream::Job& job) { submit(job); })
  {
  }

  DriveStream* stream() { return &stream_; }

  void calibrate()
  {
    for (const TaskResult& result : runtime_->calibrate(request(0), CALIBRATION_RUNS))
    {
      if (!result.ok())
      {
        throw std::runtime_error(codelet_->name + " fails on " + result.unit + ": " + result.message);
      }
    }
  }

  void admit()
  {
    StreamRequest stream;
    stream.name = codelet_->name;
    stream.codelet = codelet_;
    stream.size = static_cast<double>(range_);
    stream.period = std::chrono::nanoseconds(stream_.periodNs());
    stream.deadline = std::chrono::nanoseconds(stream_.deadlineNs());
    stream.wcet = std::chrono::nanoseconds(std::llround(longest_s_ * 1e9));
    const Admission admission = runtime_->admit(stream);
    id_ = admission.id;
    with_deadline_ = true;
    for (const pi_runtime::StreamStatus& status : runtime_->streams())
    {
      if (status.id == id_)
      {
        std::printf("note %s admitted on %s with at most %.2f ms, expected %.2f ms\n", codelet_->name.c_str(),
                    status.unit.c_str(), status.wcet_s * 1e3,
                    runtime_->predict(codelet_, static_cast<double>(range_), status.unit) * 1e3);
      }
    }
    if (!admission.admitted())
    {
      std::printf("note %s not admitted: %s\n", codelet_->name.c_str(), admission.reason.c_str());
    }
  }

private:
  TaskRequest request(size_t slot) const
  {
    TaskRequest request;
    request.codelet = codelet_;
    request.arguments = arguments_[slot % arguments_.size()];
    request.range = range_;
    return request;
  }

  void submit(const DriveStream::Job& job)
  {
    TaskRequest task = request(job.slot);
    task.unit = unit_;
    task.stream = id_;
    if (with_deadline_)
    {
      task.deadline = std::chrono::nanoseconds(job.deadline_ns - nowNs());
    }
    task.done = [this, job](const TaskResult& result) { stream_.finished(job, nowNs(), result.ok()); };
    runtime_->submit(std::move(task));
  }

  Runtime* const runtime_;
  const CodeletPtr codelet_;
  const std::string unit_;
  const uint64_t range_;
  const std::vector<std::vector<Argument>> arguments_;
  const double longest_s_;
  DriveStream stream_;
  StreamId id_ = NO_STREAM;
  bool with_deadline_ = false;
};

RuntimeOptions optionsFor(const Variant& variant, const std::string& executors)
{
  RuntimeOptions options = benchOptions();
  options.native = true;  // the front end has no other implementation
  options.opencl_cpu = executors != "native";
  options.cpu_units = variant.one_unit ? std::vector<unsigned>{1} : std::vector<unsigned>{1, 1};
  options.queue_order = variant.admitted ? QueueOrder::EDF : QueueOrder::FIFO;
  options.stealing = variant.admitted;
  options.preemption = variant.preemption;
  options.slice = SLICE;
  return options;
}

CodeletPtr detectionFor(const Variant& variant, const std::string& executors)
{
  pi_runtime::Codelet codelet = *detectionCodelet(variant.sliced);
  if (executors == "opencl")
  {
    codelet.native.clear();
  }
  return makeCodelet(std::move(codelet));
}

}  // namespace

void childDrive(const std::vector<std::string>& words)
{
  const Variant& variant = variantOf(words.at(1));
  const double seconds = std::stod(words.at(2));
  const auto points = static_cast<int32_t>(std::stol(words.at(3)));
  const uint64_t layers = std::stoul(words.at(4));
  const std::string& executors = words.at(5);
  const bool inertial = words.at(6) == "inertial";
  // The runtime ends first: its tasks tell the streams when they end.
  std::vector<std::unique_ptr<TaskStream>> streams;
  Runtime runtime(optionsFor(variant, executors));

  std::vector<std::vector<Argument>> frames;
  std::vector<std::vector<Argument>> maps;
  std::vector<std::vector<Argument>> covariances;
  for (size_t slot = 0; slot < DriveStream::SLOTS; ++slot)
  {
    frames.push_back(FrontEndMemory().arguments(points));
    maps.push_back(DetectionMemory().arguments());
    covariances.push_back({Argument::inOut(pi_runtime::Buffer::allocate(INERTIAL_FLOATS * sizeof(float)))});
  }
  streams.push_back(std::make_unique<TaskStream>(&runtime, frontEndCodelet(), variant.front_end, 1, std::move(frames),
                                                 DRIVE_FRONT_END));
  streams.push_back(std::make_unique<TaskStream>(&runtime, detectionFor(variant, executors), variant.detection,
                                                 Network::HEIGHT * layers, std::move(maps), DRIVE_DETECTION));
  if (inertial)
  {
    streams.push_back(std::make_unique<TaskStream>(&runtime, inertialCodelet(), variant.front_end, 1,
                                                   std::move(covariances), DRIVE_INERTIAL));
  }
  std::vector<DriveStream*> all;
  for (const std::unique_ptr<TaskStream>& stream : streams)
  {
    stream->calibrate();
    all.push_back(stream->stream());
  }
  for (const std::unique_ptr<TaskStream>& stream : streams)
  {
    if (variant.admitted)
    {
      stream->admit();
    }
  }
  driveAndPrint(all, seconds);
}

}  // namespace pi_runtime_bench
