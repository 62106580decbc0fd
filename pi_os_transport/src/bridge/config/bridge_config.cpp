#include "bridge/config/bridge_config.h"

#include <fnmatch.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <iterator>
#include <map>
#include <stdexcept>
#include <utility>

#include "bridge/config/config_file.h"
#include "bridge/config/setting.h"
#include "wire/ipv4.h"
#include "wire/tls_keys.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t MAX_POOL_MB = 65536;
constexpr uint32_t MAX_MESSAGE_MB = 1024;
constexpr int MOST_NICE = -20;  ///< in the words of nice(1): the most favourable
constexpr int LEAST_NICE = 19;
constexpr int JPEG_QUALITY = 80;
constexpr int PNG_LEVEL = 3;

std::string hostName()
{
  char name[MAX_NAME + 1] = {};
  return gethostname(name, MAX_NAME) == 0 && name[0] != '\0' ? name : "unnamed";
}

TopicOptions readTopic(const ConfigFile& file, const YAML::Node& node, const std::string& prefix)
{
  TopicOptions topic;
  std::optional<Setting> quality;
  const auto scalar = [&file](auto apply)
  { return [&file, apply](const YAML::Node& value, const std::string& key) { apply(file.scalar(value, key)); }; };
  const auto match = [&topic](const Setting& setting)
  {
    topic.match = setting.value;
    if (topic.match.empty() || std::strchr("/*?[", topic.match.front()) == nullptr)
    {
      setting.refuse("a shell pattern for full topic names, which start with \"/\"");
    }
  };
  const auto priority = [&topic](const Setting& setting)
  {
    const std::string choice = parseChoice(setting, {"high", "normal", "low"}, "high, normal or low");
    topic.priority = choice == "high"  ? TopicOptions::Priority::HIGH
                     : choice == "low" ? TopicOptions::Priority::LOW
                                       : TopicOptions::Priority::NORMAL;
  };
  const auto compression = [&topic](const Setting& setting) {
    topic.compression = parseChoice(setting, {"", "jpeg", "png"}, "jpeg, png or \"\" for none");
  };
  file.readMap(node, prefix,
               {{"match", scalar(match)},
                {"priority", scalar(priority)},
                {"rate_limit_hz", scalar([&](const Setting& setting) { topic.rate_limit_hz = parseRate(setting); })},
                {"keep_latest", scalar([&](const Setting& setting) { topic.keep_latest = parseSwitch(setting); })},
                {"compression", scalar(compression)},
                {"quality", scalar([&](const Setting& setting) { quality = setting; })},
                {"forward", scalar([&](const Setting& setting) { topic.forward = parseSwitch(setting); })}});
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

TrustOptions readTrust(const ConfigFile& file, const YAML::Node& node, const std::string& prefix)
{
  TrustOptions trust;
  file.readMap(
      node, prefix,
      {{"name", [&](const YAML::Node& value, const std::string& key) { trust.name = file.scalar(value, key).value; }},
       {"allow",
        [&](const YAML::Node& value, const std::string& key) { trust.allow = parseSwitch(file.scalar(value, key)); }},
       {"topics", [&](const YAML::Node& value, const std::string& key)
        {
          for (const Setting& pattern : file.list(value, key))
          {
            trust.topics.push_back(pattern.value);
          }
        }}});
  if (trust.name.empty())
  {
    throw std::runtime_error(file.place(node, prefix) +
                             ".name is missing, must be a shell pattern of device names like \"edge*\"");
  }
  return trust;
}

using Settings = std::vector<Setting>;

/// An option of the file, of the command line, or of both.
struct Option
{
  std::string key;   ///< in the file; empty: not there
  std::string flag;  ///< on the command line; empty: not there
  bool is_list;
  std::function<void(const Settings& given, BridgeConfig* config)> apply;
};

template <typename Field, typename Parse>
Option single(const char* key, const char* flag, Field BridgeConfig::*field, Parse parse)
{
  return {key, flag, false,
          [=](const Settings& given, BridgeConfig* config) { config->*field = parse(given.front()); }};
}

template <typename Element, typename Parse>
Option list(const char* key, const char* flag, std::vector<Element> BridgeConfig::*field, Parse parse)
{
  return {key, flag, true,
          [=](const Settings& given, BridgeConfig* config)
          {
            std::vector<Element> elements;
            std::transform(given.begin(), given.end(), std::back_inserter(elements), parse);
            config->*field = std::move(elements);
          }};
}

void readFile(const std::string& path, BridgeConfig* config);

/// [NAME@]ADDRESS[:PORT]
void readPeers(const Settings& given, BridgeConfig* config)
{
  config->peers.clear();
  config->peer_names.clear();
  for (const Setting& setting : given)
  {
    const size_t at = setting.value.find('@');
    const std::string name = at != std::string::npos ? setting.value.substr(0, at) : std::string();
    if (at != std::string::npos && !isIdentity(name))
    {
      setting.refuse("[NAME@]ADDRESS[:PORT], where NAME is that of a certificate: letters, digits, '.', '_' or '-'");
    }
    const size_t address = at != std::string::npos ? at + 1 : 0;
    config->peers.push_back(parseReachable({setting.place, setting.value.substr(address)}, BRIDGE_PORT));
    if (!name.empty())
    {
      config->peer_names[config->peers.back()] = name;
    }
  }
}

/// The file comes first: the others win over it.
const std::vector<Option>& options()
{
  static const std::vector<Option> OPTIONS{
      {"", "--config", false,
       [](const Settings& given, BridgeConfig* config) { readFile(given.front().value, config); }},
      single("name", "--name", &BridgeConfig::name, parseDeviceName),
      list("listen", "--listen", &BridgeConfig::listen, parseListen),
      single("advertise", "--advertise", &BridgeConfig::advertise,
             [](const Setting& setting) { return setting.value.empty() ? Endpoint{} : parseReachable(setting, 0); }),
      {"peers", "--peer", true, readPeers},
      list("allow", "--allow", &BridgeConfig::allow, parseCIDR),
      single("master", "--master", &BridgeConfig::master, parseMasterUri),
      single("secure", "--secure", &BridgeConfig::secure,
             [](const Setting& setting) {
               return parseChoice(setting, {"off", "tls"}, "off or tls");
             }),
      single("keys", "--keys", &BridgeConfig::keys, [](const Setting& setting) { return setting.value; }),
      single("wire", "--wire", &BridgeConfig::wire,
             [](const Setting& setting) {
               return parseChoice(setting, {"sp", "nanomsg"}, "sp or nanomsg");
             }),
      single("socket", "--socket", &BridgeConfig::socket, parseSocketName),
      single("nice", "--nice", &BridgeConfig::nice,
             [](const Setting& setting) { return parseWhole(setting, MOST_NICE, LEAST_NICE); }),
      single("pool_limit_mb", "", &BridgeConfig::pool_limit_mb,
             [](const Setting& setting) { return parseWhole<uint64_t>(setting, 1, MAX_POOL_MB); }),
      single("max_message_mb", "", &BridgeConfig::max_message_mb,
             [](const Setting& setting) { return parseWhole<uint32_t>(setting, 1, MAX_MESSAGE_MB); }),
  };
  return OPTIONS;
}

void readFile(const std::string& path, BridgeConfig* config)
{
  const ConfigFile file(path);
  const YAML::Node document = file.load();
  if (document.IsNull())
  {
    return;
  }
  std::map<std::string, ConfigFile::Reader> readers;
  for (const Option& option : options())
  {
    readers[option.key] = [&](const YAML::Node& value, const std::string& key)
    {
      const Settings given = option.is_list ? file.list(value, key) : Settings{file.scalar(value, key)};
      if (given.empty() && option.key == "listen")
      {
        throw std::runtime_error(file.place(value, key) + " = [], must name at least one ADDRESS[:PORT]");
      }
      option.apply(given, config);
    };
  }
  readers.erase("");
  readers["topics"] = [&](const YAML::Node& value, const std::string& key)
  {
    for (const YAML::Node& item : file.items(value, key))
    {
      config->topics.push_back(readTopic(file, item, key + "[" + std::to_string(config->topics.size()) + "]"));
    }
  };
  readers["trust"] = [&](const YAML::Node& value, const std::string& key)
  {
    for (const YAML::Node& item : file.items(value, key))
    {
      config->trust.push_back(readTrust(file, item, key + "[" + std::to_string(config->trust.size()) + "]"));
    }
  };
  file.readMap(document, "", readers);
}

/// Options that are valid alone and not together.
void requireAgreement(const BridgeConfig& config)
{
  if (config.isSecure() && config.wire != "sp")
  {
    throw std::runtime_error("secure = \"tls\" with wire = \"" + config.wire +
                             "\": libnanomsg cannot encrypt, wire must be sp");
  }
  if (!config.isSecure() && !(config.trust.empty() && config.peer_names.empty()))
  {
    throw std::runtime_error(
        "trust, and a NAME@ in peers, with secure = \"off\": names are proved by keys, secure must "
        "be tls");
  }
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

const TrustOptions* BridgeConfig::trustOf(const std::string& identity) const
{
  const auto found = std::find_if(trust.begin(), trust.end(),
                                  [&identity](const TrustOptions& options)
                                  { return fnmatch(options.name.c_str(), identity.c_str(), 0) == 0; });
  return found != trust.end() ? &*found : nullptr;
}

bool BridgeConfig::trusts(const std::string& identity, const std::string& full_name) const
{
  const TrustOptions* const options = trustOf(identity);
  return !isSecure() || trust.empty() ||
         (options != nullptr && options->allow &&
          (options->topics.empty() || std::any_of(options->topics.begin(), options->topics.end(),
                                                  [&full_name](const std::string& pattern)
                                                  { return fnmatch(pattern.c_str(), full_name.c_str(), 0) == 0; })));
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
         "  --peer [NAME@]ADDRESS[:PORT]  bridge to connect to from the start, with the name in its certificate; "
         "repeatable\n"
         "                              (others: when a node needs one)\n"
         "  --allow CIDR                who may connect, like 192.168.1.0/24; repeatable (default: peers, and devices "
         "whose\n"
         "                              nodes the ROS master knows)\n"
         "  --master URI                of the ROS master (default: ROS_MASTER_URI, else http://localhost:11311)\n"
         "  --secure off|tls            tls: only protected connections, both ends prove who they are (default: off)\n"
         "  --keys FOLDER               keys of this device, see pi_os keys (default: ~/.config/pi_os/keys)\n"
         "  --wire sp|nanomsg           sockets of its own or libnanomsg; both understand each other (default: sp)\n"
         "  --socket NAME               nodes with PI_OS_BRIDGE=NAME use this bridge (default: default)\n"
         "  --nice NUMBER               -20 to 19: below 0, it runs before programs that use the same cores (default: "
         "0)\n"
         "  --help                      this text\n"
         "\n"
         "Arguments like __name:=x are roslaunch's and ignored. SIGTERM and SIGINT end it.\n"
         "Counters: rosrun pi_os_transport pi_os status\n";
}

std::optional<BridgeConfig> loadBridgeConfig(int argc, const char* const* argv)
{
  std::vector<std::string> words;
  std::copy_if(argv + 1, argv + argc, std::back_inserter(words),
               [](const std::string& word) { return word.find(":=") == std::string::npos; });
  std::map<const Option*, Settings> arguments;  // in the order of the table
  for (auto word = words.begin(); word != words.end(); ++word)
  {
    if (*word == "--help" || *word == "-h")
    {
      return std::nullopt;
    }
    const size_t equals = word->find('=');
    const std::string flag = word->substr(0, equals);
    const auto option = std::find_if(options().begin(), options().end(),
                                     [&flag](const Option& known) { return !flag.empty() && known.flag == flag; });
    if (option == options().end())
    {
      throw std::runtime_error("\"" + *word + "\" is no option, see --help");
    }
    if (equals == std::string::npos && std::next(word) == words.end())
    {
      throw std::runtime_error(flag + " lacks its value, see --help");
    }
    const std::string value = equals != std::string::npos ? word->substr(equals + 1) : *++word;
    Settings& given = arguments[&*option];
    if (!given.empty() && !option->is_list)
    {
      throw std::runtime_error(flag + " = \"" + value + "\" comes after " + flag + " = \"" + given[0].value +
                               "\", must be given once");
    }
    given.push_back({flag, value});
  }
  BridgeConfig config;
  config.name = hostName();
  for (const auto& [option, given] : arguments)
  {
    option->apply(given, &config);
  }
  requireAgreement(config);
  return config;
}

}  // namespace pi_os_transport
