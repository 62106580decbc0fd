#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <queue>
#include <random>
#include <set>

#include "server/admission.h"

using namespace pi_offload;

namespace
{

constexpr int64_t MS = 1000000;
constexpr int64_t SECOND = 1000000000;

AdmissionOptions oneWorker()
{
  AdmissionOptions options;
  options.workers = 1;
  return options;
}

ServerTask task(uint64_t ticket, const std::string& vehicle, int64_t arrived_ns, double remaining_s,
                TaskKind kind = TaskKind::DETECTION)
{
  ServerTask task;
  task.ticket = ticket;
  task.vehicle = vehicle;
  task.kind = kind;
  task.arrived_ns = arrived_ns;
  task.remaining_s = remaining_s;
  return task;
}

/// Lets it measure `service_s` until the mean is as good as that. @return the time afterwards.
int64_t teach(Admission* admission, double service_s, TaskKind kind = TaskKind::DETECTION)
{
  int64_t now = 0;
  for (uint64_t ticket = 1000000; ticket < 1000060; ++ticket)
  {
    EXPECT_EQ(admission->submit(task(ticket, "teacher", now, 1e3, kind)), Admission::Verdict::TAKEN);
    EXPECT_TRUE(admission->next(now));
    now += static_cast<int64_t>(service_s * 1e9);
    admission->finished(ticket, service_s, now);
  }
  admission->forgetVehicle("teacher");
  return now;
}

double fairness(const std::vector<double>& shares)
{
  const double sum = std::accumulate(shares.begin(), shares.end(), 0.0);
  const double squares = std::inner_product(shares.begin(), shares.end(), shares.begin(), 0.0);
  return squares > 0.0 ? sum * sum / (static_cast<double>(shares.size()) * squares) : 0.0;
}

/// Vehicles that send tasks at a rate, regularly, to one node, in simulated time.
struct Crowd
{
  struct Member
  {
    double rate_hz = 10.0;
    double lease_hz = 0.0;
    double remaining_s = 0.2;
    double phase = 0.0;  ///< of a period
  };
  AdmissionOptions options;
  std::vector<Member> members;
  double service_s = 0.02;
  double service_deviation = 0.0;
  double duration_s = 60.0;

  std::vector<double> done;  ///< per vehicle, in time
  std::vector<double> longest_pause_s;
  uint64_t sent = 0;
  uint64_t refused = 0;
  uint64_t expired = 0;
  uint64_t late = 0;
  double busy = 0.0;

  void run()
  {
    Admission admission(options);
    std::mt19937 random(1);
    std::normal_distribution<double> deviation(0.0, 1.0);
    enum What
    {
      END,
      SEND,
    };
    struct Event
    {
      int64_t at;
      int what;
      uint64_t ticket;
      size_t member;
      double service_s;
      bool operator>(const Event& other) const
      {
        return std::tie(at, what, ticket) > std::tie(other.at, other.what, other.ticket);
      }
    };
    std::priority_queue<Event, std::vector<Event>, std::greater<Event>> events;
    std::map<uint64_t, std::pair<size_t, int64_t>> tasks;  // member, deadline
    done.assign(members.size(), 0.0);
    longest_pause_s.assign(members.size(), 0.0);
    std::vector<int64_t> last(members.size(), 0);
    const auto end = static_cast<int64_t>(duration_s * 1e9);
    for (size_t member = 0; member < members.size(); ++member)
    {
      events.push({static_cast<int64_t>(members[member].phase / members[member].rate_hz * 1e9), SEND, 0, member, 0.0});
    }
    uint64_t next_ticket = 1;
    int idle = options.workers;
    while (!events.empty() && events.top().at < end)
    {
      const Event event = events.top();
      events.pop();
      const int64_t now = event.at;
      if (event.what == SEND)
      {
        const Member& member = members[event.member];
        const std::string name = "vehicle" + std::to_string(event.member);
        admission.lease(name, TaskKind::DETECTION, member.lease_hz, now);
        const uint64_t ticket = next_ticket++;
        ++sent;
        if (admission.submit(task(ticket, name, now, member.remaining_s)) == Admission::Verdict::TAKEN)
        {
          tasks[ticket] = {event.member, now + static_cast<int64_t>(member.remaining_s * 1e9)};
        }
        else
        {
          ++refused;
        }
        events.push({now + static_cast<int64_t>(1e9 / member.rate_hz), SEND, 0, event.member, 0.0});
      }
      else
      {
        const size_t member = tasks.at(event.ticket).first;
        admission.finished(event.ticket, event.service_s, now);
        ++idle;
        if (now <= tasks.at(event.ticket).second)
        {
          done[member] += 1.0;
          longest_pause_s[member] = std::max(longest_pause_s[member], 1e-9 * static_cast<double>(now - last[member]));
          last[member] = now;
        }
        else
        {
          ++late;
        }
        tasks.erase(event.ticket);
      }
      while (idle > 0)
      {
        const auto next = admission.next(now);
        if (!next)
        {
          break;
        }
        --idle;
        const double time_s = service_s * std::exp(service_deviation * deviation(random));
        events.push({now + static_cast<int64_t>(time_s * 1e9), END, next->ticket, 0, time_s});
      }
      for (const ServerTask& dropped : admission.takeExpired())
      {
        ++expired;
        ASSERT_EQ(tasks.erase(dropped.ticket), 1U);
      }
      ASSERT_EQ(tasks.size(), admission.queued() + admission.running());
    }
    for (size_t member = 0; member < members.size(); ++member)
    {
      longest_pause_s[member] = std::max(longest_pause_s[member], 1e-9 * static_cast<double>(end - last[member]));
    }
    busy = admission.totals().busy_s / duration_s / options.workers;
  }
};

}  // namespace

