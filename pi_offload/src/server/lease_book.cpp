#include "server/lease_book.h"

#include <pi_node/durations.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

namespace pi_offload
{
namespace
{

/// A lease covers a burst of this part of a second's tasks, plus one.
constexpr double LEASE_BURST_S = 0.25;
/// For rounding of loads.
constexpr double TOLERANCE = 1e-9;

}  // namespace

const LeaseBook::Lease* LeaseBook::find(const std::string& vehicle, TaskKind kind, int64_t now_ns) const
{
  const auto found = vehicles_.find(vehicle);
  if (found == vehicles_.end())
  {
    return nullptr;
  }
  const Lease& lease = found->second[static_cast<size_t>(kind)];
  return lease.held && now_ns < lease.until_ns ? &lease : nullptr;
}

double LeaseBook::tokensOf(const Lease& lease, int64_t now_ns) const
{
  const double passed = std::max(0.0, pi_node::secondsBetween(lease.tokens_ns, now_ns));
  return std::min(1.0 + lease.rate_hz * LEASE_BURST_S, lease.tokens + lease.rate_hz * passed);
}

bool LeaseBook::covers(const std::string& vehicle, TaskKind kind, int64_t now_ns) const
{
  const Lease* lease = find(vehicle, kind, now_ns);
  return lease != nullptr && tokensOf(*lease, now_ns) >= 1.0;
}

void LeaseBook::use(const std::string& vehicle, TaskKind kind, int64_t now_ns)
{
  const auto found = vehicles_.find(vehicle);
  if (found != vehicles_.end())
  {
    Lease& lease = found->second[static_cast<size_t>(kind)];
    lease.tokens = std::max(0.0, tokensOf(lease, now_ns) - 1.0);
    lease.tokens_ns = std::max(lease.tokens_ns, now_ns);
  }
}

double LeaseBook::rate(const std::string& vehicle, TaskKind kind, int64_t now_ns) const
{
  const Lease* lease = find(vehicle, kind, now_ns);
  return lease != nullptr ? lease->rate_hz : 0.0;
}

double LeaseBook::holdsFor(const std::string& vehicle, TaskKind kind, int64_t now_ns) const
{
  const Lease* lease = find(vehicle, kind, now_ns);
  return lease != nullptr ? pi_node::secondsBetween(now_ns, lease->until_ns) : 0.0;
}

double LeaseBook::load(const Services& services, int64_t now_ns) const
{
  double sum = 0.0;
  for (const auto& vehicle : vehicles_)
  {
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      const Lease& lease = vehicle.second[kind];
      sum += lease.held && now_ns < lease.until_ns ? lease.rate_hz * services[kind] : 0.0;
    }
  }
  return sum;
}

/// Room that is left after the vehicles that waited before `order` got what fits.
LeaseBook::Room LeaseBook::roomBefore(int64_t order, const Services& services, int64_t now_ns) const
{
  std::vector<std::pair<int64_t, double>> wishes;
  for (const auto& vehicle : vehicles_)
  {
    for (size_t kind = 0; kind < TASK_KINDS; ++kind)
    {
      const Lease& lease = vehicle.second[kind];
      if (lease.waiting && lease.order < order)
      {
        wishes.emplace_back(lease.order, lease.wanted_hz * services[kind]);
      }
    }
  }
  std::sort(wishes.begin(), wishes.end());
  Room room;
  room.left = options_.max_load - load(services, now_ns);
  for (const auto& wish : wishes)
  {
    if (wish.second <= room.left + TOLERANCE)
    {
      room.left -= wish.second;
    }
    else
    {
      room.least_refused = std::min(room.least_refused, wish.second);
    }
  }
  return room;
}

void LeaseBook::wait(Lease* lease, double rate_hz, int64_t now_ns)
{
  if (!lease->waiting)
  {
    lease->waiting = true;
    lease->order = next_order_++;
  }
  lease->wanted_hz = rate_hz;
  lease->asked_ns = now_ns;
}

/// Drops leases that were not renewed and wishes that were not repeated.
void LeaseBook::sweep(int64_t now_ns)
{
  const int64_t pause_ns = pi_node::nanoseconds(options_.lease_s / 4.0);
  if (swept_ns_ != INT64_MIN && now_ns < swept_ns_ + pause_ns)
  {
    return;
  }
  swept_ns_ = now_ns;
  for (auto vehicle = vehicles_.begin(); vehicle != vehicles_.end();)
  {
    bool used = false;
    for (Lease& lease : vehicle->second)
    {
      lease.held = lease.held && now_ns < lease.until_ns;
      lease.waiting = lease.waiting && pi_node::secondsBetween(lease.asked_ns, now_ns) < options_.lease_s;
      used = used || lease.held || lease.waiting;
    }
    vehicle = used ? std::next(vehicle) : vehicles_.erase(vehicle);
  }
}

double LeaseBook::ask(const std::string& vehicle, TaskKind kind, double rate_hz, const Services& services,
                      int64_t now_ns)
{
  sweep(now_ns);
  auto found = vehicles_.find(vehicle);
  const auto index = static_cast<size_t>(kind);
  if (!(rate_hz > 0.0))
  {
    if (found != vehicles_.end())
    {
      found->second[index] = Lease();
    }
    return 0.0;
  }
  const double wanted = rate_hz * services[index];
  if (found == vehicles_.end())
  {
    if (vehicles_.size() >= options_.max_vehicles)
    {
      return 0.0;
    }
    found = vehicles_.emplace(vehicle, Leases()).first;
  }
  Lease& lease = found->second[index];
  if (!std::isfinite(wanted) || wanted > options_.max_load + TOLERANCE)
  {
    lease = Lease();  // it can never be granted and must not block others
    return 0.0;
  }
  lease.held = lease.held && now_ns < lease.until_ns;
  if (lease.held)
  {
    const double held = lease.rate_hz * services[index];
    const Room room = roomBefore(INT64_MAX, services, now_ns);
    if (pi_node::secondsBetween(lease.held_since_ns, now_ns) >= options_.turn_s &&
        room.least_refused <= std::max(0.0, room.left) + held + TOLERANCE)
    {
      lease.held = false;
      wait(&lease, rate_hz, now_ns);
      return 0.0;
    }
    // A higher rate needs room beside the waiting vehicles; else the former rate is kept.
    if (rate_hz <= lease.rate_hz || wanted - held <= room.left + TOLERANCE)
    {
      lease.tokens = tokensOf(lease, now_ns);
      lease.tokens_ns = now_ns;
      lease.rate_hz = rate_hz;
    }
    lease.until_ns = now_ns + pi_node::nanoseconds(options_.lease_s);
    return lease.rate_hz;
  }
  wait(&lease, rate_hz, now_ns);
  if (wanted > roomBefore(lease.order, services, now_ns).left + TOLERANCE)
  {
    return 0.0;
  }
  lease = Lease();
  lease.held = true;
  lease.rate_hz = rate_hz;
  lease.until_ns = now_ns + pi_node::nanoseconds(options_.lease_s);
  lease.held_since_ns = now_ns;
  lease.tokens = 1.0 + rate_hz * LEASE_BURST_S;
  lease.tokens_ns = now_ns;
  return rate_hz;
}

void LeaseBook::renew(const std::string& vehicle, TaskKind kind, const Services& services, int64_t now_ns)
{
  const Lease* lease = find(vehicle, kind, now_ns);
  if (lease != nullptr)
  {
    ask(vehicle, kind, lease->rate_hz, services, now_ns);
  }
}

}  // namespace pi_offload
