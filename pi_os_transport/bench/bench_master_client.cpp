// bench_master_client URI TOPICS: registers one subscriber and then one publisher of each topic at a master, one call
// after the other through XmlRpc++ as roscpp does, and serves the callbacks. Prints how long that took as JSON.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include <ros/network.h>
#include <xmlrpcpp/XmlRpc.h>

namespace
{

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds DEADLINE{120};  // for the last callback
constexpr double SERVER_ROUND_S = 0.01;

/// Counts the callbacks about publishers.
class PublisherUpdate : public XmlRpc::XmlRpcServerMethod
{
public:
  explicit PublisherUpdate(XmlRpc::XmlRpcServer* server) : XmlRpcServerMethod("publisherUpdate", server) {}
  void execute(XmlRpc::XmlRpcValue&, XmlRpc::XmlRpcValue& result) override
  {
    result[0] = 1;
    result[1] = "";
    result[2] = 0;
    ++count_;
  }
  int count() const { return count_; }

private:
  std::atomic<int> count_{0};
};

class Registrar
{
public:
  Registrar(const std::string& uri, int port) : api_("http://localhost:" + std::to_string(port) + "/")
  {
    uint32_t master_port = 0;
    if (!ros::network::splitURI(uri, host_, master_port))
    {
      throw std::runtime_error("\"" + uri + "\" is no URI of a master");
    }
    client_ = std::make_unique<XmlRpc::XmlRpcClient>(host_.c_str(), static_cast<int>(master_port), "/");
  }
  ~Registrar() { client_->close(); }

  /// @return time of all calls [s]
  double registerAll(const char* method, const std::string& node, int topics)
  {
    const Clock::time_point begin = Clock::now();
    for (int topic = 0; topic < topics; ++topic)
    {
      XmlRpc::XmlRpcValue params;
      XmlRpc::XmlRpcValue result;
      params[0] = node;
      params[1] = "/bench/topic_" + std::to_string(topic);
      params[2] = "std_msgs/String";
      params[3] = api_;
      if (!client_->execute(method, params, result) || client_->isFault() || static_cast<int>(result[0]) != 1)
      {
        throw std::runtime_error(std::string(method) + " failed: " + result.toXml());
      }
    }
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }

private:
  std::string api_;
  std::string host_;
  std::unique_ptr<XmlRpc::XmlRpcClient> client_;
};

void run(const std::string& uri, int topics)
{
  XmlRpc::XmlRpcServer server;
  PublisherUpdate updates(&server);
  if (!server.bindAndListen(0))
  {
    throw std::runtime_error("no port for the slave API");
  }
  std::atomic<bool> ends{false};
  std::thread serving(
      [&]
      {
        while (!ends)
        {
          server.work(SERVER_ROUND_S);
        }
      });
  try
  {
    Registrar registrar(uri, server.get_port());
    const double subscribers_s = registrar.registerAll("registerSubscriber", "/bench_subscriber", topics);
    const Clock::time_point begin = Clock::now();
    const double publishers_s = registrar.registerAll("registerPublisher", "/bench_subscriber", topics);
    while (updates.count() < topics)
    {
      if (Clock::now() - begin > DEADLINE)
      {
        throw std::runtime_error("only " + std::to_string(updates.count()) + " callbacks came");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    const double told_s = std::chrono::duration<double>(Clock::now() - begin).count();
    std::printf("{\"subscribers_s\": %.6f, \"publishers_s\": %.6f, \"told_s\": %.6f}\n", subscribers_s, publishers_s,
                told_s);
  }
  catch (...)
  {
    ends = true;
    serving.join();
    throw;
  }
  ends = true;
  serving.join();
}

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    const int topics = argc == 3 ? std::atoi(argv[2]) : 0;
    if (topics < 1)
    {
      throw std::runtime_error("usage: bench_master_client URI TOPICS");
    }
    run(argv[1], topics);
    return EXIT_SUCCESS;
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "bench_master_client: %s\n", error.what());
    return EXIT_FAILURE;
  }
}
