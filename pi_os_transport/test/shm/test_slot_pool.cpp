#include "shm/slot_pool.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <map>
#include <random>
#include <thread>
#include <vector>

#include "shm/shared_memory.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t MIB = 1 << 20;

TEST(SlotPool, PayloadAfterALengthPrefixIsAligned)
{
  SlotPool pool(16 * MIB);
  for (size_t bytes : {0, 1, 4, 60, 61, 1000, 100000})
  {
    const uint8_t* payload = pool.allocate(bytes);
    ASSERT_NE(nullptr, payload);
    EXPECT_EQ(0U, reinterpret_cast<uintptr_t>(payload + 4) % 64) << bytes;
    EXPECT_TRUE(pool.contains(payload));
    pool.release(payload);
  }
}

TEST(SlotPool, KnowsItsOwnAddresses)
{
  SlotPool pool(MIB);
  int elsewhere = 0;
  EXPECT_FALSE(pool.contains(&elsewhere));
  EXPECT_FALSE(pool.contains(nullptr));
  EXPECT_FALSE(pool.contains(pool.base() + pool.reserved()));
}

TEST(SlotPool, AMessageMayStartAnywhereInItsMemory)
{
  SlotPool pool(16 * MIB);
  constexpr size_t BYTES = 4000;
  for (size_t start = 0; start < 700; ++start)
  {
    uint8_t* const payload = pool.allocate(BYTES);
    ASSERT_GE(pool.capacity(payload), BYTES);
    uint8_t* const message = payload + start;
    pool.place(payload, message);
    std::memset(message, 0x5a, BYTES - start);
    ASSERT_EQ(pool.locate(payload).segment, pool.locate(message).segment);
    ASSERT_EQ(pool.locate(payload).offset + start, pool.locate(message).offset);
    pool.addReference(message);
    pool.release(payload);
    ASSERT_EQ(1U, pool.usage().live_slots) << start;
    pool.release(message);
    ASSERT_EQ(0U, pool.usage().live_slots) << start;
  }
  const uint8_t* const again = pool.allocate(BYTES);
  EXPECT_EQ(0U, reinterpret_cast<uintptr_t>(again + 4) % 64) << "the slot itself has not moved";
}

TEST(SlotPool, ReadersSeeTheBytesReadOnly)
{
  SlotPool pool(16 * MIB);
  uint8_t* payload = pool.allocate(5000);
  std::memset(payload, 0x5a, 5000);
  const SlotPool::Location location = pool.locate(payload);
  const SlotPool::Segment segment = pool.segment(location.segment);
  ASSERT_GE(segment.fd, 0);
  void* mapping = mmap(nullptr, segment.length, PROT_READ, MAP_SHARED, segment.fd, 0);
  ASSERT_NE(MAP_FAILED, mapping);
  EXPECT_EQ(0, std::memcmp(static_cast<uint8_t*>(mapping) + location.offset, payload, 5000));
  EXPECT_NE(0, mprotect(mapping, segment.length, PROT_READ | PROT_WRITE)) << "the kernel lets readers write";
  EXPECT_EQ(MAP_FAILED, mmap(nullptr, segment.length, PROT_READ | PROT_WRITE, MAP_SHARED, segment.fd, 0));
  EXPECT_NE(0, ftruncate(segment.fd, 0)) << "readers could be made to crash";
  munmap(mapping, segment.length);
  pool.release(payload);
}

TEST(SlotPool, ReusesTheSlotThatWasFreedLast)
{
  SlotPool pool(16 * MIB);
  const uint8_t* first = pool.allocate(1000);
  pool.release(first);
  EXPECT_EQ(first, pool.allocate(1000));
}

TEST(SlotPool, KeepsASlotUntilTheLastReferenceIsGone)
{
  SlotPool pool(16 * MIB);
  const uint8_t* payload = pool.allocate(1000);
  pool.addReference(payload);
  pool.release(payload);
  EXPECT_NE(payload, pool.allocate(1000));
  EXPECT_EQ(2U, pool.usage().live_slots);
  pool.release(payload);
  EXPECT_EQ(payload, pool.allocate(1000));
}

TEST(SlotPool, AsksForReleasedSlotsBeforeItGrows)
{
  SlotPool pool(16 * MIB);
  const uint8_t* held = pool.allocate(3 * MIB);
  const uint64_t before = pool.usage().committed;
  int asked = 0;
  pool.setReclaim(
      [&]()
      {
        ++asked;
        pool.release(held);
      });
  EXPECT_EQ(held, pool.allocate(3 * MIB));
  EXPECT_EQ(1, asked);
  EXPECT_EQ(before, pool.usage().committed);
}

TEST(SlotPool, RefusesBeyondItsLimitAndSaysSo)
{
  SlotPool pool(4 * MIB);
  std::vector<const uint8_t*> held;
  while (const uint8_t* payload = pool.allocate(MIB - 4096))
  {
    held.push_back(payload);
  }
  EXPECT_GE(held.size(), 3U);
  EXPECT_LE(pool.usage().committed, 4 * MIB);
  EXPECT_NE(std::string::npos, pool.lastError().find("pool limit of 4194304 bytes")) << pool.lastError();
  EXPECT_EQ(nullptr, pool.allocate(5 * MIB));
  EXPECT_NE(std::string::npos, pool.lastError().find("a message of 5242880 bytes")) << pool.lastError();
  pool.release(held.back());
  EXPECT_NE(nullptr, pool.allocate(MIB - 4096));
}

