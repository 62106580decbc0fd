// A radio link between two network namespaces of the test bed: two TUN devices, and what lies between them. It does
// what tc netem would do; many kernels have no netem, and TUN devices carry packets of the size of real ones.

#include <fcntl.h>
#include <linux/if.h>
#include <linux/if_tun.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <deque>
#include <exception>
#include <iostream>
#include <optional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

namespace
{

constexpr size_t LARGEST_PACKET = 65536;
constexpr double LONGEST_QUEUE_S = 0.1;  ///< a packet that would wait longer for its turn is dropped

const char* const USAGE =
    "usage: radio_link DEVICE_HERE DEVICE_THERE NAMESPACE_THERE\n"
    "Makes a TUN device in this network namespace and one in that of the file NAMESPACE_THERE, and carries packets\n"
    "between them. Lines on the standard input change the link, both directions alike:\n"
    "  RATE_MBPS DELAY_S LOSS     rate 0: unlimited; loss 0 to 1, 1: nothing passes. Answered by a line\n"
    "Ends with the standard input.\n";

int64_t nowNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

[[noreturn]] void fail(const std::string& what)
{
  throw std::system_error(errno, std::generic_category(), what);
}

/// A TUN device of the namespace that this process is in.
int openDevice(const std::string& name)
{
  if (name.empty() || name.size() >= IFNAMSIZ)
  {
    throw std::invalid_argument("device name \"" + name + "\", must have 1 to " + std::to_string(IFNAMSIZ - 1) +
                                " letters");
  }
  const int file = open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (file < 0)
  {
    fail("/dev/net/tun");
  }
  struct ifreq request = {};
  request.ifr_flags = static_cast<int16_t>(IFF_TUN | IFF_NO_PI);
  std::copy(name.begin(), name.end(), request.ifr_name);
  if (ioctl(file, TUNSETIFF, &request) != 0)
  {
    fail("device " + name);
  }
  return file;
}

struct Quality
{
  double rate_mbps = 0.0;  ///< 0: unlimited
  double delay_s = 0.0;
  double loss = 0.0;
};

/// @throws std::invalid_argument
Quality parseQuality(const std::string& line)
{
  std::istringstream words(line);
  Quality quality;
  std::string rest;
  const bool read = static_cast<bool>(words >> quality.rate_mbps >> quality.delay_s >> quality.loss);
  if (!read || words >> rest || !(quality.rate_mbps >= 0.0 && quality.rate_mbps <= 1e6) ||
      !(quality.delay_s >= 0.0 && quality.delay_s <= 60.0) || !(quality.loss >= 0.0 && quality.loss <= 1.0))
  {
    throw std::invalid_argument("\"" + line + "\", must be rate 0 to 1e6, delay 0 to 60 and loss 0 to 1");
  }
  return quality;
}

/// Packets on their way in one direction; they never overtake each other.
class Direction
{
public:
  Direction(int from, int to) : from_(from), to_(to) {}

  int from() const { return from_; }

  void setQuality(const Quality& quality)
  {
    quality_ = quality;
    if (quality.loss >= 1.0)
    {
      packets_.clear();
    }
  }

  /// Takes what came.
  void take(std::mt19937* random)
  {
    std::array<uint8_t, LARGEST_PACKET> buffer;
    for (;;)
    {
      const ssize_t size = read(from_, buffer.data(), buffer.size());
      if (size <= 0)
      {
        return;  // EAGAIN; EIO while the device is down
      }
      const int64_t now_ns = nowNs();
      const double waits_s = 1e-9 * static_cast<double>(sent_ns_ - now_ns);
      if (std::uniform_real_distribution<double>()(*random) < quality_.loss || waits_s > LONGEST_QUEUE_S)
      {
        continue;
      }
      const double takes_s = quality_.rate_mbps > 0.0 ? 8e-6 * static_cast<double>(size) / quality_.rate_mbps : 0.0;
      sent_ns_ = std::max(sent_ns_, now_ns) + std::llround(1e9 * takes_s);
      arrives_ns_ = std::max<int64_t>(arrives_ns_, sent_ns_ + std::llround(1e9 * quality_.delay_s));
      packets_.push_back({arrives_ns_, {buffer.begin(), buffer.begin() + size}});
    }
  }

  /// Hands over what has arrived. @return when the next one arrives.
  std::optional<int64_t> give()
  {
    while (!packets_.empty() && packets_.front().arrives_ns <= nowNs())
    {
      // What a device that is down does not take is lost.
      const ssize_t written = write(to_, packets_.front().data.data(), packets_.front().data.size());
      static_cast<void>(written);
      packets_.pop_front();
    }
    return packets_.empty() ? std::nullopt : std::optional<int64_t>(packets_.front().arrives_ns);
  }

private:
  struct Packet
  {
    int64_t arrives_ns;
    std::vector<uint8_t> data;
  };
  const int from_;
  const int to_;
  Quality quality_;
  int64_t sent_ns_ = 0;     ///< when the last packet has left
  int64_t arrives_ns_ = 0;  ///< and arrives
  std::deque<Packet> packets_;
};

/// Where the process may, it runs before all others: air waits for no processor.
void hurry()
{
  struct sched_param parameter = {};
  parameter.sched_priority = 1;
  sched_setscheduler(0, SCHED_FIFO, &parameter);
}

void carry(int here, int there)
{
  std::array<Direction, 2> directions{Direction(here, there), Direction(there, here)};
  std::mt19937 random(1);
  std::string input;
  for (;;)
  {
    int64_t next_ns = INT64_MAX;
    for (Direction& direction : directions)
    {
      next_ns = std::min(next_ns, direction.give().value_or(INT64_MAX));
    }
    struct timespec wait = {};
    const int64_t left_ns = std::max<int64_t>(next_ns - nowNs(), 0);
    wait.tv_sec = left_ns / 1000000000;
    wait.tv_nsec = left_ns % 1000000000;
    std::array<struct pollfd, 3> events{{{here, POLLIN, 0}, {there, POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}}};
    if (ppoll(events.data(), events.size(), next_ns == INT64_MAX ? nullptr : &wait, nullptr) < 0 && errno != EINTR)
    {
      fail("poll");
    }
    for (Direction& direction : directions)
    {
      direction.take(&random);
    }
    if (events[2].revents == 0)
    {
      continue;
    }
    std::array<char, 256> text;
    const ssize_t size = read(STDIN_FILENO, text.data(), text.size());
    if (size <= 0)
    {
      return;
    }
    input.append(text.data(), static_cast<size_t>(size));
    for (size_t end = input.find('\n'); end != std::string::npos; end = input.find('\n'))
    {
      const Quality quality = parseQuality(input.substr(0, end));
      input.erase(0, end + 1);
      for (Direction& direction : directions)
      {
        direction.setQuality(quality);
      }
      std::cout << "@true" << std::endl;
    }
  }
}

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    const std::vector<std::string> words(argv + 1, argv + argc);
    if (words.size() != 3)
    {
      std::cerr << USAGE;
      return words == std::vector<std::string>{"--help"} ? 0 : 2;
    }
    const int here = openDevice(words[0]);
    const int other = open(words[2].c_str(), O_RDONLY | O_CLOEXEC);
    if (other < 0 || setns(other, CLONE_NEWNET) != 0)
    {
      fail("namespace " + words[2]);
    }
    const int there = openDevice(words[1]);
    hurry();
    std::cout << "@true" << std::endl;
    carry(here, there);
    return 0;
  }
  catch (const std::exception& error)
  {
    std::cerr << "radio_link: " << error.what() << std::endl;
    return 1;
  }
}
