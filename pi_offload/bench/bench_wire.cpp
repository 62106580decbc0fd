// Round trips of requests and replies, beside libnanomsg's REQ and REP, in turn:
//   bench_wire [--rounds N] [--trips N]      both ends in this process
//   bench_wire --serve --host ADDRESS        one end; and the other, for example across a slow link:
//   bench_wire --ask --host ADDRESS          both with --interface NAME of that link
// The processor time is that of this process.

#include <nanomsg/nn.h>
#include <nanomsg/reqrep.h>
#include <nanomsg/tcp.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/program_options.hpp>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <limits>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "wire/sp_socket.h"

namespace
{

using namespace pi_offload;
using Bytes = std::vector<uint8_t>;

constexpr size_t REPLY_BYTES = 256;
constexpr std::chrono::seconds PATIENCE{10};
using Interfaces = std::vector<std::string>;

constexpr std::array<size_t, 3> SIZES{64, 100000, 1000000};
constexpr size_t WARM_UP = 10;

/// Answers each request with REPLY_BYTES.
class OwnServer
{
public:
  OwnServer(const std::string& host, uint16_t port, const Interfaces& interfaces)
    : replier_(optionsOf(host, port, interfaces), callbacks())
  {
  }

private:
  static SpReplier::Options optionsOf(const std::string& host, uint16_t port, const Interfaces& interfaces)
  {
    SpReplier::Options options;
    options.host = host;
    options.port = port;
    options.trusted_interfaces = interfaces;
    return options;
  }
  SpReplier::Callbacks callbacks()
  {
    SpReplier::Callbacks callbacks;
    callbacks.request = [this](const SpReplier::Peer& peer, const Bytes&, int64_t) { replier_.reply(peer, reply_); };
    callbacks.problem = [](const std::string& reason) { std::cerr << "bench_wire: " << reason << "\n"; };
    return callbacks;
  }

  const Bytes reply_ = Bytes(REPLY_BYTES);
  SpReplier replier_;
};

class OwnClient
{
public:
  OwnClient(const std::string& host, uint16_t port, const Interfaces& interfaces)
    : requester_(optionsOf(host, port, interfaces), callbacks())
  {
    waitFor(&up_);
  }
  void trip(const Bytes& request)
  {
    if (!requester_.send(1, request))
    {
      throw std::runtime_error("the requester takes no request");
    }
    waitFor(&answered_);
    answered_ = false;
  }

private:
  static SpRequester::Options optionsOf(const std::string& host, uint16_t port, const Interfaces& interfaces)
  {
    SpRequester::Options options;
    options.address = host + ":" + std::to_string(port);
    options.trusted_interfaces = interfaces;
    return options;
  }
  SpRequester::Callbacks callbacks()
  {
    SpRequester::Callbacks callbacks;
    callbacks.reply = [this](uint32_t, const Bytes&, int64_t) { set(&answered_, true); };
    callbacks.link = [this](bool up, const std::string& reason)
    {
      if (!up)
      {
        std::cerr << "bench_wire: " << reason << "\n";
      }
      set(&up_, up);
    };
    return callbacks;
  }
  void set(bool* what, bool value)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    *what = value;
    changed_.notify_one();
  }
  void waitFor(const bool* what)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    if (!changed_.wait_for(lock, PATIENCE, [&] { return *what; }))
    {
      throw std::runtime_error("the other end does not answer");
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  bool up_ = false;
  bool answered_ = false;
  SpRequester requester_;
};

/// A socket of libnanomsg.
class NanomsgSocket
{
public:
  explicit NanomsgSocket(int protocol) : socket_(nn_socket(AF_SP, protocol))
  {
    set(NN_TCP, NN_TCP_NODELAY, 1);
    set(NN_SOL_SOCKET, NN_RCVMAXSIZE, 8 << 20);
  }
  ~NanomsgSocket() { nn_close(socket_); }
  NanomsgSocket(const NanomsgSocket&) = delete;
  NanomsgSocket& operator=(const NanomsgSocket&) = delete;
  int get() const { return socket_; }
  void set(int level, int option, int value) { check(nn_setsockopt(socket_, level, option, &value, sizeof(value))); }
  static int check(int result)
  {
    return result >= 0 ? result : throw std::runtime_error(std::string("libnanomsg: ") + nn_strerror(nn_errno()));
  }
  static std::string url(const std::string& host, uint16_t port)
  {
    return "tcp://" + host + ":" + std::to_string(port);
  }

private:
  const int socket_;
};

class NanomsgServer
{
public:
  NanomsgServer(const std::string& host, uint16_t port) : socket_(NN_REP)
  {
    NanomsgSocket::check(nn_bind(socket_.get(), NanomsgSocket::url(host, port).c_str()));
    socket_.set(NN_SOL_SOCKET, NN_RCVTIMEO, TURN_MS);
    thread_ = std::thread([this] { serve(); });
  }
  ~NanomsgServer()
  {
    stop_ = true;
    thread_.join();
  }

private:
  static constexpr int TURN_MS = 100;
  void serve()
  {
    const Bytes reply(REPLY_BYTES);
    while (!stop_)
    {
      void* request = nullptr;
      if (nn_recv(socket_.get(), &request, NN_MSG, 0) >= 0)
      {
        nn_freemsg(request);
        nn_send(socket_.get(), reply.data(), reply.size(), 0);
      }
    }
  }

