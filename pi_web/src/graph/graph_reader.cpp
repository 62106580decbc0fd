#include "graph/graph_reader.h"

#include <xmlrpcpp/XmlRpcException.h>

#include <chrono>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace pi_web
{
namespace
{

using XmlRpc::XmlRpcValue;

constexpr size_t MAX_XML_BYTES = 32 * 1024 * 1024;
constexpr size_t MAX_HEADER_BYTES = 1024 * 1024;
constexpr size_t MAX_RESPONSE_BYTES = 16 * 1024 * 1024;
constexpr int64_t ASK_AGAIN_NS = 10000000000;

int64_t nowNs()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// [[name, [node, ...]], ...]
std::map<std::string, std::set<std::string>> nodesByName(XmlRpcValue& list)
{
  std::map<std::string, std::set<std::string>> result;
  for (int i = 0; i < list.size(); ++i)
  {
    std::set<std::string>& nodes = result[list[i][0]];
    for (int j = 0; j < list[i][1].size(); ++j)
    {
      nodes.insert(list[i][1][j]);
    }
  }
  return result;
}

}  // namespace

GraphReader::GraphReader(const std::string& master_uri, const std::string& caller, std::set<std::string> services,
                         double limit_s)
  : master_uri_(master_uri), caller_(caller), services_(std::move(services)), limit_s_(limit_s)
{
}

XmlRpcValue GraphReader::execute(const std::string& uri, const std::string& method,
                                 const std::vector<XmlRpcValue>& arguments) const
{
  std::string body = "<?xml version=\"1.0\"?>\n<methodCall><methodName>" + method + "</methodName><params><param>" +
                     XmlRpcValue(caller_).toXml() + "</param>";
  for (const XmlRpcValue& argument : arguments)
  {
    body += "<param>" + argument.toXml() + "</param>";
  }
  body += "</params></methodCall>\n";
  const auto [host, port] = addressOf(uri);
  Peer peer(host, port, limit_s_);
  peer.write("POST / HTTP/1.0\r\nHost: " + host + "\r\nContent-Type: text/xml\r\nContent-Length: " +
             std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n" + body);
  // Some servers keep the connection in spite of the request: the length tells the end.
  std::string answer;
  size_t head = std::string::npos;
  while (head == std::string::npos)
  {
    answer += peer.read(1);
    if (answer.size() > MAX_HEADER_BYTES)
    {
      throw std::runtime_error(uri + " sends an endless header");
    }
    head = answer.size() >= 4 && answer.compare(answer.size() - 4, 4, "\r\n\r\n") == 0 ? answer.size() : head;
  }
  for (char& c : answer)
  {
    c = c >= 'A' && c <= 'Z' ? static_cast<char>(c + 'a' - 'A') : c;
  }
  const size_t length = answer.find("content-length:");
  const size_t bytes = length == std::string::npos ? 0 : std::strtoul(answer.c_str() + length + 15, nullptr, 10);
  if (bytes > MAX_XML_BYTES)
  {
    throw std::runtime_error(uri + " announces " + std::to_string(bytes) + " bytes");
  }
  const std::string xml = length == std::string::npos ? peer.readAll(MAX_XML_BYTES) : peer.read(bytes);
  const size_t param = xml.find("<param>");
  XmlRpcValue result;
  int offset = param == std::string::npos ? 0 : static_cast<int>(param) + 7;
  if (param == std::string::npos || !result.fromXml(xml, &offset) || result.getType() != XmlRpcValue::TypeArray ||
      result.size() != 3 || static_cast<int>(result[0]) != 1)
  {
    const bool told = result.getType() == XmlRpcValue::TypeArray && result.size() == 3 &&
                      result[1].getType() == XmlRpcValue::TypeString;
    throw std::runtime_error(method + ": " + (told ? static_cast<std::string>(result[1]) : "no answer of " + uri));
  }
  return result[2];
}

XmlRpcValue GraphReader::master(const std::string& method, const std::vector<XmlRpcValue>& arguments) const
{
  return execute(master_uri_, method, arguments);
}

GraphState GraphReader::read()
{
  GraphState state;
  try
  {
    XmlRpcValue all = master("getSystemState", {});
    state.publishers = nodesByName(all[0]);
    state.subscribers = nodesByName(all[1]);
    state.providers = nodesByName(all[2]);
    XmlRpcValue types = master("getTopicTypes", {});
    for (int i = 0; i < types.size(); ++i)
    {
      state.types[types[i][0]] = static_cast<std::string>(types[i][1]);
    }
  }
  catch (const XmlRpc::XmlRpcException& error)
  {
    throw std::runtime_error(master_uri_ + " answers nonsense: " + error.getMessage());
  }
  for (const std::string& service : services_)
  {
    if (state.providers.count(service) != 0)
    {
      try
      {
        const std::string uri = master("lookupService", {service});
        std::string& type = service_types_[service + " " + uri];
        type = type.empty() ? serviceType(service) : type;
        state.service_types[service] = type;
      }
      catch (const std::runtime_error&)
      {
        // It ended just now, or hangs: not offered until it answers.
      }
    }
  }
  return state;
}

void GraphReader::askNode(const std::string& node, const std::function<bool()>& ask)
{
  int64_t& not_before_ns = not_before_ns_[node];
  if (nowNs() < not_before_ns)
  {
    return;
  }
  bool well = false;
  try
  {
    well = ask();
  }
  catch (const std::runtime_error&)
  {
    // It ended just now, hangs, or publishes no more.
  }
  catch (const XmlRpc::XmlRpcException&)
  {
    // It answers nonsense.
  }
  not_before_ns = well ? 0 : nowNs() + ASK_AGAIN_NS;
}

bool GraphReader::learnType(const std::string& topic, const std::string& type, const std::set<std::string>& nodes)
{
  for (const std::string& node : nodes)
  {
    if (types_.count(type) != 0)
    {
      break;
    }
    askNode(node,
            [&]
            {
              XmlRpcValue protocols;
              protocols[0][0] = std::string("TCPROS");
              XmlRpcValue answer = execute(master("lookupNode", {node}), "requestTopic", {topic, protocols});
              Peer peer(answer[1], static_cast<uint16_t>(static_cast<int>(answer[2])), limit_s_);
              peer.write(encodeHeader(
                  {{"callerid", caller_}, {"topic", topic}, {"type", type}, {"md5sum", "*"}, {"tcp_nodelay", "1"}}));
              HeaderFields fields = decodeHeader(peer.readBlock(MAX_HEADER_BYTES));
              if (fields["type"] == type && fields["md5sum"].size() == 32)
              {
                types_[type] = {fields["md5sum"], fields["message_definition"]};
              }
              return fields["type"] == type;
            });
  }
  return types_.count(type) != 0;
}

std::map<std::string, Links> GraphReader::links(const GraphState& graph)
{
  std::set<std::string> nodes;
  for (const auto& [topic, publishers] : graph.publishers)
  {
    nodes.insert(publishers.begin(), publishers.end());
  }
  nodes.erase(caller_);  // would wait for itself
  std::map<std::string, Links> result;
  for (const std::string& node : nodes)
  {
    askNode(node,
            [&]
            {
              // [[id, peer, direction, transport, topic, connected, ...], ...]
              XmlRpcValue links = execute(master("lookupNode", {node}), "getBusInfo", {});
              for (int i = 0; i < links.size(); ++i)
              {
                XmlRpcValue& link = links[i];
                if (link.size() > 4 && static_cast<std::string>(link[2]) == "o")
                {
                  Links& of = result[link[3]];
                  ++of.count;
                  of.topics.insert(link[4]);
                }
              }
              return true;
            });
  }
  return result;
}

std::string GraphReader::serviceType(const std::string& service) const
{
  const auto [host, port] = addressOf(master("lookupService", {service}));
  Peer peer(host, port, limit_s_);
  peer.write(encodeHeader({{"callerid", caller_}, {"service", service}, {"md5sum", "*"}, {"probe", "1"}}));
  return decodeHeader(peer.readBlock(MAX_HEADER_BYTES))["type"];
}

Payload GraphReader::call(const std::string& service, std::string_view request, double limit_s) const
{
  const auto [host, port] = addressOf(master("lookupService", {service}));
  Peer peer(host, port, limit_s);
  peer.write(encodeHeader({{"callerid", caller_}, {"service", service}, {"md5sum", "*"}}));
  HeaderFields fields = decodeHeader(peer.readBlock(MAX_HEADER_BYTES));
  if (fields.count("error") != 0)
  {
    throw std::runtime_error(service + ": " + fields["error"]);
  }
  std::string bytes;  // not with the header: rospy would lose what comes behind it
  appendUint32(static_cast<uint32_t>(request.size()), &bytes);
  peer.write(bytes.append(request));
  const bool well = peer.read(1)[0] == 1;
  const std::string response = peer.readBlock(MAX_RESPONSE_BYTES);
  if (!well)
  {
    throw std::runtime_error(service + ": " + (response.empty() ? "the service failed" : response));
  }
  return std::make_shared<Bytes>(response.begin(), response.end());
}

}  // namespace pi_web
