#include "core/kept_buffers.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace pi_runtime
{
namespace
{

constexpr size_t LIMIT = 100000;

TEST(KeptBuffers, AreKnownOnceTheirDraftIsCommitted)
{
  KeptBuffers buffers(LIMIT);
  KeptBuffers::Draft draft(&buffers);
  const BufferPtr made = draft.make("image", 1000);
  EXPECT_EQ(1000u, made->bytes());
  EXPECT_FALSE(made->readOnly());
  EXPECT_EQ(made, draft.find("image"));
  EXPECT_EQ(nullptr, buffers.find("image"));
  draft.commit();
  EXPECT_EQ(made, buffers.find("image"));
  EXPECT_EQ(std::vector<std::string>{"image"}, buffers.names());
}

TEST(KeptBuffers, LeaveNoTraceOfADraftThatIsGivenUp)
{
  KeptBuffers buffers(LIMIT);
  {
    KeptBuffers::Draft draft(&buffers);
    draft.make("image", 1000);
    EXPECT_EQ(1000u, buffers.bytes());
  }
  EXPECT_EQ(0u, buffers.bytes());
  EXPECT_TRUE(buffers.names().empty());
}

TEST(KeptBuffers, AreFoundByLaterDrafts)
{
  KeptBuffers buffers(LIMIT);
  KeptBuffers::Draft first(&buffers);
  const BufferPtr made = first.make("image", 10);
  first.commit();
  KeptBuffers::Draft second(&buffers);
  EXPECT_EQ(made, second.find("image"));
  EXPECT_EQ(nullptr, second.find("other"));
}

TEST(KeptBuffers, GoOnForThoseWhoUseThemWhenDroppedOrReplaced)
{
  KeptBuffers buffers(LIMIT);
  KeptBuffers::Draft draft(&buffers);
  BufferPtr used = draft.make("image", 1000);
  draft.commit();
  draft.make("image", 500);
  draft.commit();
  EXPECT_EQ(1500u, buffers.bytes()) << "the old one is in use";
  static_cast<uint8_t*>(used->address())[999] = 7;
  used.reset();
  EXPECT_EQ(500u, buffers.bytes());
  EXPECT_EQ(500u, buffers.find("image")->bytes());
  EXPECT_TRUE(buffers.drop("image"));
  EXPECT_FALSE(buffers.drop("image"));
  EXPECT_EQ(0u, buffers.bytes());
}

TEST(KeptBuffers, RefuseWhatExceedsTheLimitAndNameIt)
{
  KeptBuffers buffers(LIMIT);
  KeptBuffers::Draft draft(&buffers);
  draft.make("a", LIMIT - 10);
  try
  {
    draft.make("b", 11);
    FAIL() << "11 bytes do not fit";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_STREQ(
        "buffer \"b\" of 11 bytes does not fit: 99990 of 100000 bytes for kept buffers are in use "
        "(max_kept_buffer_mb); drop some",
        error.what());
  }
  EXPECT_NE(nullptr, draft.make("b", 10));
}

TEST(KeptBuffers, RefuseEmptyOnes)
{
  KeptBuffers buffers(LIMIT);
  KeptBuffers::Draft draft(&buffers);
  EXPECT_THROW(draft.make("a", 0), std::invalid_argument);
  EXPECT_EQ(0u, buffers.bytes());
}

}  // namespace
}  // namespace pi_runtime
