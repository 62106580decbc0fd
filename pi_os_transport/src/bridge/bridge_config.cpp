#include "bridge/bridge_config.h"

#include <fnmatch.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "bridge/config_file.h"
#include "bridge/setting.h"
#include "wire/ipv4.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t MAX_POOL_MB = 65536;
constexpr uint32_t MAX_MESSAGE_MB = 1024;
constexpr int JPEG_QUALITY = 80;
constexpr int PNG_LEVEL = 3;

std::string hostName()
{
  char name[MAX_NAME + 1] = {};
  return gethostname(name, MAX_NAME) == 0 && name[0] != '\0' ? name : "unnamed";
}

std::string parseWire(const Setting& setting)
{
  return parseChoice(setting, {"sp", "nanomsg"}, "sp or nanomsg");
}

TopicOptions readTopic(const ConfigFile& file, const YAML::Node& node, const std::string& prefix)
{
  TopicOptions topic;
  std::optional<Setting> quality;
  file.readMap(
      node, prefix,
      {{"match",
        [&](const YAML::Node& value, const std::string& key)
        {
          const Setting setting = file.scalar(value, key);
          topic.match = setting.value;
          if (topic.match.empty() || std::strchr("/*?[", topic.match.front()) == nullptr)
          {
            setting.refuse("a shell pattern for full topic names, which start with \"/\"");
          }
        }},
       {"priority",
        [&](const YAML::Node& value, const std::string& key)
        {
          const std::string choice =
              parseChoice(file.scalar(value, key), {"high", "normal", "low"}, "high, normal or low");
          topic.priority = choice == "high"  ? TopicOptions::Priority::HIGH
                           : choice == "low" ? TopicOptions::Priority::LOW
                                             : TopicOptions::Priority::NORMAL;
        }},
       {"rate_limit_hz", [&](const YAML::Node& value, const std::string& key)
        { topic.rate_limit_hz = parseRate(file.scalar(value, key)); }},
       {"keep_latest", [&](const YAML::Node& value, const std::string& key)
        { topic.keep_latest = parseSwitch(file.scalar(value, key)); }},
       {"compression",
        [&](const YAML::Node& value, const std::string& key) {
          topic.compression = parseChoice(file.scalar(value, key), {"", "jpeg", "png"}, "jpeg, png or \"\" for none");
        }},
       {"quality", [&](const YAML::Node& value, const std::string& key) { quality = file.scalar(value, key); }},
       {"forward", [&](const YAML::Node& value, const std::string& key)
        { topic.forward = parseSwitch(file.scalar(value, key)); }}});
  if (topic.match.empty())
  {
    throw std::runtime_error(file.place(node, prefix) +
                             ".match is missing, must be a shell pattern like \"/camera/*\"");
  }
  if (topic.compression == "jpeg")
  {
    topic.quality = quality ? parseWhole(*quality, 1, 100) : JPEG_QUALITY;
  }
  else if (topic.compression == "png")
  {
    topic.quality = quality ? parseWhole(*quality, 1, 9) : PNG_LEVEL;
  }
  else if (quality)
  {
    quality->refuse("left out without compression: jpeg or png");
  }
  return topic;
}

template <typename Parsed>
std::vector<Parsed> parseAll(const std::vector<Setting>& settings, const std::function<Parsed(const Setting&)>& parse)
{
  std::vector<Parsed> parsed;
  std::transform(settings.begin(), settings.end(), std::back_inserter(parsed), parse);
  return parsed;
}

Endpoint parsePeer(const Setting& setting)
{
  return parseReachable(setting, BRIDGE_PORT);
}

Endpoint parseAdvertise(const Setting& setting)
{
  return setting.value.empty() ? Endpoint{} : parseReachable(setting, 0);
}

void readFile(const std::string& path, BridgeConfig* config)
{
  const ConfigFile file(path);
  const YAML::Node document = file.load();
  if (document.IsNull())
  {
    return;
  }
  using Value = const YAML::Node&;
  using Key = const std::string&;
  file.readMap(
      document, "",
      {{"name", [&](Value value, Key key) { config->name = parseDeviceName(file.scalar(value, key)); }},
       {"listen",
        [&](Value value, Key key)
        {
          config->listen = parseAll<Endpoint>(file.list(value, key), parseListen);
          if (config->listen.empty())
          {
            throw std::runtime_error(file.place(value, key) + " = [], must name at least one ADDRESS[:PORT]");
          }
        }},
       {"advertise", [&](Value value, Key key) { config->advertise = parseAdvertise(file.scalar(value, key)); }},
       {"peers", [&](Value value, Key key) { config->peers = parseAll<Endpoint>(file.list(value, key), parsePeer); }},
       {"allow", [&](Value value, Key key) { config->allow = parseAll<CIDR>(file.list(value, key), parseCIDR); }},
       {"wire", [&](Value value, Key key) { config->wire = parseWire(file.scalar(value, key)); }},
       {"socket", [&](Value value, Key key) { config->socket = parseSocketName(file.scalar(value, key)); }},
       {"pool_limit_mb", [&](Value value, Key key)
        { config->pool_limit_mb = parseWhole<uint64_t>(file.scalar(value, key), 1, MAX_POOL_MB); }},
       {"max_message_mb", [&](Value value, Key key)
        { config->max_message_mb = parseWhole<uint32_t>(file.scalar(value, key), 1, MAX_MESSAGE_MB); }},
       {"topics", [&](Value value, Key key)
        {
          for (const YAML::Node& item : file.items(value, key))
          {
            config->topics.push_back(readTopic(file, item, key + "[" + std::to_string(config->topics.size()) + "]"));
          }
        }}});
}