TEST(Admission, NamesTheOptionThatIsWrong)
{
  const auto message = [](const std::function<void(AdmissionOptions&)>& change)
  {
    AdmissionOptions options;
    change(options);
    try
    {
      options.validate();
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message([](AdmissionOptions&) {}), "");
  EXPECT_EQ(message([](AdmissionOptions& o) { o.workers = 0; }), "admission/workers = 0, must be in [1, 1024]");
  EXPECT_NE(message([](AdmissionOptions& o) { o.max_queued = 0; }).find("max_queued"), std::string::npos);
  EXPECT_NE(message([](AdmissionOptions& o) { o.max_queued_per_vehicle = 33; }).find("[1, 32]"), std::string::npos);
  EXPECT_NE(message([](AdmissionOptions& o) { o.lease_s = NAN; }).find("lease_s"), std::string::npos);
  EXPECT_NE(message([](AdmissionOptions& o) { o.max_leased_load = 1.1; }).find("max_leased_load"), std::string::npos);
  EXPECT_NE(message([](AdmissionOptions& o) { o.first_service_s[1] = 0.0; }).find("first_service_s"),
            std::string::npos);
  AdmissionOptions options;
  options.workers = -3;
  EXPECT_THROW(Admission{options}, std::invalid_argument);
}

TEST(Admission, GivesATaskToAWorkerAndCountsIt)
{
  Admission admission(oneWorker());
  EXPECT_FALSE(admission.next(0));
  ASSERT_EQ(admission.submit(task(7, "a", 0, 0.5)), Admission::Verdict::TAKEN);
  EXPECT_EQ(admission.queued(), 1U);
  const auto next = admission.next(0);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->ticket, 7U);
  EXPECT_EQ(next->vehicle, "a");
  EXPECT_EQ(admission.running(), 1U);
  EXPECT_EQ(admission.queued(), 0U);
  EXPECT_FALSE(admission.next(0));
  admission.finished(7, 0.03, 30 * MS);
  admission.finished(7, 0.03, 30 * MS);  // twice: once is counted
  admission.finished(99, 0.03, 30 * MS);
  EXPECT_EQ(admission.running(), 0U);
  EXPECT_EQ(admission.totals().taken, 1U);
  EXPECT_EQ(admission.totals().finished, 1U);
  EXPECT_NEAR(admission.totals().busy_s, 0.03, 1e-12);
  EXPECT_NEAR(admission.advertisement("a", 30 * MS).of_kind[0].service_s, 0.03, 1e-12);
}

