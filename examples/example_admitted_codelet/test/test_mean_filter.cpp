#include "../src/mean_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

using namespace pi_runtime;

TEST(MeanFilter, IsTheSameOnEveryUnit)
{
  constexpr uint64_t COUNT = 128;
  const BufferPtr samples = Buffer::allocate(COUNT * sizeof(float));
  const BufferPtr means = Buffer::allocate(COUNT * sizeof(float));
  float* const values = samples->hostAs<float>(Access::WRITE);
  std::fill_n(values, COUNT, 3.0F);
  values[1] = 6.0F;
  values[COUNT - 1] = 9.0F;
  Runtime runtime;
  for (const TaskResult& result : runtime.calibrate(meanFilterTask(samples, means, COUNT), 1))
  {
    ASSERT_TRUE(result.ok()) << result.message;
    const float* const found = means->hostAs<float>(Access::READ);
    EXPECT_FLOAT_EQ(4.0F, found[0]) << result.unit << " by " << result.executor;
    EXPECT_FLOAT_EQ(4.0F, found[1]);
    EXPECT_FLOAT_EQ(3.0F, found[64]);
    EXPECT_FLOAT_EQ(5.0F, found[COUNT - 2]);
    EXPECT_FLOAT_EQ(7.0F, found[COUNT - 1]);
  }
}

TEST(MeanFilter, IsAdmittedAsAStream)
{
  const BufferPtr samples = Buffer::allocate(1024 * sizeof(float));
  const BufferPtr means = Buffer::allocate(1024 * sizeof(float));
  Runtime runtime;
  TaskRequest task = meanFilterTask(samples, means, 1024);
  runtime.calibrate(task);
  StreamRequest request;
  request.name = "mean_filter";
  request.codelet = task.codelet;
  request.period = std::chrono::seconds(1);  // fits on any computer
  const Admission admission = runtime.admit(request);
  ASSERT_TRUE(admission.admitted()) << admission.reason;
  task.stream = admission.id;
  EXPECT_TRUE(runtime.submit(task).wait().ok());
}
