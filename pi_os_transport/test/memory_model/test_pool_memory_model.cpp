#include <gtest/gtest.h>
#include <pthread.h>
#include <sys/mman.h>

#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "modelled_atomics.h"
#include "mutations.h"

#include "shm/slot_pool.cpp"  // NOLINT: its functions have to be those of the model

namespace pi_os_transport
{
namespace
{

using weak_memory::Model;
using weak_memory::NamedProgram;

constexpr size_t MESSAGE_BYTES = 60000;  // two do not fit into the first segment

/// A pool with one message, which two readers hold.
struct World
{
  void reset()
  {
    pool.reset();
    pool = ::std::make_unique<SlotPool>(1 << 16);
    message = pool->allocate(MESSAGE_BYTES);
    pool->addReference(message);
    Model::instance().name(message - 60, "references");  // the slot's header begins there
    Model::instance().name(message, "payload");
    again = nullptr;
  }
  void readAndRelease()
  {
    Model::instance().readPlain(message);
    pool->release(message);
  }

  ::std::unique_ptr<SlotPool> pool;
  uint8_t* message = nullptr;
  uint8_t* again = nullptr;
};

World& world()
{
  static World* world = new World;
  return *world;
}

::std::vector<NamedProgram> programs()
{
  World& w = world();
  return {{"a slot is used again only when its last reader has read",
           {[&w] { w.reset(); },
            {[&w] { w.readAndRelease(); }, [&w] { w.readAndRelease(); },
             [&w]
             {
               w.again = w.pool->allocate(MESSAGE_BYTES);
               if (w.again != nullptr)
               {
                 Model::instance().require(w.again == w.message, "there is room for one message only");
                 Model::instance().writePlain(w.again);
               }
             }},
            [&w]
            {
              Model::instance().require(w.pool->usage().live_slots == (w.again != nullptr ? 1U : 0U),
                                        "a slot is lost or given back twice");
            }}}};
}

TEST(PoolMemoryModel, EveryExecutionHolds)
{
  weak_memory::expectAllHold(programs());
}

TEST(PoolMemoryModel, EveryOrderIsNeeded)
{
  weak_memory::expectEveryOrderNeeded(programs(), {}, 2);
}

}  // namespace
}  // namespace pi_os_transport
