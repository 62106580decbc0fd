// The bridge of a device: carries topics and services between this device and others. Knows nothing of ROS but how
// nodes that have the library ask for it, and needs no master.

#include <sys/signalfd.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>

#include "bridge/bridge.h"
#include "event_loop/end_signals.h"

namespace
{

void log(const std::string& line)
{
  std::fprintf(stderr, "pi_os_bridge: %s\n", line.c_str());
}

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    const std::optional<pi_os_transport::BridgeConfig> config = pi_os_transport::loadBridgeConfig(argc, argv);
    if (!config)
    {
      std::fputs(pi_os_transport::bridgeUsage().c_str(), stdout);
      return EXIT_SUCCESS;
    }
    const pi_os_transport::FileDescriptor signals = pi_os_transport::endSignals();
    pi_os_transport::EventLoop loop;
    pi_os_transport::Bridge bridge(&loop, *config, log);
    bridge.start();
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
                 loop.stop();  // asked for the second time
                 return;
               }
               ending = true;
               bridge.drain([&loop]() { loop.stop(); });
             });
    std::printf("pi_os_bridge: serving %s as \"%s\" on port %u\n", config->name.c_str(), config->socket.c_str(),
                static_cast<unsigned>(bridge.port()));
    std::fflush(stdout);
    loop.run();
    loop.remove(signals.get());
    return EXIT_SUCCESS;
  }
  catch (const std::exception& error)
  {
    log(error.what());
    return EXIT_FAILURE;
  }
}
