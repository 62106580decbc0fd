#include "fleet/site.h"

#include <pi_node/stop_signal.h>
#include <yaml-cpp/yaml.h>

#include <chrono>
#include <iostream>
#include <sstream>
#include <thread>
#include <utility>

#include "server/edge_server.h"

namespace pi_offload_bench
{

using namespace pi_offload;

namespace
{

constexpr double DRAIN_S = 10.0;

}  // namespace

Site::Site(std::string id, SiteOptions options) : id_(std::move(id)), options_(std::move(options))
{
  revive();
  const std::string port = between(program_->beginning(), " works at port ", "\n");
  port_ = std::stoi(port);
}

void Site::revive()
{
  std::ostringstream config;
  config << "{id: " << id_ << ", transport: " << toString(options_.transport) << ", host: " << options_.host
         << ", port: " << port_ << ", workers: " << options_.workers << ", service_s: " << options_.service_s
         << ", servers: [";
  for (const std::string& server : options_.servers)
  {
    config << '"' << server << "\", ";
  }
  config << "]}\n";
  program_ =
      std::make_unique<Program>("/proc/self/exe", "--site", config.str(),
                                [](const std::string& log) { return !between(log, " works at port ", "\n").empty(); });
}

void runSite(const std::string& file)
{
  pi_node::StopSignal::install();
  const YAML::Node config = YAML::LoadFile(file);
  EdgeServerOptions options;
  options.transport = config["transport"].as<std::string>() == "nats" ? Transport::NATS : Transport::DIRECT;
  options.site = config["id"].as<std::string>();
  options.nats.servers = config["servers"].as<std::vector<std::string>>();
  options.replier.host = config["host"].as<std::string>();
  options.replier.port = config["port"].as<uint16_t>();
  options.admission.workers = config["workers"].as<int>();
  const auto service_s = config["service_s"].as<double>();
  options.admission.first_service_s.fill(service_s);
  const ExecutorFactory sleeper = [service_s]
  {
    return [service_s](const OffloadRequest&, double*)
    {
      std::this_thread::sleep_for(std::chrono::duration<double>(service_s));
      return OffloadReply();
    };
  };
  EdgeServer::Callbacks callbacks;
  callbacks.event = [](const std::string& text) { std::clog << text << "\n" << std::flush; };
  EdgeServer server(options, {sleeper, {}}, callbacks);
  std::clog << options.site << " works at port " << server.port() << "\n" << std::flush;
  pi_node::StopSignal::wait();
  server.drain(DRAIN_S);
}

}  // namespace pi_offload_bench
