// OpenCL devices, programs and their cache, and memory models: on PoCL.
#include <pi_runtime/opencl.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <thread>

#include "core/fake_executor.h"
#include "opencl/opencl_executor.h"
#include "units/native_executor.h"

namespace pi_runtime
{
namespace
{

namespace fs = std::filesystem;

const char* const ADD =
    "kernel void add(global const int* in, global int* out, int b)\n"
    "{ size_t i = get_global_id(0); out[i] = in[i] + b; }\n";

/// Both implementations of out[i] = in[i] + b. The native one notes the addresses that it sees.
CodeletPtr addCodelet(const std::string& name, bool native, bool opencl, const std::string& source = ADD)
{
  Codelet codelet;
  codelet.name = name;
  if (native)
  {
    codelet.native = {{[](const NativeCall& call)
                       {
                         for (uint64_t i = call.begin(); i < call.end(); ++i)
                         {
                           call.buffer<int>(1)[i] = call.buffer<const int>(0)[i] + call.value<int>(2);
                         }
                       }}};
  }
  if (opencl)
  {
    codelet.opencl = {singleKernel(source, "add", 1)};
  }
  codelet.sliceable = true;
  return makeCodelet(std::move(codelet));
}

class OpenClTest : public testing::Test
{
protected:
  OpenClTest()
  {
    char name[] = "/tmp/test_opencl.XXXXXX";
    folder_ = mkdtemp(name);
    for (const OpenClDeviceInfo& info : findOpenClDevices(nullptr))
    {
      if (info.type == UnitType::CPU)
      {
        cpu_ = info;
      }
    }
  }
  ~OpenClTest() override { fs::remove_all(folder_); }
  void SetUp() override { ASSERT_TRUE(cpu_) << "no OpenCL CPU device (Debian: pocl-opencl-icd)"; }

  OpenClProgram build(const std::string& source, const std::string& options = "")
  {
    OpenClImplementation implementation;
    implementation.source = source;
    implementation.options = options;
    return OpenClProgram(context(), 0, implementation, folder_);
  }
  OpenClContext& context()
  {
    if (!context_)
    {
      context_.emplace(*cpu_, std::vector<unsigned>{1}, MemoryModel::DIRECT);
    }
    return *context_;
  }
  fs::path cacheFile() const { return *fs::directory_iterator(folder_); }

  RuntimeOptions openclOptions(MemoryModel memory = MemoryModel::DIRECT)
  {
    RuntimeOptions options = FakeRuntime::fakeOptions();
    options.opencl_cpu = true;
    options.cpu_units = {1};
    options.cpu_memory = memory;
    options.cache_folder = folder_;
    options.log = [this](LogLevel, const std::string& text)
    {
      std::lock_guard<std::mutex> lock(log_mutex_);
      log_.push_back(text);
    };
    return options;
  }

