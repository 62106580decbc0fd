#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "modelled_ring.h"
#include "mutations.h"
#include "weak_memory.h"

namespace pi_os_transport
{
namespace
{

using weak_memory::Model;
using weak_memory::NamedProgram;

constexpr uint32_t CAPACITY_ = RingLayout::CAPACITY;

Model& model()
{
  return Model::instance();
}

/// A ring, both its ends, and the payload of each place. Message n says n in all its fields.
class World
{
public:
  World()
  {
    nameLocations();
    reset();
  }

  void reset()
  {
    layout->~RingLayout();
    new (layout.get()) RingLayout{};
    producer = RingProducer(layout.get(), 42);
    consumer = RingConsumer(layout.get());
    taken = dropped = 0;
    next_number = 0;
    last_taken = -1;
  }

  /// Sequential: `untaken` messages wait in the ring, behind `leased` that are taken and not released.
  void fill(uint32_t leased, uint32_t untaken)
  {
    uint32_t doorbell = 0;
    for (uint32_t i = 0; i < leased + untaken; ++i)
    {
      producer.push(numbered(next_number++), &doorbell);
    }
    Descriptor descriptor;
    uint32_t place = 0;
    for (uint32_t i = 0; i < leased; ++i)
    {
      consumer.take(0, true, &descriptor, &place);
      last_taken = static_cast<int64_t>(descriptor.serial);
    }
  }

  static Descriptor numbered(uint32_t number)
  {
    Descriptor descriptor;
    descriptor.segment = number + 1;
    descriptor.length = number;
    descriptor.offset = uint64_t{4} * number;
    descriptor.after_tcp = 0;
    descriptor.serial = number;
    return descriptor;
  }

  /// Writes the payload of the place that the next message takes, and the message.
  /// @return false if the ring is full.
  bool push()
  {
    const uint32_t place = next_number % CAPACITY_;
    if (producer.isHeld(place))
    {
      return false;
    }
    model().writePlain(&payloads[place]);
    uint32_t doorbell = 0;
    if (producer.push(numbered(next_number), &doorbell) == RingProducer::Push::FULL)
    {
      return false;
    }
    ++next_number;
    if (doorbell != 0)
    {
      model().ring(&bell);
    }
    return true;
  }

  /// Takes, checks and reads one message, if there is one.
  /// @return its place, or -1.
  int take()
  {
    Descriptor descriptor;
    uint32_t place = 0;
    if (consumer.take(0, true, &descriptor, &place) != RingConsumer::Take::TAKEN)
    {
      model().require(!consumer.broken(), "the ring passes for broken");
      return -1;
    }
    const uint32_t number = descriptor.length;
    model().require(
        descriptor.segment == number + 1 && descriptor.offset == uint64_t{4} * number && descriptor.serial == number,
        "a descriptor is put together from two messages");
    model().require(place == number % CAPACITY_, "a message comes from the place of another one");
    model().require(static_cast<int64_t>(number) > last_taken, "a message comes twice or out of order");
    last_taken = number;
    ++taken;
    model().readPlain(&payloads[place]);
    return static_cast<int>(place);
  }

  bool drop()
  {
    const int place = producer.dropOldest();
    if (place < 0)
    {
      return false;
    }
    ++dropped;
    return true;
  }

