// An edge-cloud node, with or without ROS.

#include <pi_node/command_line.h>
#include <pi_node/formatting.h>
#include <pi_node/ros/warning_board.h>
#include <pi_node/stop_signal.h>
#include <ros/ros.h>

#include <exception>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "ros/edge_server_ros.h"
#include "ros/edge_server_ros_options.h"
#include "server/edge_server.h"
#include "server/health_endpoint.h"

namespace
{

using pi_offload::EdgeServer;
using pi_offload::EdgeServerRosOptions;
using pi_offload::HealthEndpoint;
using Level = ros::console::levels::Level;

/// Writes to the log of ROS if there is a node, else to the error stream.
class Log
{
public:
  void useRos() { ros_ = true; }
  void info(const std::string& text) const { write(Level::Info, "", text); }
  void warn(const std::string& text) const { write(Level::Warn, "warning: ", text); }
  void fatal(const std::string& text) const { write(Level::Fatal, "error: ", text); }

private:
  void write(Level level, const char* prefix, const std::string& text) const
  {
    if (ros_)
    {
      ROS_LOG_STREAM(level, std::string(ROSCONSOLE_NAME_PREFIX) + ".edge_server", text);
    }
    else
    {
      std::clog << std::string("edge_server: ") + prefix + text + "\n" << std::flush;
    }
  }

  bool ros_ = false;
};

struct Arguments
{
  std::string config;
  bool announce = false;
  bool check = false;
};

/// @return false if there is nothing to do.
bool parse(const std::vector<std::string>& words, Arguments* arguments)
{
  pi_node::CommandLine line(
      "Works for vehicles on pictures and utterances.\n"
      "Without --config it is a node of ROS, with private parameters as in "
      "config/edge_server.yaml");
  line.add("config", boost::program_options::value(&arguments->config)->value_name("FILE"),
           "YAML file as config/edge_server.yaml; needs no ROS master");
  line.addFlag("announce", &arguments->announce, "with --config: be a node of ROS all the same");
  line.addFlag("check", &arguments->check, "with --config: tell whether the file is right, and end");
  if (!line.parse(words))
  {
    return false;
  }
  if (arguments->config.empty() && (arguments->announce || arguments->check))
  {
    throw std::invalid_argument("--announce and --check go with --config");
  }
  return true;
}

EdgeServerRosOptions loadOptions(const Arguments& arguments, const Log& log)
{
  std::vector<std::string> unknown;
  EdgeServerRosOptions options = arguments.config.empty() ? EdgeServerRosOptions::load(ros::NodeHandle("~"), &unknown)
                                                          : EdgeServerRosOptions::loadFile(arguments.config, &unknown);
  for (const std::string& name : unknown)
  {
    if (arguments.check)
    {
      throw std::invalid_argument(arguments.config + ": parameter " + name +
                                  " means nothing here; see config/edge_server.yaml");
    }
    log.warn("parameter " + name + " means nothing here; see config/edge_server.yaml");
  }
  return options;
}

std::unique_ptr<HealthEndpoint> makeHealth(const EdgeServerRosOptions& options, const EdgeServer& server)
{
  if (!options.health)
  {
    return nullptr;
  }
  HealthEndpoint::Callbacks probes;
  probes.live = [&server] { return server.health().live; };
  probes.ready = [&server] { return server.health().ready; };
  probes.metrics = [&server] { return server.metrics(); };
  return std::make_unique<HealthEndpoint>(options.healthOptions(), std::move(probes));
}

void serve(const EdgeServerRosOptions& options, const ros::NodeHandle* node, Log* log)
{
  log->info("parameters: " + options.toText());
  pi_node::WarningBoard warnings(options.warning_period_s, [log](bool, const std::string& text) { log->warn(text); });
  EdgeServer::Callbacks callbacks;
  callbacks.event = [&warnings](const std::string& text) { warnings.warn(text); };
  pi_offload::EdgeServerOptions server_options = options.serverOptions();
  std::string notice;
  server_options.model = options.detectionModel(&notice);
  if (!notice.empty())
  {
    log->warn(notice);
  }
  EdgeServer server(server_options, options.executors(), callbacks);
  const std::unique_ptr<HealthEndpoint> health = makeHealth(options, server);
  std::unique_ptr<pi_offload::EdgeServerRos> on_graph;
  if (node != nullptr)
  {
    on_graph = std::make_unique<pi_offload::EdgeServerRos>(*node, ros::NodeHandle("~"), options, &server,
                                                           server_options.model, &warnings);
  }
  const pi_offload::EdgeNode announced = options.announcement(server.port());
  log->info(announced.id + " works at " + announced.address +
            (health ? ", health at port " + std::to_string(health->port()) : ""));
  std::thread shutdown;
  if (node != nullptr)
  {
    shutdown = std::thread(
        []
        {
          ros::waitForShutdown();  // rosnode kill
          pi_node::StopSignal::wake();
        });
  }
  pi_node::StopSignal::wait();
  log->info("drains");
  if (!server.drain(options.drain_s))
  {
    log->warn(pi_node::format("not all tasks were done within %.1f s", options.drain_s));
  }
  on_graph.reset();
  if (shutdown.joinable())
  {
    ros::requestShutdown();
    ros::shutdown();
    shutdown.join();
  }
}

/// @param node  set if this is a node of ROS. It outlives this call: the log of ROS ends with it.
void run(const Arguments& arguments, std::unique_ptr<ros::NodeHandle>* node, Log* log)
{
  if (arguments.config.empty() || arguments.announce)
  {
    if (!ros::master::check())
    {
      throw std::runtime_error("no ROS master at " + ros::master::getURI() +
                               "; start one, or give --config FILE to work without");
    }
    *node = std::make_unique<ros::NodeHandle>();
    log->useRos();
  }
  const EdgeServerRosOptions options = loadOptions(arguments, *log);
  if (arguments.check)
  {
    options.executors();
    log->info(arguments.config + " is right");
    return;
  }
  serve(options, node->get(), log);
}

}  // namespace

int main(int argc, char** argv)
{
  Log log;
  std::unique_ptr<ros::NodeHandle> node;
  try
  {
    std::vector<std::string> words;
    ros::removeROSArgs(argc, argv, words);
    words.erase(words.begin());
    Arguments arguments;
    if (!parse(words, &arguments))
    {
      return 0;
    }
    ros::init(argc, argv, "edge_server", ros::init_options::NoSigintHandler);
    pi_node::StopSignal::install();
    run(arguments, &node, &log);
    return 0;
  }
  catch (const boost::program_options::error& error)
  {
    log.fatal(std::string(error.what()) + "; --help shows how it is called");
  }
  catch (const std::exception& error)
  {
    log.fatal(error.what());
  }
  return 1;
}
