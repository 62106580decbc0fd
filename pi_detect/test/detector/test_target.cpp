#include <gtest/gtest.h>
#include <pi_detect/target.h>

#include <stdexcept>

namespace pi_detect
{
namespace
{

TEST(Target, NamesAreReadBack)
{
  for (const Target target : {Target::CPU, Target::OPENCL, Target::OPENCL_FP16})
  {
    EXPECT_EQ(target, parseTarget(toString(target)));
  }
}

TEST(Target, AnUnknownNameIsRefusedWithTheValidOnes)
{
  try
  {
    parseTarget("cuda");
    FAIL() << "cuda was taken";
  }
  catch (const std::invalid_argument& error)
  {
    EXPECT_STREQ("target = \"cuda\", must be cpu, opencl or opencl_fp16", error.what());
  }
}

TEST(Target, TheCpuCanAlwaysBeHad)
{
  const TargetInUse target = findTarget(Target::CPU);
  EXPECT_EQ(Target::CPU, target.used);
  EXPECT_TRUE(target.reason.empty());
}

TEST(Target, WhatIsUsedInsteadIsSaidWithAReason)
{
  for (const Target requested : {Target::OPENCL, Target::OPENCL_FP16})
  {
    const TargetInUse target = findTarget(requested);
    EXPECT_EQ(requested, target.requested);
    EXPECT_EQ(target.used == requested, target.reason.empty()) << target.reason;
    EXPECT_EQ(target.used == Target::CPU, target.device.empty()) << target.device;
  }
}

}  // namespace
}  // namespace pi_detect
