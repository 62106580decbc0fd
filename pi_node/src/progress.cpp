#include <pi_node/progress.h>

#include <unistd.h>

#include <algorithm>
#include <iomanip>
#include <iostream>
#include <string>

namespace pi_node
{

namespace
{

constexpr std::chrono::milliseconds REFRESH(100);
constexpr size_t BAR_WIDTH = 40;

}  // namespace

Progress::~Progress()
{
  if (line_open_)
  {
    std::cerr << "\r\x1b[K" << std::flush;
  }
}

double Progress::seconds() const
{
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void Progress::show(size_t done, size_t total)
{
  static const bool on_terminal = isatty(STDERR_FILENO) == 1;
  total = std::max({total, done, size_t{1}});
  const size_t tenth = 10 * done / total;
  const auto now = std::chrono::steady_clock::now();
  if (quiet_ || (on_terminal ? now - last_ < REFRESH && done < total : tenth == tenth_))
  {
    return;
  }
  last_ = now;
  tenth_ = tenth;
  line_open_ = on_terminal;
  const double rate = static_cast<double>(done) / std::max(seconds(), 1e-3);
  const size_t bar = BAR_WIDTH * done / total;
  std::cerr << (on_terminal ? "\r" : "") << "[" << std::string(bar, '#') << std::string(BAR_WIDTH - bar, ' ') << "] "
            << done << "/" << total << "  " << std::fixed << std::setprecision(1) << rate << " " << unit_ << "/s  "
            << static_cast<long>(static_cast<double>(total - done) / std::max(rate, 1e-3)) << " s left"
            << (on_terminal ? " \x1b[K" : "\n") << std::flush;
}

}  // namespace pi_node
