// Replaces the functions of roscpp that look up services, connect to them, call and answer. Compiled without access
// control, like roscpp_hooks.cpp.

#include "roscpp/hooks.h"

#include <ros/transport/transport.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "event_loop/if_alive.h"
#include "roscpp/bridge_client.h"
#include "roscpp/runtime.h"
#include "roscpp/services/idle_services.h"
#include "roscpp/services/service_caller.h"
#include "roscpp/services/service_responder.h"
#include "roscpp/services/tcp_calls.h"
#include "roscpp/topics/header_offer.h"

namespace pi_os_transport
{
namespace
{

/// Address of a service.
struct ServiceAddress
{
  std::string name;
  std::string host;
  uint32_t port = 0;
};

/// The last lookup of this thread, which connects to it next.
thread_local ServiceAddress looked_up;

/// Result of this thread's next lookup, known without the master; port 0: unknown.
thread_local ServiceAddress known_address;

bool lookupService(ros::ServiceManager* self, const std::string& name, std::string& host, uint32_t& port)
{
  ServiceAddress known = std::exchange(known_address, ServiceAddress{});
  if (known.port != 0 && known.name == name)
  {
    host = known.host;
    port = known.port;
    looked_up = std::move(known);
    return true;
  }
  const bool found = Runtime::instance().original.lookup_service(self, name, host, port);
  looked_up = found ? ServiceAddress{name, host, port} : ServiceAddress{};
  return found;
}

/// Connects a client to a service on another device through the bridges, if they run. Not for synchronous connections,
/// which only test whether the server lives: the local bridge cannot tell.
bool connectTcp(ros::TransportTCP* self, const std::string& host, int port)
{
  Runtime& runtime = Runtime::instance();
  const ServiceAddress service = std::exchange(looked_up, ServiceAddress{});
  if (!runtime.active() || service.port == 0 || service.host != host || static_cast<int>(service.port) != port ||
      (self->flags_ & ros::TransportTCP::SYNCHRONOUS) != 0)
  {
    return runtime.original.tcp_connect(self, host, port);
  }
  if (runtime.options.carries(service.name))
  {
    FileDescriptor socket = BridgeClient::instance().openTunnel(host, static_cast<uint16_t>(port), service.name);
    if (socket)
    {
      self->connected_host_ = host;
      self->connected_port_ = port;
      self->cached_remote_host_ = host + ":" + std::to_string(port) + " through the bridge";
      BridgeClient::instance().guard(boost::static_pointer_cast<ros::TransportTCP>(self->shared_from_this()));
      return self->setSocket(socket.release());
    }
  }
  if (BridgeClient::isRequiredFor(host))
  {
    BridgeClient::instance().warnOfRequired(service.name,
                                            "calls of " + service.name +
                                                " on another device fail, because no bridge carries them: start "
                                                "pi_os_bridge on both devices and look at its messages");
    return false;
  }
  return runtime.original.tcp_connect(self, host, port);
}

/// The kept connection that createLink() of this thread returned; the call follows.
thread_local IdleService taken;

/// The kind of connection that this thread's next createLink() makes.
enum class LinkWanted
{
  ANY,
  FRESH,  ///< not a kept one
  PLAIN,  ///< a new one on TCPROS
};
thread_local LinkWanted link_wanted = LinkWanted::ANY;

/// Equal for connections to the same server with the same header.
std::string keyOf(const std::string& service, const std::string& md5, const ros::M_string& fields,
                  const ServiceAddress& address)
{
  std::string key = address.host + ":" + std::to_string(address.port) + "\n" + service + "\n" + md5;
  for (const auto& field : fields)
  {
    key += "\n" + field.first + "=" + field.second;
  }
  return key;
}

ros::ServiceServerLinkPtr createLink(ros::ServiceManager* self, const std::string& service, bool persistent,
                                     const std::string& request_md5, const std::string& response_md5,
                                     const ros::M_string& fields)
{
  Runtime& runtime = Runtime::instance();
  const auto create = [&]()
  { return runtime.original.service_create_link(self, service, persistent, request_md5, response_md5, fields); };
  if (persistent || !runtime.active() || !runtime.options.carries(service))
  {
    return create();
  }
  boost::recursive_mutex::scoped_lock shutdown_lock(self->shutting_down_mutex_);
  ServiceAddress address{service, "", 0};
  if (self->shutting_down_ || !self->lookupService(service, address.host, address.port))
  {
    return ros::ServiceServerLinkPtr();
  }
  const std::string key = keyOf(service, request_md5, fields, address);
  if (link_wanted == LinkWanted::ANY)
  {
    taken = IdleServices::instance().take(key);
    if (taken.link)
    {
      return taken.link;
    }
  }
  if (IdleServices::instance().negotiates(key))
  {
    link_wanted = LinkWanted::PLAIN;
  }
  known_address = address;
  const ros::ServiceServerLinkPtr link = create();
  known_address = ServiceAddress{};
  link_wanted = LinkWanted::ANY;
  const std::shared_ptr<ServiceCaller> caller =
      link ? runtime.service_callers.find(link->getConnection().get()) : nullptr;
  if (caller)
  {
    caller->setKey(key);
  }
  return link;
}

bool initialize(ros::ServiceServerLink* self, const ros::ConnectionPtr& connection)
{
  Runtime& runtime = Runtime::instance();
  if (!runtime.active() || !connection->getTransport()->requiresHeader() ||
      !runtime.options.carries(self->getServiceName()))
  {
    return runtime.original.service_initialize(self, connection);
  }
  const auto caller =
      std::make_shared<ServiceCaller>(self->getServiceName(), connection,
                                      self->isPersistent()               ? ServiceCaller::Use::PERSISTENT
                                      : link_wanted == LinkWanted::PLAIN ? ServiceCaller::Use::SINGLE_SHOT_PLAIN
                                                                         : ServiceCaller::Use::SINGLE_SHOT);
  runtime.service_callers.hold(connection, caller, [caller](ros::Connection::DropReason) { caller->disconnect(); });
  if (!caller->promising())
  {
    return runtime.original.service_initialize(self, connection);
  }
  OfferScope scope(std::to_string(PROTOCOL_VERSION));
  return runtime.original.service_initialize(self, connection);
}

bool headerReceived(ros::ServiceServerLink* self, const ros::ConnectionPtr& connection, const ros::Header& header)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ServiceCaller> caller =
      runtime.active() ? runtime.service_callers.find(connection.get()) : nullptr;
  if (caller && caller->promising())
  {
    std::string offer;
    header.getValue(HEADER_FIELD, offer);
    if (caller->meet(offer))
    {
      self->persistent_ = true;  // callService() decides whether the connection ends
      // roscpp sets this after sending the waiting request. The answer and a further request could come earlier, and
      // roscpp would never send that request.
      boost::mutex::scoped_lock lock(self->call_queue_mutex_);
      self->header_read_ = true;
    }
  }
  return runtime.original.service_header_received(self, connection, header);
}

/// A single-shot call on a connection from createLink().
bool callOnce(ros::ServiceServerLink* self, const std::shared_ptr<ServiceCaller>& caller, bool was_kept,
              const ros::SerializedMessage& request, ros::SerializedMessage& response)
{
  using Outcome = ServiceCaller::Outcome;
  const Outcome outcome = caller->call(self, request, response, !was_kept);
  const bool keep = caller->promising();
  if (keep)
  {
    IdleServices::instance().put(IdleService{self->shared_from_this(), caller});
  }
  else
  {
    self->getConnection()->drop(ros::Connection::Destructing);
  }
  if (!was_kept || outcome != Outcome::NOT_TAKEN)
  {
    return outcome == Outcome::SUCCESS;
  }
  // The server has closed the kept connection, or the request cannot use shared memory: make a new connection.
  link_wanted = keep ? LinkWanted::PLAIN : LinkWanted::FRESH;
  const ros::ServiceServerLinkPtr fresh = ros::ServiceManager::instance()->createServiceServerLink(
      self->getServiceName(), false, self->getRequestMD5Sum(), self->getResponseMD5Sum(),
      self->extra_outgoing_header_values_);
  link_wanted = LinkWanted::ANY;
  return fresh && fresh->call(request, response);
}

bool callService(ros::ServiceServerLink* self, const ros::SerializedMessage& request, ros::SerializedMessage& response)
{
  Runtime& runtime = Runtime::instance();
  const IdleService kept = std::exchange(taken, IdleService{});
  if (kept.link.get() == self)
  {
    return callOnce(self, kept.caller, true, request, response);
  }
  if (!runtime.active())
  {
    return runtime.original.service_call(self, request, response);
  }
  const std::shared_ptr<ServiceCaller> caller = runtime.service_callers.find(self->getConnection().get());
  if (!caller)
  {
    return callOverTcp(self, request, response);
  }
  return caller->singleShot() ? callOnce(self, caller, false, request, response)
                              : caller->call(self, request, response) == ServiceCaller::Outcome::SUCCESS;
}

void clearCalls(ros::ServiceServerLink* self)
{
  const Runtime& runtime = Runtime::instance();
  if (!runtime.active())
  {
    runtime.original.service_clear_calls(self);
    return;
  }
  endCalls(self);
}

/// roscpp's function also locks shutting_down_mutex_ under the lock of the ended transport. A thread that connects
/// takes these locks in the opposite order, so both threads could deadlock.
void removeLink(ros::ServiceManager* self, const ros::ServiceServerLinkPtr& link)
{
  if (!Runtime::instance().active())
  {
    Runtime::instance().original.service_remove_link(self, link);
    return;
  }
  ros::L_ServiceServerLink removed;  // the link is destroyed without the lock
  boost::mutex::scoped_lock lock(self->service_server_links_mutex_);
  const auto found = std::find(self->service_server_links_.begin(), self->service_server_links_.end(), link);
  if (found != self->service_server_links_.end())
  {
    removed.splice(removed.begin(), self->service_server_links_, found);
  }
}

bool handleHeader(ros::ServiceClientLink* self, const ros::Header& header)
{
  Runtime& runtime = Runtime::instance();
  ros::Header& fields = const_cast<ros::Header&>(header);
  std::string service;
  std::string version;
  std::string probe;
  if (BridgeClient::isRequiredFor(self->getConnection()) && !(fields.getValue("probe", probe) && probe == "1"))
  {
    fields.getValue("service", service);
    BridgeClient::instance().warnOfRequired(
        service, "a client of " + service + " on another device is refused, because it comes without a bridge");
    self->getConnection()->sendHeaderError("this service is called from other devices through bridges only");
    return false;
  }
  const bool asked = fields.getValue(HEADER_FIELD, version) && fields.getValue("service", service);
  fields.getValues()->erase(HEADER_FIELD);  // callbacks see the same header as with TCPROS
  if (!asked || !runtime.active() || version != std::to_string(PROTOCOL_VERSION) || !runtime.options.carries(service))
  {
    return runtime.original.service_handle_header(self, header);
  }
  const ros::ConnectionPtr connection = self->getConnection();
  const auto responder = std::make_shared<ServiceResponder>(service, self->shared_from_this(), connection);
  const std::string offer = runtime.expect(
      responder->token(), ifAlive(responder, [](const auto& expected, const std::shared_ptr<ProcessPair>& pair,
                                                const Packet& hello) { expected->meet(pair, hello); }));
  if (offer.empty())
  {
    return runtime.original.service_handle_header(self, header);
  }
  runtime.service_responders.hold(connection, responder,
                                  [responder](ros::Connection::DropReason) { responder->disconnect(); });
  OfferScope scope(offer);
  // The client ends the connection, see callService(). Set before the header is written, because another thread may
  // answer the first request at once.
  self->persistent_ = true;
  return runtime.original.service_handle_header(self, header);
}

void processResponse(ros::ServiceClientLink* self, bool ok, const ros::SerializedMessage& response)
{
  Runtime& runtime = Runtime::instance();
  const std::shared_ptr<ServiceResponder> responder =
      runtime.active() ? runtime.service_responders.find(self->getConnection().get()) : nullptr;
  if (!responder || !responder->respond(response))
  {
    runtime.original.service_process_response(self, ok, response);
  }
}

}  // namespace

void attachServiceHooks(PiOsShim* shim)
{
  Originals& original = Runtime::instance().original;
  takeOver(shim, PI_OS_SERVICE_LOOKUP, &original.lookup_service, lookupService);
  takeOver(shim, PI_OS_TCP_CONNECT, &original.tcp_connect, connectTcp);
  takeOver(shim, PI_OS_SERVICE_CREATE_LINK, &original.service_create_link, createLink);
  takeOver(shim, PI_OS_SERVICE_INITIALIZE, &original.service_initialize, initialize);
  takeOver(shim, PI_OS_SERVICE_HEADER_RECEIVED, &original.service_header_received, headerReceived);
  takeOver(shim, PI_OS_SERVICE_CALL, &original.service_call, callService);
  takeOver(shim, PI_OS_SERVICE_CLEAR_CALLS, &original.service_clear_calls, clearCalls);
  takeOver(shim, PI_OS_SERVICE_REMOVE_LINK, &original.service_remove_link, removeLink);
  takeOver(shim, PI_OS_SERVICE_HANDLE_HEADER, &original.service_handle_header, handleHeader);
  takeOver(shim, PI_OS_SERVICE_PROCESS_RESPONSE, &original.service_process_response, processResponse);
}

}  // namespace pi_os_transport
