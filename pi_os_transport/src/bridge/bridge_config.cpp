#include "bridge/bridge_config.h"

#include <arpa/inet.h>
#include <fnmatch.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace pi_os_transport
{
namespace
{

constexpr uint64_t MAX_POOL_MB = 65536;
constexpr uint32_t MAX_MESSAGE_MB = 1024;
constexpr double MAX_RATE_HZ = 1e6;
constexpr size_t MAX_NAME = 255;
constexpr size_t MAX_SOCKET_NAME = 64;  // an abstract address holds 107 bytes, user id and prefix included
constexpr int JPEG_QUALITY = 80;
constexpr int PNG_LEVEL = 3;

/// One value and where it stands: "bridge.yaml:7: listen" or "--listen".
struct Setting
{
  std::string place;
  std::string value;

  [[noreturn]] void refuse(const std::string& allowed) const
  {
    throw std::runtime_error(place + " = \"" + value + "\", must be " + allowed);
  }
};

std::string hostName()
{
  char name[MAX_NAME + 1] = {};
  return gethostname(name, MAX_NAME) == 0 && name[0] != '\0' ? name : "unnamed";
}

template <typename Number>
Number parseWhole(const Setting& setting, Number lowest, Number highest)
{
  Number number = 0;
  const char* end = setting.value.data() + setting.value.size();
  const std::from_chars_result result = std::from_chars(setting.value.data(), end, number);
  if (result.ec != std::errc() || result.ptr != end || number < lowest || number > highest)
  {
    setting.refuse("a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest));
  }
  return number;
}

double parseRate(const Setting& setting)
{
  double rate = 0.0;
  const char* end = setting.value.data() + setting.value.size();
  const std::from_chars_result result = std::from_chars(setting.value.data(), end, rate);
  if (result.ec != std::errc() || result.ptr != end || !std::isfinite(rate) || rate < 0.0 || rate > MAX_RATE_HZ)
  {
    setting.refuse("a number from 0 (no limit) to 1000000 [1/s]");
  }
  return rate;
}

bool parseSwitch(const Setting& setting)
{
  if (setting.value != "true" && setting.value != "false")
  {
    setting.refuse("true or false");
  }
  return setting.value == "true";
}

std::string parseChoice(const Setting& setting, const std::vector<std::string>& choices, const std::string& allowed)
{
  if (std::find(choices.begin(), choices.end(), setting.value) == choices.end())
  {
    setting.refuse(allowed);
  }
  return setting.value;
}

std::string parseDeviceName(const Setting& setting)
{
  const auto unprintable = [](unsigned char c) { return c < 0x20 || c == 0x7f; };
  if (setting.value.empty() || setting.value.size() > MAX_NAME ||
      std::any_of(setting.value.begin(), setting.value.end(), unprintable))
  {
    setting.refuse("1 to 255 printable characters");
  }
  return setting.value;
}

std::string parseSocketName(const Setting& setting)
{
  const auto usable = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.'; };
  if (setting.value.empty() || setting.value.size() > MAX_SOCKET_NAME || setting.value == "0" ||
      !std::all_of(setting.value.begin(), setting.value.end(), usable))
  {
    setting.refuse("1 to 64 letters, digits, '_', '-' or '.', and not \"0\", which switches the bridge off in a node");
  }
  return setting.value;
}

std::optional<uint32_t> parseNumericAddress(const std::string& text)
{
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1)
  {
    return std::nullopt;
  }
  return ntohl(address.s_addr);
}

std::string formatAddress(uint32_t address)
{
  const in_addr network{htonl(address)};
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &network, text, sizeof(text));
  return text;
}

/// First IPv4 address of a network interface.
std::optional<std::string> interfaceAddress(const std::string& name)
{
  ifaddrs* list = nullptr;
  if (getifaddrs(&list) != 0)
  {
    return std::nullopt;
  }
  const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owner(list, &freeifaddrs);
  for (const ifaddrs* entry = list; entry != nullptr; entry = entry->ifa_next)
  {
    if (entry->ifa_addr != nullptr && entry->ifa_addr->sa_family == AF_INET && name == entry->ifa_name)
    {
      return formatAddress(ntohl(reinterpret_cast<const sockaddr_in*>(entry->ifa_addr)->sin_addr.s_addr));
    }
  }
  return std::nullopt;
}

std::optional<std::string> hostAddress(const std::string& host)
{
  addrinfo wanted{};
  wanted.ai_family = AF_INET;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  if (getaddrinfo(host.c_str(), nullptr, &wanted, &list) != 0)
  {
    return std::nullopt;
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(list, &freeaddrinfo);
  return formatAddress(ntohl(reinterpret_cast<const sockaddr_in*>(list->ai_addr)->sin_addr.s_addr));
}

/// ADDRESS[:PORT], the address as it stands there.
Endpoint splitEndpoint(const Setting& setting, uint16_t default_port, uint16_t lowest_port)
{
  Endpoint endpoint{setting.value, default_port};
  const size_t colon = setting.value.rfind(':');
  if (colon != std::string::npos)
  {
    endpoint.address = setting.value.substr(0, colon);
    const std::string digits = setting.value.substr(colon + 1);
    const char* end = digits.data() + digits.size();
    const std::from_chars_result result = std::from_chars(digits.data(), end, endpoint.port);
    if (result.ec != std::errc() || result.ptr != end || endpoint.port < lowest_port)
    {
      setting.refuse("ADDRESS[:PORT] with a port from " + std::to_string(lowest_port) + " to 65535");
    }
  }
  if (endpoint.address.empty() || endpoint.address.find(':') != std::string::npos)
  {
    setting.refuse("ADDRESS[:PORT] with an IPv4 address or a name");
  }
  return endpoint;
}

Endpoint parseListen(const Setting& setting)
{
  Endpoint endpoint = splitEndpoint(setting, BRIDGE_PORT, 0);
  if (!parseNumericAddress(endpoint.address))
  {
    const std::optional<std::string> found = interfaceAddress(endpoint.address);
    if (!found)
    {
      setting.refuse("ADDRESS[:PORT], where ADDRESS is an IPv4 address or an interface of this device that has one");
    }
    endpoint.address = *found;
  }
  return endpoint;
}

/// Where somebody can be reached; a host name is resolved.
Endpoint parseReachable(const Setting& setting, uint16_t default_port)
{
  Endpoint endpoint = splitEndpoint(setting, default_port, 1);
  if (!parseNumericAddress(endpoint.address))
  {
    const std::optional<std::string> found = hostAddress(endpoint.address);
    if (!found)
    {
      setting.refuse("ADDRESS[:PORT], where ADDRESS is an IPv4 address or a host name that can be resolved now");
    }
    endpoint.address = *found;
  }
  if (*parseNumericAddress(endpoint.address) == INADDR_ANY)
  {
    setting.refuse("the address of one device");
  }
  return endpoint;
}

CIDR parseCIDR(const Setting& setting)
{
  const char* const allowed = "an IPv4 address, or a range like 192.168.1.0/24";
  const size_t slash = setting.value.find('/');
  const std::optional<uint32_t> address = parseNumericAddress(setting.value.substr(0, slash));
  if (!address)
  {
    setting.refuse(allowed);
  }
  CIDR range{*address, 32};
  if (slash != std::string::npos)
  {
    const std::string digits = setting.value.substr(slash + 1);
    const char* end = digits.data() + digits.size();
    const std::from_chars_result result = std::from_chars(digits.data(), end, range.prefix);
    if (result.ec != std::errc() || result.ptr != end || range.prefix < 0 || range.prefix > 32)
    {
      setting.refuse(allowed);
    }
  }
  range.network &= range.prefix == 0 ? 0 : ~uint32_t{0} << (32 - range.prefix);
  return range;
}

std::string parseWire(const Setting& setting)
{
  return parseChoice(setting, {"sp", "nanomsg"}, "sp or nanomsg");
}

// ----------------------------------------------------------------------------------------------------------- the file

/// Reads the maps of one YAML file: each key once, none that is unknown, scalars and lists where they belong.
class ConfigFile
{
public:
  explicit ConfigFile(std::string path) : path_(std::move(path)) {}

  /// The document; null if the file is empty.
  YAML::Node load() const
  {
    errno = 0;
    std::ifstream stream(path_);
    std::ostringstream text;
    if (stream.is_open() && stream.peek() != std::ifstream::traits_type::eof())
    {
      text << stream.rdbuf();
    }
    if (!stream.is_open() || stream.bad())
    {
      throw std::runtime_error("--config = \"" + path_ +
                               "\", must be a file that can be read: " + std::strerror(errno != 0 ? errno : EIO));
    }
    try
    {
      const std::vector<YAML::Node> documents = YAML::LoadAll(text.str());
      if (documents.size() > 1)
      {
        throw std::runtime_error(path_ + ": must hold one YAML document, holds " + std::to_string(documents.size()));
      }
      return documents.empty() ? YAML::Node() : documents.front();
    }
    catch (const YAML::ParserException& exception)
    {
      throw std::runtime_error(path_ + ":" + std::to_string(exception.mark.line + 1) +
                               ": is no YAML: " + exception.msg);
    }
  }

  std::string place(const YAML::Node& node, const std::string& key) const
  {
    return path_ + ":" + std::to_string(node.Mark().line + 1) + ": " + key;
  }

  Setting scalar(const YAML::Node& node, const std::string& key) const
  {
    if (!node.IsScalar())
    {
      throw std::runtime_error(place(node, key) + " = " + describe(node) + ", must be a single value");
    }
    return {place(node, key), node.Scalar()};
  }

  std::vector<Setting> list(const YAML::Node& node, const std::string& key) const
  {
    std::vector<Setting> settings;
    for (const YAML::Node& item : items(node, key))
    {
      settings.push_back(scalar(item, key + "[" + std::to_string(settings.size()) + "]"));
    }
    return settings;
  }

  std::vector<YAML::Node> items(const YAML::Node& node, const std::string& key) const
  {
    if (!node.IsSequence())
    {
      throw std::runtime_error(place(node, key) + " = " + describe(node) + ", must be a list like [a, b]");
    }
    return std::vector<YAML::Node>(node.begin(), node.end());
  }

  using Reader = std::function<void(const YAML::Node& value, const std::string& key)>;

  /// Calls the reader of each key of a map. `prefix` precedes the keys in messages.
  void readMap(const YAML::Node& map, const std::string& prefix, const std::map<std::string, Reader>& readers) const
  {
    if (!map.IsMap())
    {
      throw std::runtime_error(place(map, prefix) + (prefix.empty() ? "the file" : "") + " = " + describe(map) +
                               ", must be a map of keys and values");
    }
    std::set<std::string> seen;
    for (const auto& entry : map)
    {
      const std::string name = entry.first.IsScalar() ? entry.first.Scalar() : describe(entry.first);
      const std::string key = prefix.empty() ? name : prefix + "." + name;
      const auto reader = readers.find(name);
      if (reader == readers.end())
      {
        std::string known;
        for (const auto& [candidate, unused] : readers)
        {
          known += (known.empty() ? "" : ", ") + candidate;
        }
        throw std::runtime_error(place(entry.first, key) + " is no option, must be one of " + known);
      }
      if (!seen.insert(name).second)
      {
        throw std::runtime_error(place(entry.first, key) + " is given twice, must be given once");
      }
      reader->second(entry.second, key);
    }
  }

private:
  static std::string describe(const YAML::Node& node)
  {
    switch (node.Type())
    {
      case YAML::NodeType::Scalar:
        return "\"" + node.Scalar() + "\"";
      case YAML::NodeType::Sequence:
        return "a list";
      case YAML::NodeType::Map:
        return "a map";
      default:
        return "nothing";
    }
  }

  const std::string path_;
};

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

// --------------------------------------------------------------------------------------------------- the command line

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
  return formatAddress(network) + "/" + std::to_string(prefix);
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
  const std::optional<uint32_t> number = parseNumericAddress(address);
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
