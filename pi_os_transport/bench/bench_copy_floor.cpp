/// What no transport for unmodified binaries can undercut: the time of one serialisation and of one deserialisation per
/// subscriber, in one process and without any wake-up.
///
/// bench_copy_floor SIZE:SUBSCRIBERS:RATE_HZ...   prints one line "@ {json}" per argument, with two figures:
/// back to back, with warm caches; and at the rate, right after the image was filled, as in the latency runs. At a rate
/// the cores sleep in between and caches go cold, so the second is what a measured latency compares with. With several
/// subscribers the deserialisations are spread over the cores, as many threads as there are cores at most.

#include "payload_pattern.h"

#include <ros/serialization.h>
#include <sensor_msgs/Image.h>
#include <boost/make_shared.hpp>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <iostream>
#include <sstream>
#include <thread>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
constexpr std::size_t TRAFFIC_PER_CASE = 200UL * 1000 * 1000;  // bytes; bounds the time spent on the large sizes
constexpr double SECONDS_AT_RATE = 0.5;

std::int64_t median(std::vector<std::int64_t> values)
{
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

/// @return end of the deserialisation [ns]
std::int64_t deserialise(std::vector<std::uint8_t>* buffer)
{
  const auto image = boost::make_shared<sensor_msgs::Image>();  // a fresh message each time, as roscpp makes one
  ros::serialization::IStream stream(buffer->data(), static_cast<std::uint32_t>(buffer->size()));
  ros::serialization::deserialize(stream, *image);
  return monotonicNs();
}

struct Floor
{
  std::int64_t serialise_ns;  ///< p50
  std::int64_t each_ns;       ///< p50 over all subscribers, from the start of the serialisation to having the message
  std::int64_t last_ns;       ///< p50 until the last subscriber has it
};

/// @param rate_hz  0: back to back
Floor measure(std::size_t size, std::size_t subscribers, std::size_t workers, double rate_hz)
{
  const std::size_t rounds = rate_hz > 0.0
                                 ? static_cast<std::size_t>(std::clamp(rate_hz * SECONDS_AT_RATE, 10.0, 200.0))
                                 : std::clamp<std::size_t>(TRAFFIC_PER_CASE / (size * subscribers), 15, 2000);
  const std::size_t warm_up = 5;
  const std::int64_t start_ns = monotonicNs();
  const auto awaitRound = [&](std::size_t round)
  {
    if (rate_hz > 0.0)
    {
      sleepUntil(start_ns + static_cast<std::int64_t>(static_cast<double>(round) * 1e9 / rate_hz));
    }
  };

  const PayloadPattern pattern;
  sensor_msgs::Image image;
  shapeImage(&image, size);
  pattern.fillBody(image.data.data(), size, 0);
  std::vector<std::uint8_t> buffer(ros::serialization::serializationLength(image));

  std::atomic<std::size_t> started{0};  // rounds whose buffer may be read
  std::atomic<std::size_t> finished{0};
  std::vector<std::int64_t> ends_ns(subscribers);
  const auto work = [&](std::size_t worker)
  {
    for (std::size_t i = worker; i < subscribers; i += workers)
    {
      ends_ns[i] = deserialise(&buffer);
    }
    finished.fetch_add(1, std::memory_order_release);
  };
  std::vector<std::thread> threads;
  for (std::size_t worker = 1; worker < workers; ++worker)
  {
    threads.emplace_back(
        [&, worker]
        {
          for (std::size_t round = 1; round <= rounds + warm_up; ++round)
          {
            awaitRound(round);
            while (started.load(std::memory_order_acquire) < round)  // spins: the floor has no wake-up in it
            {
            }
            work(worker);
          }
        });
  }

  std::vector<std::int64_t> serialise_ns, each_ns, last_ns;
  for (std::size_t round = 1; round <= rounds + warm_up; ++round)
  {
    awaitRound(round);
    if (rate_hz > 0.0)
    {
      pattern.fillBody(image.data.data(), size, round);
    }
    const std::int64_t begin_ns = monotonicNs();
    ros::serialization::OStream stream(buffer.data(), static_cast<std::uint32_t>(buffer.size()));
    ros::serialization::serialize(stream, image);
    const std::int64_t serialised_ns = monotonicNs();
    started.store(round, std::memory_order_release);
    work(0);
    while (finished.load(std::memory_order_acquire) < workers * round)
    {
    }
    if (round > warm_up)
    {
      serialise_ns.push_back(serialised_ns - begin_ns);
      for (const std::int64_t end_ns : ends_ns)
      {
        each_ns.push_back(end_ns - begin_ns);
      }
      last_ns.push_back(*std::max_element(ends_ns.begin(), ends_ns.end()) - begin_ns);
    }
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  return {median(serialise_ns), median(each_ns), median(last_ns)};
}

void print(std::size_t size, std::size_t subscribers, double rate_hz)
{
  const std::size_t workers = std::min<std::size_t>(subscribers, std::max(1U, std::thread::hardware_concurrency()));
  std::cout << "@ {\"size\": " << size << ", \"subscribers\": " << subscribers << ", \"workers\": " << workers;
  for (const bool warm : {true, false})
  {
    const Floor floor = measure(size, subscribers, workers, warm ? 0.0 : rate_hz);
    std::cout << ", \"" << (warm ? "warm" : "paced") << "\": {\"serialise_ns\": " << floor.serialise_ns
              << ", \"each_ns\": " << floor.each_ns << ", \"last_ns\": " << floor.last_ns << "}";
  }
  std::cout << "}" << std::endl;
}
}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  for (int i = 1; i < argc; ++i)
  {
    std::istringstream argument(argv[i]);
    std::size_t size = 0, subscribers = 0;
    double rate_hz = 0.0;
    char colon = 0;
    argument >> size >> colon >> subscribers >> colon >> rate_hz;
    if (argument.fail() || size < pi_os_transport_bench::MIN_PAYLOAD_SIZE || subscribers < 1 || !(rate_hz > 0.0))
    {
      std::cerr << "bench_copy_floor: argument '" << argv[i]
                << "', must be SIZE:SUBSCRIBERS:RATE_HZ with SIZE >= " << pi_os_transport_bench::MIN_PAYLOAD_SIZE
                << ", SUBSCRIBERS >= 1 and RATE_HZ > 0\n";
      return 2;
    }
    pi_os_transport_bench::print(size, subscribers, rate_hz);
  }
  return 0;
}