TEST(Admission, AdvertisesWhenAWorkerIsFreeForTheNextTask)
{
  Admission admission(oneWorker());
  int64_t now = teach(&admission, 0.1);
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].queue_s, 0.0, 1e-9);
  ASSERT_EQ(admission.submit(task(1, "a", now, 10.0)), Admission::Verdict::TAKEN);
  ASSERT_TRUE(admission.next(now));
  now += 30 * MS;
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].queue_s, 0.07, 1e-3);
  ASSERT_EQ(admission.submit(task(2, "a", now, 10.0)), Admission::Verdict::TAKEN);
  ASSERT_EQ(admission.submit(task(3, "a", now, 10.0)), Admission::Verdict::TAKEN);
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].queue_s, 0.27, 1e-3);
  // Another vehicle goes before the second of them: it had nothing yet.
  EXPECT_NEAR(admission.advertisement("b", now).of_kind[0].queue_s, 0.07, 1e-3);
  // Asking changes nothing.
  EXPECT_EQ(admission.queued(), 2U);
  EXPECT_EQ(admission.next(now)->ticket, 2U);
}

TEST(Admission, AdvertisedQueueIsWhenTheTaskIsServedInFact)
{
  AdmissionOptions options;
  options.workers = 2;
  options.max_queued = 64;
  Admission admission(options);
  int64_t now = teach(&admission, 0.05);
  std::mt19937 random(3);
  uint64_t ticket = 0;
  for (int vehicle = 0; vehicle < 6; ++vehicle)
  {
    for (int count = static_cast<int>(random() % 5); count > 0; --count)
    {
      ASSERT_EQ(admission.submit(task(++ticket, "v" + std::to_string(vehicle), now, 100.0)), Admission::Verdict::TAKEN);
    }
  }
  const double expected = admission.advertisement("v9", now).of_kind[0].queue_s;
  const double expected_of_0 = admission.advertisement("v0", now).of_kind[0].queue_s;
  for (const auto& [vehicle, wait] : {std::make_pair("v9", expected), std::make_pair("v0", expected_of_0)})
  {
    Admission copy(options);
    int64_t time = teach(&copy, 0.05);
    std::mt19937 same(3);
    uint64_t number = 0;
    for (int other = 0; other < 6; ++other)
    {
      for (int count = static_cast<int>(same() % 5); count > 0; --count)
      {
        copy.submit(task(++number, "v" + std::to_string(other), time, 100.0));
      }
    }
    ASSERT_EQ(copy.submit(task(777, vehicle, time, 200.0)), Admission::Verdict::TAKEN);
    double waited = -1.0;
    for (int round = 0; waited < 0.0 && round < 100; ++round)
    {
      std::vector<uint64_t> started;
      for (int worker = 0; worker < 2; ++worker)
      {
        if (const auto next = copy.next(time))
        {
          started.push_back(next->ticket);
          waited = next->ticket == 777 ? round * 0.05 : waited;
        }
      }
      time += 50 * MS;
      for (const uint64_t done : started)
      {
        copy.finished(done, 0.05, time);
      }
    }
    EXPECT_NEAR(waited, wait, 1e-3) << vehicle;
  }
}

TEST(Admission, RefusesWhatCannotEndInTime)
{
  Admission admission(oneWorker());
  const int64_t now = teach(&admission, 0.1);
  EXPECT_EQ(admission.submit(task(1, "a", now, 0.0)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(1, "a", now, -1.0)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(1, "a", now, NAN)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(1, "a", now, 0.05)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(1, "a", now, 0.15)), Admission::Verdict::TAKEN);
  EXPECT_EQ(admission.submit(task(2, "a", now, 0.15)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(3, "a", now, 0.25)), Admission::Verdict::TAKEN);
  // It would wait 0.1 s. Beside other vehicles a task may not wait for all the time that it has: room is kept for those
  // that had less.
  EXPECT_EQ(admission.submit(task(4, "b", now, 0.22)), Admission::Verdict::TOO_LATE);
  EXPECT_EQ(admission.submit(task(4, "b", now, 0.45)), Admission::Verdict::TAKEN);
  EXPECT_EQ(admission.totals().refused, 6U);
  EXPECT_STREQ(Admission::toString(Admission::Verdict::TOO_LATE), "too late");
}

TEST(Admission, TriesAgainWhatItThinksTooSlow)
{
  Admission admission(oneWorker());
  int64_t now = teach(&admission, 5.0);  // a disturbance, say: it takes 0.1 s now
  ASSERT_EQ(admission.submit(task(1, "a", now, 0.2)), Admission::Verdict::TOO_LATE);
  int taken = 0;
  for (int round = 0; round < 400 && admission.advertisement("a", now).of_kind[0].service_s > 0.12; ++round)
  {
    now += 250 * MS;
    if (admission.submit(task(100 + static_cast<uint64_t>(round), "a", now, 0.2)) == Admission::Verdict::TAKEN)
    {
      ++taken;
      const auto next = admission.next(now);
      ASSERT_TRUE(next);
      now += 100 * MS;
      admission.finished(next->ticket, 0.1, now);
    }
  }
  EXPECT_LE(admission.advertisement("a", now).of_kind[0].service_s, 0.12);
  EXPECT_GT(taken, 5);
}

