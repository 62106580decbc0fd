#include <pi_runtime/buffer.h>

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <stdexcept>
#include <thread>

#include "fake_executor.h"
#include <pi_runtime/opencl.h>

namespace pi_runtime
{
namespace
{

/// A device's memory that counts what is moved and can break.
class FakeSpace : public MemorySpace
{
public:
  struct Bytes : Copy
  {
    std::vector<uint8_t> bytes;
    bool with_unit = false;
  };

  void upload(Copy& copy, const void* host, size_t bytes) override
  {
    if (broken)
    {
      throw OpenClError("upload", CL_DEVICE_NOT_AVAILABLE);
    }
    if (uploading != nullptr)
    {
      uploading->set();
      go_on->wait();
    }
    static_cast<Bytes&>(copy).bytes.assign(static_cast<const uint8_t*>(host),
                                           static_cast<const uint8_t*>(host) + bytes);
    ++uploads;
  }
  void download(Copy& copy, void* host, size_t bytes) override
  {
    if (broken)
    {
      throw OpenClError("download", CL_DEVICE_NOT_AVAILABLE);
    }
    std::memcpy(host, static_cast<Bytes&>(copy).bytes.data(), bytes);
    ++downloads;
  }
  void giveToUnit(Copy& copy) override { static_cast<Bytes&>(copy).with_unit = true; }
  void giveToHost(Copy& copy, size_t) override { static_cast<Bytes&>(copy).with_unit = false; }

  bool broken = false;
  int uploads = 0;
  int downloads = 0;
  Event* uploading = nullptr;
  Event* go_on = nullptr;
};

constexpr size_t BYTES = 8;

FakeSpace::Bytes& use(Buffer& buffer, const std::shared_ptr<FakeSpace>& space, Access access, size_t* moved)
{
  const auto make = [&]
  {
    auto copy = std::make_unique<FakeSpace::Bytes>();
    copy->bytes.assign(buffer.bytes(), 0xee);
    return copy;
  };
  return static_cast<FakeSpace::Bytes&>(buffer.copyIn(space, access, make, moved));
}

TEST(BufferTest, OwnMemoryIsZeroedAndBeginsAtAPage)
{
  const BufferPtr buffer = Buffer::allocate(5000);
  EXPECT_EQ(0u, reinterpret_cast<uintptr_t>(buffer->address()) % 4096);
  EXPECT_EQ(5000u, buffer->bytes());
  EXPECT_FALSE(buffer->readOnly());
  const uint8_t* const bytes = buffer->hostAs<uint8_t>(Access::READ);
  EXPECT_TRUE(std::all_of(bytes, bytes + 5000, [](uint8_t byte) { return byte == 0; }));
}

TEST(BufferTest, ImpossibleMemoryIsAnError)
{
  EXPECT_THROW(Buffer::allocate(0), std::invalid_argument);
  EXPECT_THROW(Buffer::allocate(SIZE_MAX - 5), std::bad_alloc);
  int value = 0;
  EXPECT_THROW(Buffer::wrap(&value, 0), std::invalid_argument);
  EXPECT_THROW(Buffer::wrap(static_cast<void*>(nullptr), 4), std::invalid_argument);
  EXPECT_THROW(Buffer::wrap(static_cast<const void*>(nullptr), 4), std::invalid_argument);
}

TEST(BufferTest, WrappedMemoryIsUsedInPlaceAndKeptAlive)
{
  auto owner = std::make_shared<std::vector<int>>(4, 7);
  const std::weak_ptr<std::vector<int>> alive = owner;
  BufferPtr buffer = Buffer::wrap(owner->data(), 16, owner);
  EXPECT_EQ(owner->data(), buffer->host(Access::READ_WRITE));
  owner.reset();
  EXPECT_FALSE(alive.expired());
  EXPECT_EQ(7, buffer->hostAs<int>(Access::READ)[3]);
  buffer.reset();
  EXPECT_TRUE(alive.expired());
  const int constant = 3;
  EXPECT_TRUE(Buffer::wrap(&constant, sizeof constant)->readOnly());
}

TEST(BufferTest, BytesMoveOnlyWhenTheyAreStale)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const auto space = std::make_shared<FakeSpace>();
  size_t moved = 0;
  use(*buffer, space, Access::READ, &moved);
  use(*buffer, space, Access::READ, &moved);
  EXPECT_EQ(BYTES, moved) << "once";
  buffer->host(Access::READ);
  use(*buffer, space, Access::READ, &moved);
  EXPECT_EQ(BYTES, moved) << "reading spoils nothing";
  buffer->host(Access::WRITE);
  use(*buffer, space, Access::READ, &moved);
  EXPECT_EQ(2 * BYTES, moved);
  use(*buffer, space, Access::WRITE, &moved);
  EXPECT_EQ(2 * BYTES, moved) << "what is overwritten is not moved";
  EXPECT_EQ(BYTES, buffer->bytesToMove(nullptr, Access::READ));
  EXPECT_EQ(0u, buffer->bytesToMove(nullptr, Access::WRITE));
  buffer->host(Access::READ);
  buffer->host(Access::READ);
  EXPECT_EQ(1, space->downloads);
}

TEST(BufferTest, EveryReaderSeesTheNewestContentAndTheForecastIsExact)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const std::shared_ptr<FakeSpace> spaces[] = {std::make_shared<FakeSpace>(), std::make_shared<FakeSpace>(),
                                               std::make_shared<FakeSpace>()};
  std::mt19937 random(1);
  uint8_t newest = 0;
  for (int step = 0; step < 5000; ++step)
  {
    const Access access = static_cast<Access>(random() % 3);
    const size_t where = random() % 4;
    uint8_t* bytes = nullptr;
    if (where == 3)
    {
      bytes = buffer->hostAs<uint8_t>(access);
      EXPECT_EQ(0u, buffer->bytesToMove(nullptr, access));
    }
    else
    {
      const size_t forecast = buffer->bytesToMove(spaces[where].get(), access);
      size_t moved = 0;
      FakeSpace::Bytes& copy = use(*buffer, spaces[where], access, &moved);
      EXPECT_EQ(forecast, moved);
      EXPECT_TRUE(copy.with_unit);
      bytes = copy.bytes.data();
    }
    if (reads(access))
    {
      ASSERT_EQ(newest, bytes[0]) << "step " << step;
      ASSERT_EQ(newest, bytes[BYTES - 1]);
    }
    if (writes(access))
    {
      std::memset(bytes, ++newest, BYTES);
    }
  }
}

