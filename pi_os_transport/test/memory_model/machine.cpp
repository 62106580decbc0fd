#include "machine.h"

namespace weak_memory
{
namespace
{
constexpr uint64_t MOST_STEPS = 2000;  // of one execution; more is a loop that never ends
Model::Body* entering_body = nullptr;
}  // namespace

void Model::Machine::enter()
{
  Machine& machine = *instance().machine_;
  Body& body = *entering_body;
  body();
  machine.self().finished = true;
  for (;;)
  {
    machine.yieldToScheduler();
  }
}

void Model::Machine::execute(const Program& program)
{
  locations.clear();
  location_ids.clear();
  plain.clear();
  mutexes.clear();
  bells.clear();
  depth = 0;
  steps = 0;
  spurious_failure_left = true;
  log.clear();
  concurrent = false;
  program.prepare();
  threads.resize(program.threads.size());
  for (size_t i = 0; i < threads.size(); ++i)
  {
    if (!threads[i])
    {
      threads[i] = std::make_unique<Thread>();
    }
    Thread& thread = *threads[i];
    thread.body = program.threads[i];
    thread.current = thread.after_acquire_fence = thread.at_release_fence = View{};
    thread.finished = false;
    thread.waits_for = nullptr;
    thread.history = 0;
    getcontext(&thread.context);
    thread.context.uc_stack.ss_sp = thread.stack.data();
    thread.context.uc_stack.ss_size = thread.stack.size();
    thread.context.uc_link = nullptr;
    makecontext(&thread.context, &Machine::enter, 0);
  }
  concurrent = true;
  while (failure.empty())
  {
    std::array<size_t, MAX_THREADS> ready{};
    uint32_t count = 0;
    bool all_finished = true;
    for (size_t i = 0; i < threads.size(); ++i)
    {
      all_finished = all_finished && threads[i]->finished;
      if (!threads[i]->finished && (!threads[i]->waits_for || threads[i]->waits_for()))
      {
        ready[count++] = i;
      }
    }
    if (all_finished)
    {
      break;
    }
    if (count == 0)
    {
      fail("a thread waits for ever");
      break;
    }
    if (++steps > MOST_STEPS)
    {
      fail("an execution without end");
      break;
    }
    if (!replays && depth == trail.size() && !visited.insert(hashOfState()).second)
    {
      concurrent = false;
      return;  // what follows from here has been seen
    }
    running = ready[choose(count)];
    self().waits_for = nullptr;
    observe(4);  // that it ran, whatever it saw
    entering_body = &self().body;
    swapcontext(&scheduler, &self().context);
  }
  if (failure.empty())
  {
    // The end knows everything: the newest values become plain ones.
    for (const Location& location : locations)
    {
      *location.raw = location.messages.back().value;
    }
    concurrent = false;
    program.finish();
  }
  concurrent = false;
}

}  // namespace weak_memory
