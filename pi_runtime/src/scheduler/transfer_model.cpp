#include <pi_runtime/transfer_model.h>

#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace pi_runtime
{
namespace
{

void check(const TransferLink& link)
{
  if (!std::isfinite(link.latency) || link.latency < 0)
  {
    throw std::invalid_argument("transfer model: latency = " + std::to_string(link.latency) +
                                " s, must be finite and >= 0");
  }
  if (!(link.bandwidth > 0))
  {
    throw std::invalid_argument("transfer model: bandwidth = " + std::to_string(link.bandwidth) +
                                " B/s, must be > 0 (infinite for units with the same memory)");
  }
}

}  // namespace

TransferModel::TransferModel(std::size_t units, TransferLink link)
  : units_(units), latency_(units * units, link.latency), seconds_per_byte_(units * units, 1.0 / link.bandwidth)
{
  check(link);
  for (std::size_t unit = 0; unit < units; ++unit)
  {
    latency_[unit * units + unit] = 0.0;
    seconds_per_byte_[unit * units + unit] = 0.0;
  }
}

void TransferModel::setLink(std::size_t from, std::size_t to, TransferLink link)
{
  check(link);
  if (from >= units_ || to >= units_ || from == to)
  {
    throw std::invalid_argument("transfer model: no link from unit " + std::to_string(from) + " to unit " +
                                std::to_string(to) + " can be set: they must differ and be below " +
                                std::to_string(units_));
  }
  latency_[from * units_ + to] = link.latency;
  seconds_per_byte_[from * units_ + to] = 1.0 / link.bandwidth;
}

TransferModel::Mean TransferModel::mean() const
{
  if (units_ < 2)
  {
    return {};
  }
  const auto pairs = static_cast<double>(units_ * (units_ - 1));
  return {std::accumulate(latency_.begin(), latency_.end(), 0.0) / pairs,
          std::accumulate(seconds_per_byte_.begin(), seconds_per_byte_.end(), 0.0) / pairs};
}

}  // namespace pi_runtime
