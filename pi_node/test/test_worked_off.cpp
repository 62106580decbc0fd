#include <gtest/gtest.h>
#include <pi_node/worked_off.h>

namespace pi_node
{
namespace
{

TEST(WorkedOff, WhatIsLeftOutIsWorkedOffWithWhatWasTakenBefore)
{
  WorkedOff inputs;
  EXPECT_EQ(10, inputs.leftOut(10)) << "nothing was taken before";
  inputs.taken(20);
  EXPECT_FALSE(inputs.leftOut(30));
  EXPECT_FALSE(inputs.leftOut(40));
  EXPECT_EQ(40, inputs.workedOff(20));
  EXPECT_EQ(50, inputs.leftOut(50)) << "nothing is in work";
}

TEST(WorkedOff, WhatWaitsIsNotWorkedOffWithTheOneBefore)
{
  WorkedOff inputs;
  inputs.taken(20);
  EXPECT_FALSE(inputs.leftOut(30));
  inputs.taken(40);
  EXPECT_FALSE(inputs.leftOut(50));
  EXPECT_EQ(20, inputs.workedOff(20));
  EXPECT_FALSE(inputs.leftOut(60));
  EXPECT_EQ(60, inputs.workedOff(40));
}

TEST(WorkedOff, TimeMayJumpBack)
{
  WorkedOff inputs;
  inputs.taken(200);
  EXPECT_FALSE(inputs.leftOut(210));
  inputs.taken(20);
  EXPECT_EQ(200, inputs.workedOff(200));
  EXPECT_EQ(20, inputs.workedOff(20)) << "what was left out before the jump does not count";
}

TEST(WorkedOff, WhoLeavesNothingOutAnswersWhatHeWorkedOff)
{
  WorkedOff inputs;
  EXPECT_EQ(20, inputs.workedOff(20));
  EXPECT_EQ(30, inputs.workedOff(30));
}

}  // namespace
}  // namespace pi_node