TEST(Admission, RefusesNoneForAFewVerySlowOnes)
{
  Admission admission(oneWorker());
  int64_t now = teach(&admission, 0.02);
  for (uint64_t i = 0; i < 60; ++i)
  {
    now += 500 * MS;
    ASSERT_EQ(admission.submit(task(100 + i, "a", now, 0.1)), Admission::Verdict::TAKEN) << i;
    const auto next = admission.next(now);
    ASSERT_TRUE(next);
    const int64_t service_ms = i % 10 == 9 ? 300 : 20;
    now += service_ms * MS;
    admission.finished(next->ticket, 0.001 * static_cast<double>(service_ms), now);
  }
}

TEST(Admission, ForgetsThatItWasSlow)
{
  // Vehicles believe what it says and send nothing: it must not say for ever what a disturbance made of it.
  Admission admission(oneWorker());
  int64_t now = teach(&admission, 0.6);
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].service_s, 0.6, 0.05);
  EXPECT_NEAR(admission.advertisement("a", now + SECOND).of_kind[0].service_s, 0.6, 0.05);
  now += 60 * SECOND;
  EXPECT_LT(admission.advertisement("a", now).of_kind[0].service_s, 0.08);
  ASSERT_EQ(admission.submit(task(1, "a", now, 0.2)), Admission::Verdict::TAKEN);
  ASSERT_TRUE(admission.next(now));
  now += 20 * MS;
  admission.finished(1, 0.02, now);
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].service_s, 0.02, 1e-9);  // not a mean with what was
}

TEST(Admission, RemembersThatItIsFast)
{
  Admission admission(oneWorker());
  const int64_t now = teach(&admission, 0.01) + 3600 * SECOND;
  EXPECT_NEAR(admission.advertisement("a", now).of_kind[0].service_s, 0.01, 1e-3);
}

TEST(Admission, ExpiredTasksAreNotServed)
{
  Admission admission(oneWorker());
  int64_t now = teach(&admission, 0.1);
  ASSERT_EQ(admission.submit(task(1, "a", now, 0.5)), Admission::Verdict::TAKEN);
  ASSERT_EQ(admission.submit(task(2, "a", now, 5.0)), Admission::Verdict::TAKEN);
  now += SECOND;
  const auto next = admission.next(now);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->ticket, 2U);
  const auto expired = admission.takeExpired();
  ASSERT_EQ(expired.size(), 1U);
  EXPECT_EQ(expired[0].ticket, 1U);
  EXPECT_TRUE(admission.takeExpired().empty());
  EXPECT_EQ(admission.totals().expired, 1U);
}

TEST(Admission, ServesTheTasksOfAVehicleByDeadline)
{
  Admission admission(oneWorker());
  admission.submit(task(1, "a", 0, 30.0));
  admission.submit(task(2, "a", 0, 10.0));
  admission.submit(task(3, "a", 0, 20.0));
  std::vector<uint64_t> order;
  while (const auto next = admission.next(0))
  {
    order.push_back(next->ticket);
  }
  EXPECT_EQ(order, (std::vector<uint64_t>{2, 3, 1}));
}

TEST(Admission, ServesVehiclesInTurnByServiceTime)
{
  AdmissionOptions options = oneWorker();
  options.first_service_s = {0.02, 0.1};
  options.max_queued = 1000;
  options.max_queued_per_vehicle = 200;
  options.fair_window_s = 10.0;
  Admission admission(options);
  uint64_t ticket = 0;
  for (int count = 0; count < 100; ++count)
  {
    ASSERT_EQ(admission.submit(task(++ticket, "detects", 0, 1000.0)), Admission::Verdict::TAKEN);
    ASSERT_EQ(admission.submit(task(++ticket, "speaks", 0, 1000.0, TaskKind::SPEECH)), Admission::Verdict::TAKEN);
  }
  std::map<std::string, double> had;
  int64_t now = 0;
  for (int count = 0; count < 60; ++count)
  {
    const auto next = admission.next(now);
    ASSERT_TRUE(next);
    const double service_s = next->kind == TaskKind::SPEECH ? 0.1 : 0.02;
    had[next->vehicle] += service_s;
    now += static_cast<int64_t>(service_s * 1e9);
    admission.finished(next->ticket, service_s, now);
    EXPECT_LE(std::abs(had["detects"] - had["speaks"]), 0.1 + 1e-6);
  }
}