using Arguments = std::map<std::string, std::vector<Setting>>;

/// Options of the command line by name; nothing if --help is among them.
std::optional<Arguments> splitArguments(int argc, const char* const* argv)
{
  static const std::set<std::string> REPEATABLE{"--listen", "--peer", "--allow"};
  static const std::set<std::string> SINGLE{"--config", "--name", "--advertise", "--wire", "--socket"};
  std::vector<std::string> words;
  for (int index = 1; index < argc; ++index)
  {
    const std::string word = argv[index];
    if (word.find(":=") == std::string::npos)
    {
      words.push_back(word);
    }
  }
  Arguments arguments;
  for (auto word = words.begin(); word != words.end(); ++word)
  {
    if (*word == "--help" || *word == "-h")
    {
      return std::nullopt;
    }
    const size_t equals = word->find('=');
    const std::string option = word->substr(0, equals);
    if (REPEATABLE.count(option) == 0 && SINGLE.count(option) == 0)
    {
      throw std::runtime_error("\"" + *word + "\" is no option, see --help");
    }
    std::string value;
    if (equals != std::string::npos)
    {
      value = word->substr(equals + 1);
    }
    else if (std::next(word) == words.end())
    {
      throw std::runtime_error(option + " lacks its value, see --help");
    }
    else
    {
      value = *++word;
    }
    std::vector<Setting>& given = arguments[option];
    if (!given.empty() && SINGLE.count(option) != 0)
    {
      throw std::runtime_error(option + " = \"" + value + "\" comes after " + option + " = \"" + given[0].value +
                               "\", must be given once");
    }
    given.push_back({option, value});
  }
  return arguments;
}

}  // namespace

bool CIDR::contains(uint32_t address) const
{
  return prefix == 0 || (address ^ network) >> (32 - prefix) == 0;
}

std::string CIDR::toString() const
{
  return formatIpv4(network) + "/" + std::to_string(prefix);
}

const TopicOptions& BridgeConfig::topic(const std::string& full_name) const
{
  static const TopicOptions DEFAULTS;
  const auto found = std::find_if(topics.begin(), topics.end(),
                                  [&full_name](const TopicOptions& options)
                                  { return fnmatch(options.match.c_str(), full_name.c_str(), 0) == 0; });
  return found != topics.end() ? *found : DEFAULTS;
}

bool BridgeConfig::allows(const std::string& address) const
{
  if (allow.empty())
  {
    return true;
  }
  const std::optional<uint32_t> number = parseIpv4(address);
  return number &&
         std::any_of(allow.begin(), allow.end(), [&number](const CIDR& range) { return range.contains(*number); });
}

std::string bridgeUsage()
{
  return "usage: pi_os_bridge [option]...\n"
         "Carries the topics of nodes that have libpi_os_transport.so preloaded between devices, one copy per device.\n"
         "\n"
         "  --config FILE               YAML file, see config/bridge.yaml; the options below win over it\n"
         "  --name NAME                 of this device, for people (default: its host name)\n"
         "  --listen ADDRESS[:PORT]     IPv4 address or interface; repeatable (default: 0.0.0.0:8814)\n"
         "  --advertise ADDRESS[:PORT]  where others reach this bridge, if that is not where it listens (tunnels)\n"
         "  --peer ADDRESS[:PORT]       bridge to connect to from the start; repeatable (others: when a node needs "
         "one)\n"
         "  --allow CIDR                who may connect, like 192.168.1.0/24; repeatable (default: everyone)\n"
         "  --wire sp|nanomsg           sockets of its own or libnanomsg; both understand each other (default: sp)\n"
         "  --socket NAME               nodes with PI_OS_BRIDGE=NAME use this bridge (default: default)\n"
         "  --help                      this text\n"
         "\n"
         "Arguments like __name:=x are roslaunch's and ignored. SIGTERM and SIGINT end it.\n"
         "Counters: rosrun pi_os_transport pi_os status\n";
}

std::optional<BridgeConfig> loadBridgeConfig(int argc, const char* const* argv)
{
  std::optional<Arguments> arguments = splitArguments(argc, argv);
  if (!arguments)
  {
    return std::nullopt;
  }
  BridgeConfig config;
  config.name = hostName();
  const auto single = [&arguments](const char* option, const std::function<void(const Setting&)>& apply)
  {
    if (const auto found = arguments->find(option); found != arguments->end())
    {
      apply(found->second[0]);
    }
  };
  const auto repeated = [&arguments](const char* option, const auto& parse, auto* field)
  {
    if (const auto found = arguments->find(option); found != arguments->end())
    {
      *field = parseAll<std::decay_t<decltype(field->front())>>(found->second, parse);
    }
  };
  single("--config", [&config](const Setting& setting) { readFile(setting.value, &config); });
  single("--name", [&config](const Setting& setting) { config.name = parseDeviceName(setting); });
  single("--advertise", [&config](const Setting& setting) { config.advertise = parseAdvertise(setting); });
  single("--wire", [&config](const Setting& setting) { config.wire = parseWire(setting); });
  single("--socket", [&config](const Setting& setting) { config.socket = parseSocketName(setting); });
  repeated("--listen", parseListen, &config.listen);
  repeated("--peer", parsePeer, &config.peers);
  repeated("--allow", parseCIDR, &config.allow);
  return config;
}

}  // namespace pi_os_transport
