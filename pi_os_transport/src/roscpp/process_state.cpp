#include "roscpp/process_state.h"

#include <ros/publication.h>
#include <ros/service_manager.h>
#include <ros/service_publication.h>
#include <ros/subscription.h>
#include <ros/this_node.h>
#include <ros/topic_manager.h>
#include <unistd.h>

#include <map>
#include <memory>
#include <set>
#include <vector>

#include "roscpp/fallback.h"
#include "json.h"
#include "roscpp/topics/receive_link.h"
#include "roscpp_version.h"
#include "roscpp/runtime.h"
#include "roscpp/services/service_caller.h"
#include "roscpp/services/service_responder.h"
#include "roscpp/topics/transmit_link.h"

namespace pi_os_transport
{
namespace
{

constexpr uint64_t STATE_VERSION = 1;

std::string patterns(const std::vector<std::string>& texts)
{
  std::vector<std::string> quoted;
  for (const std::string& text : texts)
  {
    quoted.push_back(jsonString(text));
  }
  return jsonArray(quoted);
}

std::string describeOptions(const Options& options)
{
  return JsonObject()
      .flag("enable", options.enable)
      .raw("include", patterns(options.include))
      .raw("exclude", patterns(options.exclude))
      .number("pool_limit_mb", options.pool_limit_mb)
      .number("min_bytes", options.min_bytes)
      .text("bridge", options.bridge)
      .toString();
}

std::string describePool(SlotPool& pool)
{
  const SlotPool::Usage usage = pool.usage();
  return JsonObject()
      .number("committed", usage.committed)
      .number("limit", usage.limit)
      .number("segments", usage.segments)
      .number("live_slots", usage.live_slots)
      .text("last_error", pool.lastError())
      .toString();
}

/// Why this process did not even ask for shared memory; NONE if it did.
Fallback ownReason(const std::string& name)
{
  const Options& options = Runtime::instance().options;
  return !options.enable ? Fallback::DISABLED : options.carries(name) ? Fallback::NONE : Fallback::EXCLUDED;
}

Fallback reasonOf(const std::string& name, const std::string& transport, Fallback of_peer)
{
  const Fallback own = ownReason(name);
  return transport == "UDPROS"   ? Fallback::UDP
         : transport != "TCPROS" ? Fallback::NONE
         : own != Fallback::NONE ? own
                                 : of_peer;
}

/// Why a subscriber's header led to no link.
Fallback askedReason(const ros::ConnectionPtr& connection)
{
  std::string version;
  return connection && connection->getHeader().getValue(HEADER_FIELD, version) ? Fallback::PEER_VERSION
                                                                               : Fallback::PEER_SILENT;
}

std::string describePublications()
{
  const ros::TopicManagerPtr& topics = ros::TopicManager::instance();
  std::vector<ros::PublicationPtr> publications;
  {
    boost::recursive_mutex::scoped_lock lock(topics->advertised_topics_mutex_);
    publications.assign(topics->advertised_topics_.begin(), topics->advertised_topics_.end());
  }
  std::vector<std::string> found;
  for (const ros::PublicationPtr& publication : publications)
  {
    ros::V_SubscriberLink links;
    {
      boost::mutex::scoped_lock lock(publication->subscriber_links_mutex_);
      links = publication->subscriber_links_;
    }
    for (const ros::SubscriberLinkPtr& link : links)
    {
      const auto* tcp = dynamic_cast<const ros::TransportSubscriberLink*>(link.get());
      const std::shared_ptr<TransmitLink> state =
          tcp != nullptr ? Runtime::instance().transmit_links.find(tcp->connection_.get()) : nullptr;
      const std::string transport = link->getTransportType();
      JsonObject object;
      object.text("topic", publication->getName())
          .text("type", publication->getDataType())
          .text("subscriber", link->getDestinationCallerID())
          .text("transport", transport);
      Fallback reason = tcp != nullptr ? askedReason(tcp->connection_) : Fallback::NONE;
      if (state)
      {
        reason = state->describe(&object);
      }
      object.text("reason", nameOf(reasonOf(publication->getName(), transport, reason)));
      found.push_back(object.toString());
    }
  }
  return jsonArray(found);
}

std::string describeSubscriptions()
{
  const ros::TopicManagerPtr& topics = ros::TopicManager::instance();
  std::vector<ros::SubscriptionPtr> subscriptions;
  {
    boost::mutex::scoped_lock lock(topics->subs_mutex_);
    subscriptions.assign(topics->subscriptions_.begin(), topics->subscriptions_.end());
  }
  std::vector<std::string> found;
  for (const ros::SubscriptionPtr& subscription : subscriptions)
  {
    ros::V_PublisherLink links;
    {
      boost::mutex::scoped_lock lock(subscription->publisher_links_mutex_);
      links = subscription->publisher_links_;
    }
    for (const ros::PublisherLinkPtr& link : links)
    {
      const auto* tcp = dynamic_cast<const ros::TransportPublisherLink*>(link.get());
      const std::shared_ptr<ReceiveLink> state =
          tcp != nullptr ? Runtime::instance().receive_links.find(tcp->connection_.get()) : nullptr;
      const std::string transport = link->getTransportType();
      JsonObject object;
      object.text("topic", subscription->getName())
          .text("type", subscription->datatype())
          .text("publisher", link->getCallerID())
          .text("uri", link->getPublisherXMLRPCURI())
          .text("transport", transport);
      Fallback reason = Fallback::NONE;
      if (state)
      {
        reason = state->describe(&object);
      }
      object.text("reason", nameOf(reasonOf(subscription->getName(), transport, reason)));
      found.push_back(object.toString());
    }
  }
  return jsonArray(found);
}

std::string describeServices(const ServiceStatisticsTable& table,
                             const std::map<std::string, std::set<std::string>>& peers,
                             const std::map<std::string, uint64_t>& connections)
{
  std::map<std::string, ServiceCounts> services;
  for (const auto& service : table.all())
  {
    services[service.first] = service.second->counts();
  }
  for (const auto& service : connections)
  {
    services[service.first];  // also those of which nothing is counted
  }
  std::vector<std::string> found;
  for (const auto& service : services)
  {
    const ServiceCounts& counts = service.second;
    const auto open = connections.find(service.first);
    const auto others = peers.find(service.first);
    std::vector<std::string> names;
    if (others != peers.end())
    {
      names.assign(others->second.begin(), others->second.end());
    }
    const Fallback own = ownReason(service.first);
    found.push_back(JsonObject()
                        .text("service", service.first)
                        .number("memory", counts.memory)
                        .number("tcp", counts.tcp)
                        .number("failed", counts.failed)
                        .number("pool_full", counts.pool_full)
                        .number("connections", open != connections.end() ? open->second : 0)
                        .raw("peers", patterns(names))
                        .text("reason", nameOf(own != Fallback::NONE ? own : counts.fallback))
                        .raw("durations", toJson(counts.durations.counts()))
                        .toString());
  }
  return jsonArray(found);
}

std::string describeClients()
{
  const ros::ServiceManagerPtr& manager = ros::ServiceManager::instance();
  std::map<std::string, uint64_t> connections;
  {
    boost::mutex::scoped_lock lock(manager->service_server_links_mutex_);
    for (const ros::ServiceServerLinkPtr& link : manager->service_server_links_)
    {
      ++connections[link->getServiceName()];
    }
  }
  return describeServices(Runtime::instance().called_services, {}, connections);
}

std::string describeServers()
{
  const ros::ServiceManagerPtr& manager = ros::ServiceManager::instance();
  std::vector<ros::ServicePublicationPtr> services;
  {
    boost::mutex::scoped_lock lock(manager->service_publications_mutex_);
    services.assign(manager->service_publications_.begin(), manager->service_publications_.end());
  }
  std::map<std::string, uint64_t> connections;
  std::map<std::string, std::set<std::string>> peers;
  for (const ros::ServicePublicationPtr& service : services)
  {
    boost::mutex::scoped_lock lock(service->client_links_mutex_);
    connections[service->getName()] = service->client_links_.size();
    for (const ros::ServiceClientLinkPtr& link : service->client_links_)
    {
      std::string client;
      if (link->connection_->getHeader().getValue("callerid", client))
      {
        peers[service->getName()].insert(client);
      }
    }
  }
  return describeServices(Runtime::instance().served_services, peers, connections);
}

}  // namespace

std::string toJson(const LatencyHistogram::Counts& counts)
{
  std::vector<std::string> numbers;
  for (const uint64_t count : counts)
  {
    numbers.push_back(std::to_string(count));
  }
  return jsonArray(numbers);
}

std::string describeProcess()
{
  Runtime& runtime = Runtime::instance();
  return JsonObject()
      .number("version", STATE_VERSION)
      .number("protocol", PROTOCOL_VERSION)
      .text("node", ros::this_node::getName())
      .number("pid", static_cast<uint64_t>(getpid()))
      .text("roscpp", ROSCPP_FILE_NAME)
      .raw("options", describeOptions(runtime.options))
      .raw("pool", describePool(runtime.pool()))
      .raw("publications", describePublications())
      .raw("subscriptions", describeSubscriptions())
      .raw("service_clients", describeClients())
      .raw("service_servers", describeServers())
      .toString();
}

}  // namespace pi_os_transport