TEST(Admission, AQueueFullOfOneVehicleGivesWay)
{
  AdmissionOptions options = oneWorker();
  options.max_queued = 8;
  options.max_queued_per_vehicle = 8;
  Admission admission(options);
  for (uint64_t ticket = 1; ticket <= 8; ++ticket)
  {
    ASSERT_EQ(admission.submit(task(ticket, "greedy", 0, 100.0 + static_cast<double>(ticket))),
              Admission::Verdict::TAKEN);
  }
  EXPECT_EQ(admission.submit(task(9, "greedy", 0, 100.0)), Admission::Verdict::QUEUE_FULL);
  ASSERT_EQ(admission.submit(task(10, "modest", 0, 100.0)), Admission::Verdict::TAKEN);
  const auto gone = admission.takeExpired();
  ASSERT_EQ(gone.size(), 1U);
  EXPECT_EQ(gone[0].ticket, 8U);
  EXPECT_EQ(admission.queued(), 8U);
  // Nobody gives way to one who has as much.
  for (uint64_t ticket = 11; ticket <= 13; ++ticket)
  {
    ASSERT_EQ(admission.submit(task(ticket, "modest", 0, 100.0)), Admission::Verdict::TAKEN);
  }
  EXPECT_EQ(admission.submit(task(14, "modest", 0, 100.0)), Admission::Verdict::QUEUE_FULL);
  EXPECT_EQ(admission.queued(), 8U);
}

TEST(Admission, CancelsAndForgets)
{
  Admission admission(oneWorker());
  admission.submit(task(1, "a", 0, 10.0));
  admission.submit(task(2, "a", 0, 10.0));
  admission.submit(task(3, "b", 0, 10.0));
  EXPECT_TRUE(admission.cancel(1));
  EXPECT_FALSE(admission.cancel(1));
  EXPECT_EQ(admission.forgetVehicle("a"), std::vector<uint64_t>{2});
  EXPECT_TRUE(admission.forgetVehicle("a").empty());
  EXPECT_EQ(admission.next(0)->ticket, 3U);
  EXPECT_FALSE(admission.cancel(3));  // it runs
  EXPECT_FALSE(admission.next(0));
}

TEST(Admission, LeasesAreForAPartOfTheWorkersTimeAndEnd)
{
  AdmissionOptions options = oneWorker();
  options.first_service_s = {0.05, 0.1};
  Admission admission(options);  // 0.9 workers: 18 tasks of 0.05 s
  EXPECT_EQ(admission.lease("a", TaskKind::DETECTION, 10.0, 0), 10.0);
  EXPECT_EQ(admission.lease("b", TaskKind::DETECTION, 10.0, 0), 0.0);
  EXPECT_EQ(admission.lease("c", TaskKind::DETECTION, 8.0, 0), 8.0);
  EXPECT_EQ(admission.lease("d", TaskKind::DETECTION, 1000.0, 0), 0.0);
  const NodeAdvertisement told = admission.advertisement("a", 0);
  EXPECT_EQ(told.of_kind[0].lease_rate_hz, 10.0);
  EXPECT_NEAR(told.of_kind[0].lease_until_s, 1.0, 1e-9);
  EXPECT_EQ(told.of_kind[1].lease_rate_hz, 0.0);
  EXPECT_NEAR(told.capacity_gcycles, 1.0, 1e-6);  // a tenth of 10 GHz
  // Renewed by asking and by tasks; without, it ends, and then it is b's.
  EXPECT_EQ(admission.lease("c", TaskKind::DETECTION, 8.0, 900 * MS), 8.0);
  EXPECT_EQ(admission.lease("b", TaskKind::DETECTION, 10.0, 950 * MS), 0.0);
  EXPECT_EQ(admission.lease("b", TaskKind::DETECTION, 10.0, 1001 * MS), 10.0);
  EXPECT_EQ(admission.advertisement("a", 1001 * MS).of_kind[0].lease_until_s, 0.0);
  EXPECT_EQ(admission.submit(task(1, "c", 1800 * MS, 1.0)), Admission::Verdict::TAKEN);
  EXPECT_NEAR(admission.advertisement("c", 1800 * MS).of_kind[0].lease_until_s, 1.0, 1e-9);
  // More than there is: it stays what it was. Less: at once. Nothing: it is free.
  EXPECT_EQ(admission.lease("c", TaskKind::DETECTION, 9.0, 1800 * MS), 8.0);
  EXPECT_EQ(admission.lease("c", TaskKind::DETECTION, 2.0, 1800 * MS), 2.0);
  EXPECT_EQ(admission.lease("c", TaskKind::DETECTION, 0.0, 1800 * MS), 0.0);
  EXPECT_EQ(admission.lease("e", TaskKind::DETECTION, 8.0, 1800 * MS), 8.0);
  admission.forgetVehicle("e");
  EXPECT_EQ(admission.lease("f", TaskKind::DETECTION, 8.0, 1800 * MS), 8.0);
}