  std::string folder_;
  std::optional<OpenClDeviceInfo> cpu_;
  std::optional<OpenClContext> context_;
  std::mutex log_mutex_;
  std::vector<std::string> log_;
};

TEST_F(OpenClTest, TheCpuIsFoundAndDescribed)
{
  EXPECT_FALSE(cpu_->name.empty());
  EXPECT_FALSE(cpu_->driver.empty());
  EXPECT_GE(cpu_->compute_units, 1u);
}

TEST_F(OpenClTest, ImpossibleSubDevicesAreAnError)
{
  EXPECT_THROW(OpenClContext(*cpu_, {cpu_->compute_units + 1}, MemoryModel::DIRECT), OpenClError);
}

TEST_F(OpenClTest, AProgramThatDoesNotBuildHasTheCompilersWords)
{
  try
  {
    build("kernel void broken( { }");
    FAIL();
  }
  catch (const OpenClError& error)
  {
    EXPECT_EQ(CL_BUILD_PROGRAM_FAILURE, error.code());
    EXPECT_NE(std::string::npos, error.buildLog().find("error")) << error.buildLog();
    EXPECT_FALSE(error.deviceLost());
  }
  EXPECT_TRUE(fs::is_empty(folder_)) << "failures are not kept";
}

TEST_F(OpenClTest, AMissingKernelIsNamed)
{
  OpenClProgram program = build(ADD);
  EXPECT_NE(nullptr, program.kernel("add"));
  try
  {
    program.kernel("subtract");
    FAIL();
  }
  catch (const OpenClError& error)
  {
    EXPECT_EQ(CL_INVALID_KERNEL_NAME, error.code());
    EXPECT_NE(std::string::npos, std::string(error.what()).find("subtract"));
  }
}

TEST_F(OpenClTest, ProgramsComeFromTheCacheBySourceAndOptions)
{
  EXPECT_FALSE(build(ADD).fromCache());
  EXPECT_TRUE(build(ADD).fromCache());
  EXPECT_FALSE(build(ADD, "-DOTHER=1").fromCache());
  EXPECT_FALSE(build(std::string(ADD) + " ").fromCache());
}

TEST_F(OpenClTest, ADamagedCacheFileIsBuiltAnew)
{
  build(ADD);
  const fs::path file = cacheFile();
  const auto size = fs::file_size(file);
  std::ifstream stream(file, std::ios::binary);
  const std::string good((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
  std::vector<std::string> damaged = {"", "no program at all", std::string(size, '\0')};
  for (const size_t part : {2u, 3u, 10u, 100u})
  {
    damaged.push_back(good.substr(0, size - size / part));
  }
  damaged.push_back(good.substr(0, size - 1));
  damaged.push_back(good + "x");
  for (const size_t where : {size_t{9}, static_cast<size_t>(size) / 2, static_cast<size_t>(size) - 1})
  {
    damaged.push_back(good);
    damaged.back()[where] = static_cast<char>(damaged.back()[where] ^ 0x55);
  }
  for (const std::string& content : damaged)
  {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << content;
    OpenClProgram program = build(ADD);
    EXPECT_FALSE(program.fromCache()) << content.size() << " of " << size << " bytes";
    EXPECT_NE(nullptr, program.kernel("add"));
    EXPECT_TRUE(build(ADD).fromCache()) << "and the file is mended";
  }
}

TEST_F(OpenClTest, ACacheThatCannotBeWrittenCostsOnlyTime)
{
  OpenClImplementation implementation;
  implementation.source = ADD;
  OpenClProgram program(context(), 0, implementation, "/proc/no/such/folder");
  EXPECT_NE(nullptr, program.kernel("add"));
}

TEST_F(OpenClTest, BothTwinsLeaveTheSameResult)
{
  RuntimeOptions options = openclOptions();
  options.native = true;
  Runtime runtime(options);
  std::vector<std::vector<int>> results;
  for (const bool opencl : {false, true})
  {
    const BufferPtr in = Buffer::allocate(1000 * sizeof(int));
    const BufferPtr out = Buffer::allocate(1000 * sizeof(int));
    for (int i = 0; i < 1000; ++i)
    {
      in->hostAs<int>(Access::WRITE)[i] = i * i;
    }
    TaskRequest request = requestOf(addCodelet(opencl ? "add_cl" : "add_native", !opencl, opencl));
    request.range = 1000;
    request.arguments = {Argument::in(in), Argument::out(out), Argument::value(5)};
    const TaskHandle task = runtime.submit(request);
    EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    EXPECT_EQ(opencl ? "opencl" : "native", task.wait().executor);
    const int* const values = out->hostAs<int>(Access::READ);
    results.emplace_back(values, values + 1000);
  }
  EXPECT_EQ(results[0], results[1]);
  EXPECT_EQ(999 * 999 + 5, results[0][999]);
}

TEST_F(OpenClTest, KernelsWorkInTheCallersMemory)
{
  Runtime runtime(openclOptions());
  EXPECT_EQ("direct", runtime.units()[0].memory);
  const std::string source = "kernel void add(global ulong* where) { where[0] = (ulong)where; }";
  alignas(64) static uint64_t memory[8];
  TaskRequest request = requestOf(addCodelet("address", false, true, source));
  request.arguments = {Argument::inOut(Buffer::wrap(memory, sizeof memory))};
  const TaskHandle task = runtime.submit(request);
  ASSERT_TRUE(task.wait().ok()) << task.wait().message;
  EXPECT_EQ(reinterpret_cast<uint64_t>(memory), memory[0]);
  EXPECT_EQ(0, task.wait().transfer_ns);
}

class EveryMemory : public OpenClTest, public testing::WithParamInterface<MemoryModel>
{
};

TEST_P(EveryMemory, HandsContentOverBetweenKernelsFunctionsAndTheHost)
{
  constexpr int COUNT = 256;
  RuntimeOptions options = openclOptions(GetParam());
  options.native = true;
  BufferPtr a = Buffer::allocate(COUNT * sizeof(int));
  BufferPtr b = Buffer::allocate(COUNT * sizeof(int));
  {
    Runtime runtime(options);
    EXPECT_EQ(toString(GetParam()), runtime.units()[0].memory);
    const CodeletPtr ways[] = {addCodelet("on_native", true, false), addCodelet("on_opencl", false, true)};
    int sum = 0;
    unsigned pattern = 0xb4d;  // each of the two after each of the two, and the host in between
    for (int step = 1; step <= 12; ++step, pattern >>= 1)
    {
      TaskRequest request = requestOf(ways[pattern & 1]);
      request.range = COUNT;
      request.arguments = {Argument::in(a), Argument::out(b), Argument::value(step)};
      const TaskHandle task = runtime.submit(request);
      ASSERT_TRUE(task.wait().ok()) << task.wait().message;
      sum += step;
      if (step % 3 == 0)
      {
        ASSERT_EQ(sum, b->hostAs<int>(Access::READ)[COUNT - 1]) << "step " << step;
      }
      if (step % 5 == 0)
      {
        std::fill_n(b->hostAs<int>(Access::WRITE), COUNT, 100);
        sum = 100;
      }
      std::swap(a, b);
    }
    ASSERT_EQ(sum, a->hostAs<int>(Access::READ)[0]);
    TaskRequest request = requestOf(ways[1]);
    request.range = COUNT;
    request.arguments = {Argument::in(a), Argument::out(b), Argument::value(1)};
    ASSERT_TRUE(runtime.submit(request).wait().ok());
  }
  EXPECT_EQ(a->hostAs<int>(Access::READ)[5] + 1, b->hostAs<int>(Access::READ)[5]) << "buffers outlive the runtime";
}

TEST_P(EveryMemory, KeepsWhatEarlierSlicesWroteWhenTheTaskMoves)
{
  constexpr int COUNT = 64;
  RuntimeOptions options = openclOptions(GetParam());
  OpenClExecutor executor(std::make_shared<OpenClContext>(*cpu_, std::vector<unsigned>{1}, GetParam()), 0, "");
  NativeExecutor native(UnitType::CPU);
  const CodeletPtr codelet = addCodelet("add", true, true);
  const BufferPtr in = Buffer::allocate(COUNT * sizeof(int));
  const BufferPtr out = Buffer::allocate(COUNT * sizeof(int));
  const std::vector<Argument> arguments = {Argument::in(in), Argument::out(out), Argument::value(7)};
  const std::atomic<bool> cancelled{false};
  for (uint64_t begin = 0; begin < COUNT; begin += 16)
  {
    Event ended;
    Executor& where = begin % 32 == 0 ? static_cast<Executor&>(executor) : native;
    where.start(Execution{codelet, arguments, begin, begin + 16, COUNT, &cancelled},
                [&](const ExecutionReport& report)
                {
                  EXPECT_EQ(Outcome::OK, report.outcome) << report.message;
                  ended.set();
                });
    ASSERT_TRUE(ended.wait());
  }
  const int* const values = out->hostAs<int>(Access::READ);
  EXPECT_EQ(COUNT, std::count(values, values + COUNT, 7));
}

TEST_P(EveryMemory, MovesExactlyWhatIsStale)
{
  constexpr size_t BYTES = 1024;
  const bool separate = GetParam() == MemoryModel::SEPARATE;
  OpenClExecutor executor(std::make_shared<OpenClContext>(*cpu_, std::vector<unsigned>{1}, GetParam()), 0, "");
  const CodeletPtr codelet = addCodelet("add", false, true);
  const BufferPtr in = Buffer::allocate(BYTES);
  const BufferPtr out = Buffer::allocate(BYTES);
  const std::vector<Argument> arguments = {Argument::in(in), Argument::out(out), Argument::value(7)};
  const std::atomic<bool> cancelled{false};
  const auto movedBytes = [&]
  {
    Event ended;
    uint64_t moved = 0;
    executor.start(Execution{codelet, arguments, 0, 256, 256, &cancelled},
                   [&](const ExecutionReport& report)
                   {
                     EXPECT_EQ(Outcome::OK, report.outcome) << report.message;
                     moved = report.moved_bytes;
                     ended.set();
                   });
    EXPECT_TRUE(ended.wait());
    return moved;
  };
  EXPECT_EQ(separate ? BYTES : 0, movedBytes()) << "the input only";
  EXPECT_EQ(0u, movedBytes()) << "nothing has changed";
  in->host(Access::READ_WRITE);
  EXPECT_EQ(separate ? BYTES : 0, movedBytes());
  out->host(Access::READ_WRITE);
  EXPECT_EQ(0u, movedBytes()) << "the output is overwritten";
  EXPECT_EQ(separate ? BYTES : 0, out->bytesToMove(nullptr, Access::READ) * (separate ? 1 : 0));
}

INSTANTIATE_TEST_SUITE_P(OpenCl, EveryMemory,
                         testing::Values(MemoryModel::DIRECT, MemoryModel::MAPPED, MemoryModel::SEPARATE),
                         [](const auto& info) { return toString(info.param); });

TEST_F(OpenClTest, AProgramThatDoesNotBuildFallsBackToTheFunctionWithOneWarning)
{
  RuntimeOptions options = openclOptions();
  options.native = true;
  Runtime runtime(options);
  for (const std::string source : {"kernel void add( {", "kernel void another(global int* a) {}"})
  {
    log_.clear();
    const CodeletPtr codelet = addCodelet("add", true, true, source);
    std::vector<TaskHandle> tasks;
    for (int i = 0; i < 10; ++i)
    {
      const BufferPtr buffer = Buffer::allocate(sizeof(int));
      TaskRequest request = requestOf(codelet);
      request.arguments = {Argument::in(buffer), Argument::out(Buffer::allocate(sizeof(int))), Argument::value(1)};
      tasks.push_back(runtime.submit(request));
    }
    for (const TaskHandle& task : tasks)
    {
      EXPECT_TRUE(task.wait().ok()) << task.wait().message;
    }
    runtime.calibrate(requestOf(codelet), 0);
    std::lock_guard<std::mutex> lock(log_mutex_);
    EXPECT_EQ(1u, log_.size());
  }
}

TEST_F(OpenClTest, WithoutAnotherImplementationTheTaskHasTheLog)
{
  Runtime runtime(openclOptions());
  const TaskHandle task = runtime.submit(requestOf(addCodelet("add", false, true, "kernel void add( {")));
  EXPECT_EQ(Outcome::BUILD_FAILED, task.wait().outcome);
  EXPECT_EQ(CL_BUILD_PROGRAM_FAILURE, task.wait().opencl_code);
  EXPECT_NE(std::string::npos, task.wait().message.find("error")) << task.wait().message;
}

TEST_F(OpenClTest, WrongArgumentsFailTheTaskAndNotTheUnit)
{
  Runtime runtime(openclOptions());
  TaskRequest request = requestOf(addCodelet("add", false, true));
  request.arguments = {Argument::in(Buffer::allocate(4)), Argument::out(Buffer::allocate(4)), Argument::value('x')};
  const TaskHandle task = runtime.submit(request);
  EXPECT_EQ(Outcome::EXECUTION_FAILED, task.wait().outcome);
  EXPECT_NE(std::string::npos, task.wait().message.find("argument 2 (1 bytes) of kernel add")) << task.wait().message;
  EXPECT_FALSE(runtime.units()[0].failed);
}

TEST_F(OpenClTest, AFunctionThatThrowsOrEnqueuesNothingEndsItsTask)
{
  Runtime runtime(openclOptions());
  Codelet codelet = *addCodelet("odd", false, true);
  codelet.opencl[0].function = [](OpenClCommand&) {};
  EXPECT_TRUE(runtime.submit(requestOf(makeCodelet(codelet))).wait().ok());
  codelet.name = "bad";
  codelet.opencl[0].function = [](OpenClCommand&) { throw std::runtime_error("not today"); };
  EXPECT_EQ("not today", runtime.submit(requestOf(makeCodelet(codelet))).wait().message);
}

TEST_F(OpenClTest, ManyThreadsMayHaveTheirKernelsRun)
{
  constexpr int THREADS = 4;
  constexpr int TASKS = 150;
  RuntimeOptions options = openclOptions();
  options.cpu_units.clear();
  options.native = true;
  Runtime runtime(options);
  const CodeletPtr codelet = addCodelet("add", true, true);
  std::atomic<int> done{0};
  std::atomic<int> right{0};
  const auto work = [&]
  {
    std::vector<std::pair<TaskHandle, BufferPtr>> tasks;
    for (int i = 0; i < TASKS; ++i)
    {
      const BufferPtr in = Buffer::allocate(64 * sizeof(int));
      const BufferPtr out = Buffer::allocate(64 * sizeof(int));
      in->hostAs<int>(Access::WRITE)[63] = i;
      TaskRequest request = requestOf(codelet);
      request.range = 64;
      request.arguments = {Argument::in(in), Argument::out(out), Argument::value(1)};
      request.done = [&done](const TaskResult&) { ++done; };
      tasks.emplace_back(runtime.submit(request), out);
    }
    for (int i = 0; i < TASKS; ++i)
    {
      const bool good = tasks[static_cast<size_t>(i)].first.wait().ok();
      right += good && tasks[static_cast<size_t>(i)].second->hostAs<int>(Access::READ)[63] == i + 1 ? 1 : 0;
    }
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < THREADS; ++i)
  {
    threads.emplace_back(work);
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  EXPECT_EQ(THREADS * TASKS, right);
}

TEST_F(OpenClTest, TheRuntimeMayEndWhileCallbacksSubmitTheNextTask)
{
  for (int round = 0; round < 20; ++round)
  {
    std::atomic<int> submitted{0};
    std::atomic<int> done{0};
    Event enough;
    {
      TaskRequest request = requestOf(addCodelet("add", false, true));  // used by callbacks to the end of the runtime
      Runtime runtime(openclOptions());
      request.arguments = {Argument::in(Buffer::allocate(4)), Argument::out(Buffer::allocate(4)), Argument::value(1)};
      request.done = [&](const TaskResult& result)
      {
        if (++done == 5)
        {
          enough.set();
        }
        if (result.ok())
        {
          ++submitted;
          runtime.submit(request);
        }
      };
      ++submitted;
      runtime.submit(request);
      ASSERT_TRUE(enough.wait());
    }
    EXPECT_EQ(submitted, done);
  }
}

TEST(OpenClErrorTest, TellsLostDevicesFromWrongCalls)
{
  EXPECT_TRUE(OpenClError("x", CL_DEVICE_NOT_AVAILABLE).deviceLost());
  EXPECT_FALSE(OpenClError("x", CL_INVALID_KERNEL_ARGS).deviceLost());
  EXPECT_STREQ("x failed: CL_INVALID_VALUE (-30)", OpenClError("x", CL_INVALID_VALUE).what());
  EXPECT_STREQ("unknown OpenCL error", openClErrorName(-12345));
  EXPECT_NO_THROW(checkOpenCl(CL_SUCCESS, "x"));
  EXPECT_THROW(checkOpenCl(CL_INVALID_VALUE, "x"), OpenClError);
}

}  // namespace
}  // namespace pi_runtime