TEST(BufferTest, TheOwnerOfTheMemoryIsToldOfEveryUse)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const auto space = std::make_shared<FakeSpace>();
  size_t moved = 0;
  FakeSpace::Bytes& copy = use(*buffer, space, Access::WRITE, &moved);
  for (const Access access : {Access::READ, Access::WRITE, Access::READ_WRITE})
  {
    EXPECT_TRUE(copy.with_unit);
    buffer->host(access);
    EXPECT_FALSE(copy.with_unit);
    use(*buffer, space, access, &moved);
  }
}

TEST(BufferTest, ContentThatABrokenUnitKeepsIsLostWithAReason)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const auto broken = std::make_shared<FakeSpace>();
  const auto healthy = std::make_shared<FakeSpace>();
  size_t moved = 0;
  use(*buffer, broken, Access::WRITE, &moved);
  broken->broken = true;
  try
  {
    use(*buffer, healthy, Access::READ, &moved);
    FAIL();
  }
  catch (const OpenClError&)
  {
    FAIL() << "that would take the healthy unit out";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("cannot be had")) << error.what();
  }
  EXPECT_THROW(buffer->host(Access::READ), std::runtime_error);
  std::memset(buffer->host(Access::WRITE), 5, BYTES);
  EXPECT_EQ(5, use(*buffer, healthy, Access::READ, &moved).bytes[0]) << "it can be written anew";
}

TEST(BufferTest, AFailedUploadIsTriedAgain)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const auto space = std::make_shared<FakeSpace>();
  size_t moved = 0;
  space->broken = true;
  EXPECT_THROW(use(*buffer, space, Access::READ, &moved), OpenClError);
  space->broken = false;
  EXPECT_EQ(0, use(*buffer, space, Access::READ, &moved).bytes[0]);
  EXPECT_EQ(BYTES, moved);
}

TEST(BufferTest, ForecastsDoNotWaitForTransfers)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  const auto space = std::make_shared<FakeSpace>();
  Event uploading;
  Event go_on;
  space->uploading = &uploading;
  space->go_on = &go_on;
  std::thread unit(
      [&]
      {
        size_t moved = 0;
        use(*buffer, space, Access::READ, &moved);
      });
  ASSERT_TRUE(uploading.wait());
  EXPECT_EQ(BYTES, buffer->bytesToMove(space.get(), Access::READ));
  go_on.set();
  unit.join();
  EXPECT_EQ(0u, buffer->bytesToMove(space.get(), Access::READ));
}

TEST(BufferTest, SharedViewsAreMadeOncePerContext)
{
  const BufferPtr buffer = Buffer::allocate(BYTES);
  int made = 0;
  const auto make = [&]
  {
    ++made;
    return std::make_unique<FakeSpace::Bytes>();
  };
  const int contexts[2] = {};
  MemorySpace::Copy& first = buffer->shared(&contexts[0], make);
  EXPECT_EQ(&first, &buffer->shared(&contexts[0], make));
  EXPECT_NE(&first, &buffer->shared(&contexts[1], make));
  EXPECT_EQ(2, made);
}

}  // namespace
}  // namespace pi_runtime