  NanomsgSocket socket_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class NanomsgClient
{
public:
  NanomsgClient(const std::string& host, uint16_t port) : socket_(NN_REQ)
  {
    NanomsgSocket::check(nn_connect(socket_.get(), NanomsgSocket::url(host, port).c_str()));
    socket_.set(NN_SOL_SOCKET, NN_RCVTIMEO, static_cast<int>(std::chrono::milliseconds(PATIENCE).count()));
  }
  void trip(const Bytes& request) const
  {
    NanomsgSocket::check(nn_send(socket_.get(), request.data(), request.size(), 0));
    void* reply = nullptr;
    NanomsgSocket::check(nn_recv(socket_.get(), &reply, NN_MSG, 0));
    nn_freemsg(reply);
  }

private:
  NanomsgSocket socket_;
};

double processorSeconds()
{
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time)
  { return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec); };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

struct Series
{
  std::vector<double> trip_us;
  double processor_s = 0.0;
};

void measure(const std::function<void(const Bytes&)>& trip, const Bytes& request, size_t trips, Series* series)
{
  for (size_t count = 0; count < WARM_UP; ++count)
  {
    trip(request);
  }
  const double begin_s = processorSeconds();
  for (size_t count = 0; count < trips; ++count)
  {
    const auto begin = std::chrono::steady_clock::now();
    trip(request);
    const std::chrono::duration<double, std::micro> passed = std::chrono::steady_clock::now() - begin;
    series->trip_us.push_back(passed.count());
  }
  series->processor_s += processorSeconds() - begin_s;
}

void print(const char* name, size_t bytes, Series* series)
{
  std::vector<double>& trips = series->trip_us;
  std::sort(trips.begin(), trips.end());
  const auto part = [&](double share) { return trips[static_cast<size_t>(share * static_cast<double>(trips.size()))]; };
  std::printf("%-11s %8zu %9.1f %9.1f %9.1f\n", name, bytes, part(0.5), part(0.99),
              1e6 * series->processor_s / static_cast<double>(trips.size()));
}

void compare(const std::string& host, uint16_t port, const Interfaces& interfaces, size_t rounds, size_t trips)
{
  OwnClient own(host, port, interfaces);
  const NanomsgClient nanomsg(host, static_cast<uint16_t>(port + 1));
  std::printf(
      "engine         bytes  p50 [us]  p99 [us]  processor [us]   (replies of %zu bytes, %zu x %zu round trips)\n",
      REPLY_BYTES, rounds, trips);
  for (const size_t size : SIZES)
  {
    const Bytes request(size);
    std::array<Series, 2> series;
    for (size_t round = 0; round < rounds; ++round)
    {
      measure([&](const Bytes& bytes) { own.trip(bytes); }, request, trips, &series[0]);
      measure([&](const Bytes& bytes) { nanomsg.trip(bytes); }, request, trips, &series[1]);
    }
    print("own", size, &series[0]);
    print("libnanomsg", size, &series[1]);
  }
}

}  // namespace

int main(int argc, char** argv)
{
  namespace po = boost::program_options;
  std::string host;
  size_t rounds = 0;
  size_t trips = 0;
  uint16_t port = 0;
  Interfaces interfaces;
  po::options_description options("Options");
  options.add_options()("help", "this text")("host", po::value(&host)->default_value("127.0.0.1"), "numeric address")(
      "port", po::value(&port)->default_value(5689), "of the own engine; libnanomsg has the next one")(
      "interface", po::value(&interfaces), "that may be used beside the loopback interface; may be repeated")(
      "rounds", po::value(&rounds)->default_value(5), "alternations of the two")(
      "trips", po::value(&trips)->default_value(1000), "round trips of each size and round")(
      "serve", "answer only, until the standard input ends")("ask", "ask only");
  try
  {
    po::variables_map given;
    po::store(po::parse_command_line(argc, argv, options), given);
    if (given.count("help") != 0)
    {
      std::cout << options;
      return EXIT_SUCCESS;
    }
    po::notify(given);
    if (rounds == 0 || trips == 0)
    {
      throw std::invalid_argument("rounds and trips must be at least 1");
    }
    std::optional<OwnServer> own;
    std::optional<NanomsgServer> nanomsg;
    if (given.count("ask") == 0)
    {
      own.emplace(host, port, interfaces);
      nanomsg.emplace(host, static_cast<uint16_t>(port + 1));
    }
    if (given.count("serve") != 0)
    {
      std::cin.ignore(std::numeric_limits<std::streamsize>::max());
      return EXIT_SUCCESS;
    }
    compare(host, port, interfaces, rounds, trips);
  }
  catch (const std::exception& error)
  {
    std::cerr << "bench_wire: " << error.what() << "\n";
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
