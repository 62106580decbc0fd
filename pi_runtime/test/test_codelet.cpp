#include <pi_runtime/codelet.h>

#include <gtest/gtest.h>

#include <pi_runtime/opencl_command.h>

namespace pi_runtime
{
namespace
{

Codelet valid()
{
  Codelet codelet;
  codelet.name = "blur";
  codelet.native = {{[](const NativeCall&) {}}};
  codelet.opencl = {singleKernel("kernel void f() {}", "f", 1)};
  return codelet;
}

/// What validate() says of a codelet with one thing wrong.
std::string complaint(const std::function<void(Codelet&)>& spoil)
{
  Codelet codelet = valid();
  spoil(codelet);
  try
  {
    makeCodelet(codelet);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(CodeletTest, AnyOneImplementationIsEnough)
{
  EXPECT_EQ("", complaint([](Codelet&) {}));
  EXPECT_EQ("", complaint([](Codelet& codelet) { codelet.native.clear(); }));
  EXPECT_EQ("", complaint([](Codelet& codelet) { codelet.opencl.clear(); }));
}

TEST(CodeletTest, WhatIsWrongIsNamed)
{
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.name.clear(); }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.name = "two words"; }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.name = "a,b"; }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.name = "line\n"; }));
  EXPECT_EQ("Codelet blur: has no implementation; give a native or an OpenCL one", complaint(
                                                                                       [](Codelet& codelet)
                                                                                       {
                                                                                         codelet.native.clear();
                                                                                         codelet.opencl.clear();
                                                                                       }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.native.push_back(codelet.native[0]); }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.opencl.push_back(codelet.opencl[0]); }));
  EXPECT_EQ("Codelet blur: native.function is empty",
            complaint([](Codelet& codelet) { codelet.native[0].function = nullptr; }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.native[0].unit_types = 8; }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.opencl[0].source.clear(); }));
  EXPECT_NE("", complaint([](Codelet& codelet) { codelet.opencl[0].function = nullptr; }));
  EXPECT_EQ("Codelet blur: slice_granularity = 0, must be at least 1",
            complaint([](Codelet& codelet) { codelet.slice_granularity = 0; }));
}

TEST(ArgumentTest, ReadOnlyMemoryCannotBeWritten)
{
  const int constant = 7;
  const BufferPtr buffer = Buffer::wrap(&constant, sizeof constant);
  EXPECT_NO_THROW(Argument::in(buffer));
  EXPECT_THROW(Argument::out(buffer), std::invalid_argument);
  EXPECT_THROW(Argument::inOut(buffer), std::invalid_argument);
  EXPECT_THROW(Argument::in(nullptr), std::invalid_argument);
}

TEST(ArgumentTest, ValuesHaveALimitedSize)
{
  const std::array<uint8_t, 64> bytes{};
  EXPECT_NO_THROW(Argument::bytes(bytes.data(), Argument::MAX_VALUE_BYTES));
  EXPECT_THROW(Argument::bytes(bytes.data(), Argument::MAX_VALUE_BYTES + 1), std::invalid_argument);
  EXPECT_THROW(Argument::bytes(bytes.data(), 0), std::invalid_argument);
}

TEST(TaskArgumentsTest, AreReadAsWhatTheyAre)
{
  const std::vector<Argument> arguments = {Argument::value(2.5f), Argument::inOut(Buffer::allocate(12))};
  const NativeCall call(arguments, 3, 5, 9, nullptr);
  EXPECT_EQ(2u, call.size());
  EXPECT_EQ(2.5f, call.value<float>(0));
  EXPECT_EQ(12u, call.bufferBytes(1));
  EXPECT_EQ(call.buffer<void>(1), arguments[1].buffer()->address());
  EXPECT_EQ(3u, call.begin());
  EXPECT_EQ(5u, call.end());
  EXPECT_EQ(9u, call.range());
  EXPECT_FALSE(call.cancelled());
  EXPECT_THROW(call.value<double>(0), std::invalid_argument) << "another size";
  EXPECT_THROW(call.value<float>(1), std::invalid_argument) << "a buffer";
  EXPECT_THROW(call.buffer<float>(0), std::invalid_argument) << "a value";
  EXPECT_THROW(call.buffer<float>(2), std::out_of_range);
}

TEST(TaskArgumentsTest, ACallSeesItsCancellation)
{
  const std::vector<Argument> none;
  std::atomic<bool> cancelled{false};
  const NativeCall call(none, 0, 1, 1, &cancelled);
  EXPECT_FALSE(call.cancelled());
  cancelled = true;
  EXPECT_TRUE(call.cancelled());
}

}  // namespace
}  // namespace pi_runtime
