// An edge-cloud node, with and without ROS.

#include "server/edge_server.h"
#include "server/health_endpoint.h"
#include "ros/edge_server_ros.h"
#include "ros/edge_server_ros_options.h"
#include <pi_node/formatting.h>
#include <pi_node/ros/warning_board.h>
#include <ros/ros.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <boost/program_options.hpp>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <exception>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace
{

namespace program_options = boost::program_options;
using pi_offload::EdgeServer;
using pi_offload::EdgeServerOptions;
using pi_offload::EdgeServerRosOptions;
using pi_offload::HealthEndpoint;

/// Written to by whatever wants the program to end.
int end_event = -1;

void askToEnd(int)
{
  const uint64_t one = 1;
  const int before = errno;
  if (write(end_event, &one, sizeof one) < 0)
  {
    _exit(1);  // cannot be
  }
  errno = before;
}

/// The first of SIGINT, SIGTERM and SIGHUP ends the program in order, the second one at once.
void installSignals()
{
  end_event = eventfd(0, EFD_CLOEXEC);
  if (end_event < 0)
  {
    throw std::runtime_error("no event descriptor: too many files are open");
  }
  struct sigaction action = {};
  action.sa_handler = askToEnd;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP})
  {
    sigaction(signal, &action, nullptr);
  }
}

void waitForEnd()
{
  uint64_t count = 0;
  while (read(end_event, &count, sizeof count) < 0 && errno == EINTR)
  {
  }
}

/// To the log of ROS where there is a node, else to the error stream.
class Log
{
public:
  void useRos() { ros_ = true; }
  void info(const std::string& text) const
  {
    if (ros_)
    {
      ROS_INFO_STREAM_NAMED("edge_server", text);
    }
    else
    {
      std::clog << "edge_server: " + text + "\n" << std::flush;
    }
  }
  void warn(const std::string& text) const
  {
    if (ros_)
    {
      ROS_WARN_STREAM_NAMED("edge_server", text);
    }
    else
    {
      std::clog << "edge_server: warning: " + text + "\n" << std::flush;
    }
  }
  void fatal(const std::string& text) const
  {
    if (ros_)
    {
      ROS_FATAL_STREAM_NAMED("edge_server", text);
    }
    else
    {
      std::clog << "edge_server: error: " + text + "\n" << std::flush;
    }
  }

private:
  bool ros_ = false;
};

struct Arguments
{
  std::string config;
  bool announce = false;
  bool check = false;
  bool help = false;
};

Arguments parse(const std::vector<std::string>& words, std::string* usage)
{
  Arguments arguments;
  program_options::options_description description(
      "Works for vehicles on pictures and utterances.\n"
      "Without --config it is a node of ROS, with private parameters as in config/edge_server.yaml");
  description.add_options()("config", program_options::value(&arguments.config)->value_name("FILE"),
                            "YAML file as config/edge_server.yaml; no ROS master is needed")(
      "announce", program_options::bool_switch(&arguments.announce), "with --config: be a node of ROS all the same")(
      "check", program_options::bool_switch(&arguments.check), "with --config: say whether the file is right, and end")(
      "help", program_options::bool_switch(&arguments.help), "this text");
  std::ostringstream text;
  text << description;
  *usage = text.str();
  program_options::variables_map values;
  program_options::store(program_options::command_line_parser(words)
                             .options(description)
                             .positional(program_options::positional_options_description())
                             .run(),
                         values);
  program_options::notify(values);
  if (arguments.config.empty() && (arguments.announce || arguments.check))
  {
    throw std::invalid_argument("--announce and --check go with --config");
  }
  return arguments;
}

void requireMaster()
{
  if (!ros::master::check())
  {
    throw std::runtime_error("no ROS master at " + ros::master::getURI() +
                             "; start one, or give --config FILE to work without");
  }
}

void run(const Arguments& arguments, Log* log)
{
  std::vector<std::string> unknown;
  EdgeServerRosOptions options;
  std::unique_ptr<ros::NodeHandle> node;
  if (arguments.config.empty() || arguments.announce)
  {
    requireMaster();
    node = std::make_unique<ros::NodeHandle>();
    log->useRos();
  }
  options = arguments.config.empty() ? EdgeServerRosOptions::load(ros::NodeHandle("~"), &unknown)
                                     : EdgeServerRosOptions::loadFile(arguments.config, &unknown);
  for (const std::string& name : unknown)
  {
    log->warn("parameter " + name + " means nothing here; see config/edge_server.yaml");
  }
  if (arguments.check)
  {
    options.executors();
    log->info(arguments.config + " is right");
    return;
  }
  log->info("parameters: " + options.toText());
  pi_node::WarningBoard warnings(options.warning_period_s,
                                    [log](bool, const std::string& text) { log->warn(text); });
  EdgeServer::Callbacks callbacks;
  callbacks.event = [&warnings](const std::string& text) { warnings.warn(text); };
  EdgeServerOptions server_options = options.serverOptions();
  server_options.model = options.detectionModel();
  EdgeServer server(server_options, options.executors(), callbacks);
  std::unique_ptr<HealthEndpoint> health;
  if (options.health)
  {
    HealthEndpoint::Callbacks probes;
    probes.live = [&server] { return server.health().live; };
    probes.ready = [&server] { return server.health().ready; };
    probes.metrics = [&server] { return prometheusText(server.statistics(), server.health()); };
    health = std::make_unique<HealthEndpoint>(options.healthOptions(), std::move(probes));
  }
  std::unique_ptr<pi_offload::EdgeServerRos> on_graph;
  std::thread shutdown;
  if (node)
  {
    on_graph = std::make_unique<pi_offload::EdgeServerRos>(*node, ros::NodeHandle("~"), options, &server, &warnings);
    shutdown = std::thread(
        []
        {
          ros::waitForShutdown();  // rosnode kill
          askToEnd(0);
        });
  }
  const pi_offload::EdgeNode announced = options.announcement(server.port());
  log->info(announced.id + " works at " + announced.address +
            (health ? ", health at port " + std::to_string(health->port()) : ""));
  waitForEnd();
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

}  // namespace

int main(int argc, char** argv)
{
  Log log;
  std::string usage;
  try
  {
    std::vector<std::string> words;
    ros::removeROSArgs(argc, argv, words);
    words.erase(words.begin());
    const Arguments arguments = parse(words, &usage);
    if (arguments.help)
    {
      std::cout << usage << std::endl;
      return 0;
    }
    ros::init(argc, argv, "edge_server", ros::init_options::NoSigintHandler);
    installSignals();
    run(arguments, &log);
    return 0;
  }
  catch (const program_options::error& error)
  {
    log.fatal(std::string(error.what()) + "; --help shows how it is called");
  }
  catch (const std::exception& error)
  {
    log.fatal(error.what());
  }
  return 1;
}