TEST(Admission, WhatALeaseCoversGoesFirst)
{
  AdmissionOptions options = oneWorker();
  Admission admission(options);
  int64_t now = teach(&admission, 0.05);
  ASSERT_EQ(admission.lease("leased", TaskKind::DETECTION, 2.0, now), 2.0);
  for (uint64_t ticket = 1; ticket <= 5; ++ticket)
  {
    ASSERT_EQ(admission.submit(task(ticket, "other", now, 10.0)), Admission::Verdict::TAKEN);
  }
  EXPECT_NEAR(admission.advertisement("leased", now).of_kind[0].queue_s, 0.0, 1e-9);
  ASSERT_EQ(admission.submit(task(10, "leased", now, 0.1)), Admission::Verdict::TAKEN);
  EXPECT_EQ(admission.next(now)->ticket, 10U);
  // The lease is for two a second: the third in a moment is like those of others, and the vehicle has had its part.
  admission.submit(task(11, "leased", now, 10.0));
  admission.submit(task(12, "leased", now, 10.0));
  std::vector<uint64_t> order;
  while (const auto next = admission.next(now))
  {
    order.push_back(next->ticket);
  }
  ASSERT_EQ(order.size(), 7U);
  EXPECT_GT(std::find(order.begin(), order.end(), 12) - order.begin(), 1);
}

TEST(Admission, TasksThatLoseTheirTurnAreToldAtOnce)
{
  Admission admission(oneWorker());
  const int64_t now = teach(&admission, 0.05);
  ASSERT_EQ(admission.lease("leased", TaskKind::DETECTION, 10.0, now), 10.0);
  ASSERT_EQ(admission.submit(task(1, "other", now, 0.07)), Admission::Verdict::TAKEN);
  ASSERT_EQ(admission.submit(task(2, "leased", now, 0.1)), Admission::Verdict::TAKEN);
  const auto gone = admission.takeExpired();
  ASSERT_EQ(gone.size(), 1U);
  EXPECT_EQ(gone[0].ticket, 1U);
}

TEST(Admission, DrainingTakesNothingAndServesWhatItTook)
{
  Admission admission(oneWorker());
  admission.submit(task(1, "a", 0, 10.0));
  admission.lease("a", TaskKind::DETECTION, 1.0, 0);
  admission.setDraining(true);
  EXPECT_TRUE(admission.draining());
  EXPECT_EQ(admission.submit(task(2, "a", 0, 10.0)), Admission::Verdict::DRAINING);
  EXPECT_EQ(admission.lease("a", TaskKind::DETECTION, 1.0, 0), 0.0);
  const NodeAdvertisement told = admission.advertisement("a", 0);
  EXPECT_TRUE(told.draining);
  EXPECT_EQ(told.capacity_gcycles, 0.0);
  EXPECT_EQ(told.of_kind[0].lease_rate_hz, 0.0);
  EXPECT_EQ(admission.next(0)->ticket, 1U);
  admission.setDraining(false);
  EXPECT_EQ(admission.submit(task(3, "a", 0, 10.0)), Admission::Verdict::TAKEN);
}

TEST(Admission, KindsThatAreNotServedAreRefused)
{
  AdmissionOptions options = oneWorker();
  options.served = {true, false};
  Admission admission(options);
  EXPECT_EQ(admission.submit(task(1, "a", 0, 10.0, TaskKind::SPEECH)), Admission::Verdict::NOT_SERVED);
  EXPECT_EQ(admission.submit(task(1, "a", 0, 10.0, static_cast<TaskKind>(9))), Admission::Verdict::NOT_SERVED);
  EXPECT_EQ(admission.lease("a", TaskKind::SPEECH, 1.0, 0), 0.0);
  EXPECT_FALSE(admission.advertisement("a", 0).of_kind[1].served);
  EXPECT_TRUE(admission.advertisement("a", 0).of_kind[0].served);
}

