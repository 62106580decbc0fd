#include "progress.h"

#include <unistd.h>

#include <algorithm>
#include <iomanip>
#include <iostream>
#include <string>

namespace pi_slam
{

namespace
{

constexpr std::chrono::milliseconds REFRESH(100);
constexpr size_t BAR_WIDTH = 40;

}  // namespace

Progress::Progress(size_t total, bool quiet) : total_(total), shown_(!quiet && isatty(STDERR_FILENO) == 1) {}

Progress::~Progress()
{
  if (shown_ && done_ > 0)
  {
    std::cerr << "\r\x1b[K" << std::flush;
  }
}

void Progress::show(size_t done)
{
  const auto now = std::chrono::steady_clock::now();
  if (!shown_ || (now - last_ < REFRESH && done < total_))
  {
    return;
  }
  last_ = now;
  done_ = done;
  // A bag may hold more pairs than its mean rate promised.
  const size_t total = std::max({total_, done, size_t{1}});
  const double seconds = std::max(std::chrono::duration<double>(now - start_).count(), 1e-3);
  const double rate = static_cast<double>(done) / seconds;
  const size_t bar = BAR_WIDTH * done / total;
  std::cerr << "\r[" << std::string(bar, '#') << std::string(BAR_WIDTH - bar, ' ') << "] " << done << "/" << total
            << "  " << std::fixed << std::setprecision(1) << rate << " pairs/s  "
            << static_cast<long>(static_cast<double>(total - done) / std::max(rate, 1e-3)) << " s left \x1b[K"
            << std::flush;
}

}  // namespace pi_slam
