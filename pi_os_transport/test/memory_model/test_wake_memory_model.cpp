#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "modelled_atomics.h"
#include "mutations.h"

#include "shm/wake_board.h"

namespace pi_os_transport
{
namespace
{

using weak_memory::Model;
using weak_memory::NamedProgram;

constexpr uint32_t LINKS = 2;  // in one word of the board: one may be found by a look that is due to the other

Model& model()
{
  return Model::instance();
}

/// The boards of two processes, and one message in each of two links.
struct World
{
  World()
  {
    model().name(&news->summary, "summary");
    model().name(&news->links[0], "links");
    model().name(&place->asleep, "asleep");
    model().name(&place->bell, "bell");
  }
  void reset()
  {
    news->summary = 0;
    news->links[0] = 0;
    place->asleep = 0;
    place->bell = 0;
    network_rung = false;
    taken = 0;
  }
  /// The sender: a message in link `index`.
  void send(uint32_t index)
  {
    model().writePlain(&messages[index]);
    if (board.add(index))
    {
      if (sleeper.ring() != nullptr)
      {
        model().ring(&doorbell);
      }
      else
      {
        network_rung = true;  // that thread then takes what is there
      }
    }
  }
  void take()
  {
    board.take(
        [this](uint32_t link)
        {
          model().readPlain(&messages[link]);
          ++taken;
        });
  }

  ::std::unique_ptr<NewsLayout> news{new NewsLayout{}};
  ::std::unique_ptr<WakeLayout::Sleeper> place{new WakeLayout::Sleeper{}};
  NewsBoard board{news.get()};
  Sleeper sleeper{place.get()};
  char messages[LINKS] = {};
  char doorbell = 0;
  bool network_rung = false;
  uint32_t taken = 0;
};

World& world()
{
  static World* world = new World;
  return *world;
}

::std::vector<NamedProgram> programs()
{
  World& w = world();
  ::std::vector<NamedProgram> all;
  all.push_back({"a thread sleeps until there is news, and leaves none without somebody who was told",
                 {[&w] { w.reset(); },
                  {[&w]
                   {
                     w.send(0);
                     w.send(1);
                   },
                   [&w]
                   {
                     w.sleeper.prepare();
                     if (!w.board.any())
                     {
                       model().awaitRing(&w.doorbell);
                     }
                     w.sleeper.wakeUp();
                     w.take();  // then it runs callbacks
                   }},
                  [&w] { model().require(w.taken == LINKS || w.network_rung, "nobody knows of a message"); }}});

  all.push_back({"two threads look for news at a time, and each is found once",
                 {[&w] { w.reset(); },
                  {[&w]
                   {
                     w.send(0);
                     w.send(1);
                   },
                   [&w] { w.take(); }, [&w] { w.take(); }},
                  [&w]
                  {
                    w.take();
                    model().require(w.taken == LINKS, "news is lost or found twice");
                  }}});
  return all;
}

/// Orders that the programs above do not need, and why they stay.
const ::std::map<::std::string, const char*> STRONGER_THAN_NEEDED = {
    {"take: summary.exchange acquire -> relaxed",
     "the model executes the exchanges of a thread in order; a machine may do the one of the links first"},
};

TEST(WakeMemoryModel, EveryExecutionHolds)
{
  weak_memory::expectAllHold(programs());
}

TEST(WakeMemoryModel, EveryOrderIsNeeded)
{
  weak_memory::expectEveryOrderNeeded(programs(), STRONGER_THAN_NEEDED, 7);
}

}  // namespace
}  // namespace pi_os_transport
