// The bridge of a device: carries topics and services between this device and others. The nodes that have the library
// preloaded ask for it. Needs no master.

#include <sys/signalfd.h>
#include <unistd.h>

#include <cstdio>
#include <string>

#include "bridge/bridge.h"
#include "bridge/scheduling.h"
#include "event_loop/program.h"

namespace
{

void run(const pi_os_transport::BridgeConfig& config)
{
  const pi_os_transport::FileDescriptor signals = pi_os_transport::endSignals();
  pi_os_transport::EventLoop loop;
  pi_os_transport::Bridge bridge(
      &loop, config, [](const std::string& line) { std::fprintf(stderr, "pi_os_bridge: %s\n", line.c_str()); });
  bridge.start();
  const std::string refused = pi_os_transport::setNice(config.nice);
  if (!refused.empty())
  {
    std::fprintf(stderr, "pi_os_bridge: %s\n", refused.c_str());
  }
  bool ending = false;
  loop.add(signals.get(), EPOLLIN,
           [&](uint32_t)
           {
             signalfd_siginfo info;
             if (read(signals.get(), &info, sizeof(info)) != static_cast<ssize_t>(sizeof(info)))
             {
               return;
             }
             if (ending)
             {
               loop.stop();  // the second signal
               return;
             }
             ending = true;
             bridge.drain([&loop]() { loop.stop(); });
           });
  std::printf("pi_os_bridge: serving %s as \"%s\" on port %u\n", config.name.c_str(), config.socket.c_str(),
              static_cast<unsigned>(bridge.port()));
  std::fflush(stdout);
  loop.run();
  loop.remove(signals.get());
}

}  // namespace

int main(int argc, char** argv)
{
  return pi_os_transport::runProgram(
      "pi_os_bridge", [&] { return pi_os_transport::loadBridgeConfig(argc, argv); }, pi_os_transport::bridgeUsage(),
      run);
}