  ::std::unique_ptr<RingLayout> layout{new RingLayout{}};
  RingProducer producer{layout.get(), 42};
  RingConsumer consumer{layout.get()};
  ::std::array<char, CAPACITY_> payloads{};
  char bell = 0;
  uint32_t next_number = 0;
  int64_t last_taken = -1;
  uint32_t taken = 0;
  uint32_t dropped = 0;

private:
  void nameLocations()
  {
    model().name(&layout->tail, "tail");
    model().name(&layout->head, "head");
    model().name(&layout->armed, "armed");
    model().name(&layout->release_count, "release_count");
    for (uint32_t i = 0; i < CAPACITY_; ++i)
    {
      model().name(&layout->released[i], "released");
      model().name(&layout->entries[i].segment_length, "segment_length");
      model().name(&layout->entries[i].offset_after, "offset_after");
      model().name(&layout->entries[i].serial, "serial");
      model().name(&payloads[i], "payload");
    }
  }
};

World& world()
{
  static World* world = new World;
  return *world;
}

/// What two processes do at a time to one ring. Small, and each in all its executions.
::std::vector<NamedProgram> programs()
{
  World& w = world();
  ::std::vector<NamedProgram> all;

  all.push_back({"a subscriber sleeps until the doorbell rings and misses nothing",
                 {[&w] { w.reset(); },
                  {[&w]
                   {
                     w.push();
                     w.push();
                   },
                   [&w]
                   {
                     while (w.taken < 2)
                     {
                       if (w.take() < 0)
                       {
                         model().awaitRing(&w.bell);
                       }
                     }
                   }},
                  [&w] { model().require(w.taken == 2, "a message is lost"); }}});

  // Every field of the ring is used again here, so the publisher overwrites what the subscriber looks at.
  all.push_back({"the oldest of a full ring is dropped and its place used again while the subscriber takes it",
                 {[&w]
                  {
                    w.reset();
                    w.fill(0, CAPACITY_);
                  },
                  {[&w]
                   {
                     if (w.drop())
                     {
                       w.push();
                     }
                   },
                   [&w]
                   {
                     w.take();
                     w.take();
                   }},
                  [&w]
                  {
                    const uint32_t in_flight = w.producer.inFlight();
                    model().require(w.taken + w.dropped + in_flight == w.next_number,
                                    "a message is lost or comes twice");
                    model().require(w.taken == 2, "a message that was there is not taken");
                  }}});

  // Bridges decide by what they see before they take it.
  all.push_back({"what the subscriber sees of the oldest message belongs to it, taken or not",
                 {[&w]
                  {
                    w.reset();
                    w.fill(0, CAPACITY_);
                  },
                  {[&w]
                   {
                     if (w.drop())
                     {
                       w.push();
                     }
                   },
                   [&w]
                   {
                     Descriptor descriptor;
                     uint32_t index = 0;
                     model().require(w.consumer.peek(&descriptor, &index), "the ring passes for empty");
                     model().require(descriptor.length == index && descriptor.segment == index + 1 &&
                                         descriptor.offset == uint64_t{4} * index && descriptor.serial == index,
                                     "what is seen is put together from two messages");
                   }},
                  [] {}}});

  all.push_back({"a place is used again as soon as its message is released",
                 {[&w]
                  {
                    w.reset();
                    w.fill(CAPACITY_, 0);
                    for (uint32_t place = 1; place < CAPACITY_; ++place)
                    {
                      w.consumer.release(place);
                    }
                    w.producer.collect([](uint32_t) {});
                  },
                  {[&w]
                   {
                     w.producer.collect([](uint32_t) {});
                     w.push();
                   },
                   [&w]
                   {
                     model().readPlain(&w.payloads[0]);
                     w.consumer.release(0);
                     const int place = w.take();
                     if (place >= 0)
                     {
                       w.consumer.release(static_cast<uint32_t>(place));
                     }
                   }},
                  [&w]
                  {
                    w.take();
                    w.producer.collect([](uint32_t) {});
                    model().require(w.taken == w.next_number - CAPACITY_, "a message is lost");
                    model().require(w.producer.idle() || w.taken == 1, "a release is lost");
                  }}});

  all.push_back({"two threads of the subscriber release at a time",
                 {[&w]
                  {
                    w.reset();
                    w.fill(2, 0);
                  },
                  {[&w]
                   {
                     for (int i = 0; i < 2; ++i)
                     {
                       w.producer.collect([&w](uint32_t place) { model().writePlain(&w.payloads[place]); });
                     }
                   },
                   [&w]
                   {
                     model().readPlain(&w.payloads[0]);
                     w.consumer.release(0);
                   },
                   [&w]
                   {
                     model().readPlain(&w.payloads[1]);
                     w.consumer.release(1);
                   }},
                  [&w]
                  {
                    w.producer.collect([](uint32_t) {});
                    model().require(w.producer.idle(), "a release is lost");
                  }}});
  return all;
}

/// Orders that the programs above do not need, and why they stay. On x86-64 none of them costs anything, on ARM an
/// instruction of another kind, but not one more.
const ::std::map<::std::string, const char*> STRONGER_THAN_NEEDED = {
    {"push: armed.exchange seq_cst -> acq_rel",
     "the load in front of it is what the subscriber's sleep is ordered with"},
    {"peek: head.load acquire -> relaxed", "the tail that is read next brings everything with it"},
    {"dropOldest: head.load acquire -> relaxed", "a stale head only makes the exchange fail"},
    {"dropOldest: head.compare_exchange acq_rel -> acquire", "who wins is all that counts, not what the loser sees"},
    {"dropOldest: head.compare_exchange acq_rel -> release", "a message that was dropped has no reader"},
    {"takePeeked: head.compare_exchange acq_rel -> acquire", "what the subscriber has read counts from its release"},
    {"takePeeked: head.compare_exchange acq_rel -> release", "the message came with the tail"},
};

TEST(RingMemoryModel, EveryExecutionHolds)
{
  weak_memory::expectAllHold(programs());
}

TEST(RingMemoryModel, EveryOrderIsNeeded)
{
  weak_memory::expectEveryOrderNeeded(programs(), STRONGER_THAN_NEEDED, 10);
}

}  // namespace
}  // namespace pi_os_transport
