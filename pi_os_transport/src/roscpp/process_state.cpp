#include "roscpp/process_state.h"

#include <dirent.h>
#include <ros/publication.h>
#include <ros/service_manager.h>
#include <ros/service_publication.h>
#include <ros/subscription.h>
#include <ros/this_node.h>
#include <ros/topic_manager.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <map>
#include <memory>
#include <set>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "roscpp/fallback.h"
#include "roscpp/runtime.h"
#include "roscpp/services/service_caller.h"
#include "roscpp/services/service_responder.h"
#include "roscpp/topics/receive_link.h"
#include "roscpp/topics/transmit_link.h"
#include "roscpp_version.h"

namespace pi_os_transport
{
namespace
{

using Json = nlohmann::ordered_json;

constexpr int STATE_VERSION = 2;

Json describeOptions(const Options& options)
{
  return {{"enable", options.enable},       {"include", options.include},
          {"exclude", options.exclude},     {"pool_limit_mb", options.pool_limit_mb},
          {"min_bytes", options.min_bytes}, {"skip_zero_fill", options.skip_zero_fill},
          {"bridge", options.bridge}};
}

Json describeDescriptors()
{
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  uint64_t open = limit.rlim_cur;  // if there is not even one to count with
  if (DIR* const folder = opendir("/proc/self/fd"))
  {
    open = 0;
    while (const dirent* const entry = readdir(folder))
    {
      open += entry->d_name[0] != '.' && std::atoi(entry->d_name) != dirfd(folder) ? 1 : 0;
    }
    closedir(folder);
  }
  return {{"open", open}, {"limit", limit.rlim_cur}};
}

Json describePool(SlotPool& pool)
{
  const SlotPool::Usage usage = pool.usage();
  return {{"committed", usage.committed},
          {"limit", usage.limit},
          {"segments", usage.segments},
          {"live_slots", usage.live_slots},
          {"last_error", pool.lastError()}};
}

/// Why this process did not request shared memory; NONE if it did.
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

/// Why a subscriber's header did not lead to a link.
Fallback askedReason(const ros::ConnectionPtr& connection)
{
  std::string version;
  return connection && connection->getHeader().getValue(HEADER_FIELD, version) ? Fallback::PEER_VERSION
                                                                               : Fallback::PEER_SILENT;
}

Json describePublications()
{
  const ros::TopicManagerPtr& topics = ros::TopicManager::instance();
  std::vector<ros::PublicationPtr> publications;
  {
    boost::recursive_mutex::scoped_lock lock(topics->advertised_topics_mutex_);
    publications.assign(topics->advertised_topics_.begin(), topics->advertised_topics_.end());
  }
  Json found = Json::array();
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
      Json object{{"topic", publication->getName()},
                  {"type", publication->getDataType()},
                  {"subscriber", link->getDestinationCallerID()},
                  {"transport", transport}};
      Fallback reason = tcp != nullptr ? askedReason(tcp->connection_) : Fallback::NONE;
      if (state)
      {
        reason = state->describe(&object);
      }
      object["reason"] = nameOf(reasonOf(publication->getName(), transport, reason));
      found.push_back(std::move(object));
    }
  }
  return found;
}

Json describeSubscriptions()
{
  const ros::TopicManagerPtr& topics = ros::TopicManager::instance();
  std::vector<ros::SubscriptionPtr> subscriptions;
  {
    boost::mutex::scoped_lock lock(topics->subs_mutex_);
    subscriptions.assign(topics->subscriptions_.begin(), topics->subscriptions_.end());
  }
  Json found = Json::array();
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
      Json object{{"topic", subscription->getName()},
                  {"type", subscription->datatype()},
                  {"publisher", link->getCallerID()},
                  {"uri", link->getPublisherXMLRPCURI()},
                  {"transport", transport}};
      Fallback reason = Fallback::NONE;
      if (state)
      {
        reason = state->describe(&object);
      }
      object["reason"] = nameOf(reasonOf(subscription->getName(), transport, reason));
      found.push_back(std::move(object));
    }
  }
  return found;
}

Json describeServices(const ServiceStatisticsTable& table, const std::map<std::string, std::set<std::string>>& peers,
                      const std::map<std::string, uint64_t>& connections)
{
  std::map<std::string, ServiceCounts> services;
  for (const auto& service : table.all())
  {
    services[service.first] = service.second->counts();
  }
  for (const auto& service : connections)
  {
    services[service.first];  // also services without counted calls
  }
  Json found = Json::array();
  for (const auto& service : services)
  {
    const ServiceCounts& counts = service.second;
    const auto open = connections.find(service.first);
    const auto others = peers.find(service.first);
    const Fallback own = ownReason(service.first);
    found.push_back({{"service", service.first},
                     {"memory", counts.memory},
                     {"tcp", counts.tcp},
                     {"failed", counts.failed},
                     {"pool_full", counts.pool_full},
                     {"connections", open != connections.end() ? open->second : 0},
                     {"peers", others != peers.end() ? Json(others->second) : Json::array()},
                     {"reason", nameOf(own != Fallback::NONE ? own : counts.fallback)},
                     {"durations", counts.durations.counts()}});
  }
  return found;
}

Json describeClients()
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

Json describeServers()
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

std::string describeProcess()
{
  Runtime& runtime = Runtime::instance();
  const Json state{{"version", STATE_VERSION},
                   {"protocol", PROTOCOL_VERSION},
                   {"node", ros::this_node::getName()},
                   {"pid", getpid()},
                   {"roscpp", ROSCPP_FILE_NAME},
                   {"options", describeOptions(runtime.options)},
                   {"descriptors", describeDescriptors()},
                   {"pool", describePool(runtime.pool())},
                   {"skipped_zero_fills", runtime.skipped_zero_fills.load()},
                   {"publications", describePublications()},
                   {"subscriptions", describeSubscriptions()},
                   {"service_clients", describeClients()},
                   {"service_servers", describeServers()}};
  // Names come from other processes: replace invalid UTF-8.
  return state.dump(-1, ' ', true, Json::error_handler_t::replace);
}

}  // namespace pi_os_transport
