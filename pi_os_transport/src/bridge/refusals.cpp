#include "bridge/refusals.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MAX_TEXTS = 64;
constexpr std::chrono::seconds LOG_INTERVAL{60};

}  // namespace

void Refusals::warn(const std::string& text)
{
  const SteadyTime now = SteadyClock::now();
  if (logged_.size() > MAX_TEXTS)
  {
    logged_.clear();
  }
  const auto known = logged_.find(text);
  if (known == logged_.end() || now - known->second > LOG_INTERVAL)
  {
    logged_[text] = now;
    log_(text);
  }
}

}  // namespace pi_os_transport
