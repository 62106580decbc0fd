#include "core/core_program.h"

#include <malloc.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include "core/core_options.h"
#include "core/log_folder.h"
#include "event_loop/event_loop.h"
#include "event_loop/program.h"
#include "master/http_server.h"
#include "master/master_api.h"
#include "master/network_address.h"
#include "master/node_caller.h"
#include "ros_version.h"
#include "rosout/log_message.h"
#include "rosout/rosout_node.h"
#include "rosout/rotating_file.h"
#include "shm/file_descriptor.h"

namespace pi_os_transport
{
namespace
{

constexpr rlim_t WANTED_DESCRIPTORS = 16384;
constexpr size_t OWN_DESCRIPTORS = 64;  // files, listening sockets, the loop, and a reserve

void say(const std::string& line)
{
  std::fprintf(stdout, "%s\n", line.c_str());
  std::fflush(stdout);
}

/// Raises the limit of descriptors as far as allowed. @return the limit
/// @throws std::runtime_error if it is too low
size_t raiseDescriptorLimit()
{
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  if (limit.rlim_cur < WANTED_DESCRIPTORS)
  {
    limit.rlim_cur = std::min(limit.rlim_max, WANTED_DESCRIPTORS);
    setrlimit(RLIMIT_NOFILE, &limit);
    getrlimit(RLIMIT_NOFILE, &limit);
  }
  const size_t descriptors = static_cast<size_t>(limit.rlim_cur);
  if (descriptors < 4 * OWN_DESCRIPTORS)
  {
    throw std::runtime_error("only " + std::to_string(descriptors) + " descriptors are allowed, at least " +
                             std::to_string(4 * OWN_DESCRIPTORS) + " are needed: raise them with ulimit -n");
  }
  return descriptors;
}

/// One arena for all threads; memory of large requests returns to the system.
void keepMemorySmall()
{
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, 128 * 1024);
  mallopt(M_TRIM_THRESHOLD, 128 * 1024);
}

bool isFileLoggingDisabled()
{
  const char* const value = std::getenv("ROSOUT_DISABLE_FILE_LOGGING");
  const auto is_not = [value](const char* no) { return strcasecmp(value, no) != 0; };
  constexpr const char* NO[] = {"", "0", "false", "off", "no"};
  return value != nullptr && std::all_of(std::begin(NO), std::end(NO), is_not);
}

/// Opens the log file of all nodes. Failure is not fatal: a vehicle must start even if its disk is full.
std::unique_ptr<RotatingFile> openRosoutFile(const std::string& run_id, const Log& log)
{
  if (isFileLoggingDisabled())
  {
    return nullptr;
  }
  try
  {
    auto file = std::make_unique<RotatingFile>(makeLogFolder(run_id) + "/rosout.log", log, RotatingFile::Limits());
    say("... logging to " + file->path());
    return file;
  }
  catch (const std::runtime_error& error)
  {
    log("/rosout is not written to a file: " + std::string(error.what()));
    return nullptr;
  }
}

void announce(int descriptor, const std::string& uri)
{
  const std::string line = uri + "\n";
  if (write(descriptor, line.data(), line.size()) != static_cast<ssize_t>(line.size()))
  {
    throw std::runtime_error("--announce = " + std::to_string(descriptor) +
                             " cannot be written to: " + std::strerror(errno));
  }
  if (descriptor > STDERR_FILENO)
  {
    close(descriptor);  // the reader sees the end of file
  }
}

void warnOfOtherMaster(uint16_t port)
{
  const char* const uri = std::getenv("ROS_MASTER_URI");
  if (uri == nullptr)
  {
    return;
  }
  try
  {
    if (parseHttpUri(uri).port != port)
    {
      std::fprintf(stderr, "WARNING: ROS_MASTER_URI port [%u] does not match this master [%u]\n",
                   static_cast<unsigned>(parseHttpUri(uri).port), static_cast<unsigned>(port));
    }
  }
  catch (const std::invalid_argument& error)
  {
    std::fprintf(stderr, "WARNING: ROS_MASTER_URI: %s\n", error.what());
  }
}

/// Sets the parameters of roscore.
void setCoreParameters(MasterApi* api, const std::string& run_id)
{
  const std::string caller = "/roslaunch";
  const char* const distribution = std::getenv("ROS_DISTRO");
  api->setParameter("/run_id", run_id, caller);
  // With line ends, as in roscore, which stores the output of commands.
  api->setParameter("/rosversion", std::string(ROS_VERSION) + "\n", caller);
  api->setParameter("/rosdistro", std::string(distribution != nullptr ? distribution : ROS_DISTRIBUTION) + "\n",
                    caller);
}

const char* nameOf(CoreProgram program)
{
  return program == CoreProgram::CORE ? "pi_core" : "pi_master";
}

/// Starts the rosout node and registers it with the master of this process.
void startRosout(EventLoop* loop, MasterApi* api, RosoutNode::Environment environment,
                 std::optional<RosoutNode>* rosout)
{
  environment.omits_topics = [api]
  {
    const RpcValue* value = api->parameter("/rosout/omit_topics");
    return value != nullptr && *value == RpcValue(true);
  };
  rosout->emplace(loop, environment);
  api->addPublisher(RosoutNode::NAME, RosoutNode::PUBLISHED, LogType::name(), (*rosout)->uri());
  api->addSubscriber(RosoutNode::NAME, RosoutNode::SUBSCRIBED, LogType::name(), (*rosout)->uri());
}

void run(CoreProgram program, const CoreOptions& options)
{
  const Log log = [program](const std::string& line)
  { std::fprintf(stderr, "%s: %s\n", nameOf(program), line.c_str()); };
  const FileDescriptor signals = endSignals();
  const size_t descriptors = raiseDescriptorLimit();
  const NetworkAddress network = networkAddress(options.host);
  EventLoop loop;
  NodeCallerLimits call_limits;
  call_limits.connections = std::min(call_limits.connections, descriptors / 4);
  call_limits.reply = options.timeout.value_or(call_limits.reply);
  NodeCaller calls(&loop, call_limits);
  HttpServerLimits server_limits;
  server_limits.connections = std::min(server_limits.connections, descriptors / 4);

  // The URI of the master needs the port of the server.
  std::optional<MasterApi> api;
  HttpServer server(
      &loop, network.bind, options.port, [&api](std::string_view request) { return api->answer(request); },
      server_limits);
  const std::string uri = httpUri(network.host, server.port());
  const auto shut_down = [&](const std::string& reason)
  {
    log(reason);
    loop.stop();
  };
  api.emplace(uri, &calls, shut_down, options.is_verbose ? log : Log());

  std::unique_ptr<RotatingFile> file;
  std::optional<RosoutNode> rosout;
  if (program == CoreProgram::CORE)
  {
    const std::string run_id = newRunId();
    setCoreParameters(&*api, run_id);
    file = openRosoutFile(run_id, log);
    RosoutNode::Environment environment;
    environment.network = network;
    environment.master_uri = uri;
    environment.calls = &calls;
    environment.file = file.get();
    startRosout(&loop, &*api, environment, &rosout);
  }
  loop.add(signals.get(), EPOLLIN, [&loop](uint32_t) { loop.stop(); });

  if (options.announce >= 0)
  {
    announce(options.announce, uri);
  }
  else
  {
    warnOfOtherMaster(server.port());
  }
  say("ROS_MASTER_URI=" + uri);
  if (program == CoreProgram::CORE)
  {
    say("started core service [/rosout]");
  }
  loop.run();
  loop.remove(signals.get());
}

}  // namespace

int runCore(CoreProgram program, int argc, char** argv)
{
  const std::string name = nameOf(program);
  keepMemorySmall();
  return runProgram(
      name, [&] { return CoreOptions::parse(argc, argv); }, CoreOptions::usage(name),
      [program](const CoreOptions& options) { run(program, options); });
}

}  // namespace pi_os_transport