TEST(SlotPool, MakesRoomForOtherSizesOutOfIdleMemory)
{
  SlotPool pool(8 * MIB);
  for (int round = 0; round < 20; ++round)
  {
    for (uint64_t size : {6 * MIB, 3 * MIB, MIB, MIB / 4})
    {
      const uint8_t* payload = pool.allocate(size);
      ASSERT_NE(nullptr, payload) << pool.lastError();
      pool.release(payload);
    }
  }
  EXPECT_LE(pool.usage().committed, 8 * MIB);
}

TEST(SlotPool, TrimGivesIdleSegmentsBackAndReportsThem)
{
  SlotPool pool(64 * MIB);
  const uint8_t* idle = pool.allocate(8 * MIB);
  const uint8_t* used = pool.allocate(100);
  const uint32_t segment = pool.locate(idle).segment;
  pool.release(idle);
  pool.trim();
  EXPECT_LT(pool.usage().committed, MIB);
  EXPECT_EQ(std::vector<uint32_t>{segment}, pool.takeRetired());
  EXPECT_TRUE(pool.takeRetired().empty());
  EXPECT_EQ(-1, pool.segment(segment).fd);
  pool.release(used);
}

TEST(SlotPool, SteadyLargeMessagesNeedFewSegments)
{
  SlotPool pool(512 * MIB);
  std::vector<const uint8_t*> held;
  for (int i = 0; i < 64; ++i)
  {
    held.push_back(pool.allocate(MIB));
    ASSERT_NE(nullptr, held.back());
  }
  EXPECT_LE(pool.usage().segments, 16U);
  EXPECT_LE(pool.usage().committed, 128 * MIB);
}

TEST(SlotPool, StaysWholeUnderRandomUseByManyThreads)
{
  SlotPool pool(64 * MIB);
  const auto work = [&pool](unsigned seed)
  {
    std::mt19937 random(seed);
    std::map<uint8_t*, std::pair<size_t, uint8_t>> live;
    for (int i = 0; i < 20000; ++i)
    {
      if (live.size() < 8 && random() % 2 == 0)
      {
        const size_t bytes = size_t{1} << (random() % 19);
        uint8_t* payload = pool.allocate(bytes);
        ASSERT_NE(nullptr, payload);
        const uint8_t mark = static_cast<uint8_t>(random());
        payload[0] = payload[bytes - 1] = mark;
        live[payload] = {bytes, mark};
      }
      else if (!live.empty())
      {
        const auto entry = std::next(live.begin(), static_cast<std::ptrdiff_t>(random() % live.size()));
        ASSERT_EQ(entry->second.second, entry->first[0]);
        ASSERT_EQ(entry->second.second, entry->first[entry->second.first - 1]);
        pool.release(entry->first);
        live.erase(entry);
      }
    }
    for (const auto& entry : live)
    {
      pool.release(entry.first);
    }
  };
  std::thread first(work, 1);
  std::thread second(work, 2);
  work(3);
  first.join();
  second.join();
  EXPECT_EQ(0U, pool.usage().live_slots);
}

/// Runs `body` in a child process and returns its exit status.
template <typename Body>
int inChild(Body body)
{
  const pid_t child = fork();
  if (child == 0)
  {
    _exit(body());
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

TEST(SlotPool, ForkedChildLeavesThePoolAlone)
{
  SlotPool pool(16 * MIB);
  uint8_t* payload = pool.allocate(1000);
  EXPECT_EQ(0, inChild(
                   [&]()
                   {
                     pool.release(payload);
                     return pool.allocate(1000) == nullptr ? 0 : 1;
                   }));
  EXPECT_EQ(1U, pool.usage().live_slots);
  EXPECT_NE(payload, pool.allocate(1000)) << "the child freed memory that the parent uses";
}

TEST(SlotPool, FileSizeLimitIsAnErrorAndNotASignal)
{
  EXPECT_EQ(
      0, inChild(
             []()
             {
               const rlimit limit{1000, 1000};
               setrlimit(RLIMIT_FSIZE, &limit);
               std::string error;
               return !makeSharedMemory("pi_os_test", 4096, &error) && error.find("ulimit -f") != std::string::npos ? 0
                                                                                                                    : 1;
             }));
}

TEST(SlotPool, WithoutAddressSpaceEveryAllocationFails)
{
  EXPECT_EQ(0, inChild(
                   []()
                   {
                     const rlimit limit{uint64_t{1} << 30, uint64_t{1} << 30};
                     setrlimit(RLIMIT_AS, &limit);
                     SlotPool pool(uint64_t{64} << 30);
                     return !pool.contains(&pool) && !pool.contains(nullptr) && pool.allocate(1) == nullptr &&
                                    pool.lastError().find("address space") != std::string::npos
                                ? 0
                                : 1;
                   }));
}

}  // namespace
}  // namespace pi_os_transport