TEST(Admission, NamesWithoutEndDoNotGrowIt)
{
  AdmissionOptions options = oneWorker();
  options.max_vehicles = 10;
  Admission admission(options);
  for (int name = 0; name < 1000; ++name)
  {
    const std::string vehicle = "v" + std::to_string(name);
    admission.lease(vehicle, TaskKind::DETECTION, 1e-6, 0);
    admission.submit(task(static_cast<uint64_t>(name), vehicle, 0, 100.0));
    admission.cancel(static_cast<uint64_t>(name));
  }
  EXPECT_EQ(admission.lease("late", TaskKind::DETECTION, 1.0, 0), 0.0);
  EXPECT_EQ(admission.lease("late", TaskKind::DETECTION, 1.0, 2 * SECOND), 1.0);
}

TEST(Admission, FiftyVehiclesShareAnOverloadFairlyWithoutLeases)
{
  // Five times what two workers can do, each vehicle always at the same place in the period: the hard case.
  Crowd crowd;
  for (int vehicle = 0; vehicle < 50; ++vehicle)
  {
    Crowd::Member member;
    member.phase = vehicle / 50.0;
    crowd.members.push_back(member);
  }
  crowd.run();
  RecordProperty("fairness", std::to_string(fairness(crowd.done)));
  EXPECT_GE(fairness(crowd.done), 0.9);
  EXPECT_GE(crowd.busy, 0.95);
  EXPECT_GT(*std::min_element(crowd.done.begin(), crowd.done.end()), 0.5 * 60.0 * 100.0 / 50.0);
  EXPECT_LE(*std::max_element(crowd.longest_pause_s.begin(), crowd.longest_pause_s.end()), 3.0);
  EXPECT_EQ(crowd.late, 0U);
  EXPECT_LT(static_cast<double>(crowd.expired), 0.1 * static_cast<double>(crowd.sent));
}

TEST(Admission, FiftyVehiclesShareAnOverloadFairlyWithLeases)
{
  Crowd crowd;
  crowd.service_deviation = 0.2;
  for (int vehicle = 0; vehicle < 50; ++vehicle)
  {
    Crowd::Member member;
    member.phase = vehicle / 50.0;
    member.lease_hz = 10.0;
    crowd.members.push_back(member);
  }
  crowd.run();
  EXPECT_GE(fairness(crowd.done), 0.9);
  EXPECT_GE(crowd.busy, 0.95);
  EXPECT_GT(*std::min_element(crowd.done.begin(), crowd.done.end()), 0.5 * 60.0 * 100.0 / 50.0);
  EXPECT_LT(static_cast<double>(crowd.late), 0.005 * static_cast<double>(crowd.sent));
  EXPECT_LT(static_cast<double>(crowd.expired), 0.1 * static_cast<double>(crowd.sent));
}

TEST(Admission, AGreedyVehicleGetsNoMoreThanItsPart)
{
  Crowd crowd;
  for (int vehicle = 0; vehicle < 20; ++vehicle)
  {
    Crowd::Member member;
    member.phase = vehicle / 20.0;
    member.rate_hz = vehicle == 0 ? 500.0 : 10.0;
    crowd.members.push_back(member);
  }
  crowd.run();
  const double others =
      std::accumulate(crowd.done.begin() + 1, crowd.done.end(), 0.0) / static_cast<double>(crowd.done.size() - 1);
  EXPECT_LE(crowd.done[0], 1.5 * others);
  EXPECT_GE(fairness(crowd.done), 0.9);
}

TEST(Admission, TakesEverythingWhileThereIsRoom)
{
  Crowd crowd;
  crowd.service_deviation = 0.2;
  for (int vehicle = 0; vehicle < 7; ++vehicle)  // 0.7 of the workers' time
  {
    Crowd::Member member;
    member.phase = vehicle * 0.37 - std::floor(vehicle * 0.37);
    crowd.members.push_back(member);
  }
  crowd.run();
  EXPECT_LE(crowd.refused + crowd.expired + crowd.late, crowd.sent / 1000);
}
