#include "core/core_options.h"

#include <fcntl.h>
#include <getopt.h>

#include <stdexcept>
#include <string_view>

#include "text_parsing.h"

namespace pi_os_transport
{
namespace
{

enum LongOnly
{
  ANNOUNCE = 256,
  IGNORED,
};

constexpr option LONG_OPTIONS[] = {
    {"port", required_argument, nullptr, 'p'},
    {"numworkers", required_argument, nullptr, 'w'},
    {"timeout", required_argument, nullptr, 't'},
    {"help", no_argument, nullptr, 'h'},
    {"announce", required_argument, nullptr, ANNOUNCE},
    {"core", no_argument, nullptr, IGNORED},
    {"master-logger-level", required_argument, nullptr, IGNORED},
    {"sigint-timeout", required_argument, nullptr, IGNORED},
    {"sigterm-timeout", required_argument, nullptr, IGNORED},
    {nullptr, 0, nullptr, 0},
};

template <typename Number>
Number number(const char* name, std::string_view text, Number least, Number most)
{
  const std::optional<Number> value = parseNumber(text, least, most);
  if (!value)
  {
    throw std::invalid_argument(std::string(name) + " = \"" + std::string(text) + "\", must be in [" +
                                std::to_string(least) + ", " + std::to_string(most) + "]");
  }
  return *value;
}

/// Reads an argument that ROS passes to every program, in the form name:=value.
void takeRemapping(CoreOptions* options, const std::string& argument)
{
  const size_t at = argument.find(":=");
  const std::string name = argument.substr(0, at);
  if (at == std::string::npos || name.rfind("__", 0) != 0)
  {
    throw std::invalid_argument("\"" + argument + "\" is not expected; see --help");
  }
  if (name == "__hostname" || name == "__ip")
  {
    options->host = argument.substr(at + 2);
  }
}

}  // namespace

std::optional<CoreOptions> CoreOptions::parse(int argc, char** argv)
{
  CoreOptions options;
  opterr = 0;
  optind = 0;  // restarts getopt_long()
  int found = 0;
  while ((found = getopt_long(argc, argv, ":p:w:t:vh", LONG_OPTIONS, nullptr)) != -1)
  {
    switch (found)
    {
      case 'p':
        options.port = number<uint16_t>("--port", optarg, 0, 65535);
        break;
      case 'w':
        number<int>("--numworkers", optarg, 1, 10000);  // ignored: there are no worker threads
        break;
      case 't':
        options.timeout =
            std::chrono::milliseconds(static_cast<int64_t>(number<double>("--timeout", optarg, 0.001, 86400.0) * 1000));
        break;
      case 'v':
        options.is_verbose = true;
        break;
      case 'h':
        return std::nullopt;
      case ANNOUNCE:
        options.announce = number<int>("--announce", optarg, 0, 1 << 20);
        if (fcntl(options.announce, F_GETFD) < 0)
        {
          throw std::invalid_argument("--announce = " + std::to_string(options.announce) +
                                      ", which is no open descriptor");
        }
        break;
      case IGNORED:
        break;
      case ':':
        throw std::invalid_argument(std::string(argv[optind - 1]) + " needs a value; see --help");
      default:
        throw std::invalid_argument("\"" + std::string(argv[optind - 1]) + "\" is no option; see --help");
    }
  }
  for (int index = optind; index < argc; ++index)
  {
    takeRemapping(&options, argv[index]);
  }
  return options;
}

std::string CoreOptions::usage(const std::string& program)
{
  return "usage: " + program +
         " [options]\n\n"
         "  -p, --port PORT     of the master; 0: any that is free (11311)\n"
         "  -t, --timeout S     for a node to answer a call (60)\n"
         "  -v                  tell of everything that is logged about the master\n"
         "  --announce FD       write the ROS_MASTER_URI as one line to this descriptor once all is ready\n"
         "  -h, --help          this text\n\n"
         "Accepted and without meaning here: -w, --numworkers, --master-logger-level, --sigint-timeout,\n"
         "--sigterm-timeout, --core. Addresses are chosen as everywhere in ROS: __hostname:=, __ip:=, ROS_HOSTNAME,\n"
         "ROS_IP, ROS_IPV6. SIGINT and SIGTERM end it.\n";
}

}  // namespace pi_os_transport
