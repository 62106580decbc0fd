#include "wire/nats_connection.h"

#include <nats/adapters/libevent.h>
#include <nats/nats.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <pi_node/durations.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <map>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>

#include "wire/event_thread.h"
#include "wire/socket_tools.h"

namespace pi_offload
{
namespace
{

constexpr int MOST_WAITING = 65536;  ///< messages received and not handled
constexpr int MOST_WAITING_BYTES = 256 * 1024 * 1024;
constexpr int64_t PING_MS = 1000;  ///< two without an answer: the connection is dead

int64_t natsMilliseconds(double seconds)
{
  return std::max<int64_t>(1, std::llround(1e3 * seconds));
}

void requireNats(bool condition, const std::string& field, const std::string& value, const std::string& bound)
{
  if (!condition)
  {
    throw std::invalid_argument(field + " = \"" + value + "\", " + bound);
  }
}

void requireNatsFile(const char* field, const std::string& path)
{
  requireNats(!path.empty(), field, path, "must be set if one of ca_file, certificate_file and key_file is");
  requireNats(path.front() == '/', field, path, "must be an absolute path");
  const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen(path.c_str(), "r"), std::fclose);
  requireNats(file != nullptr, field, path, "cannot be read: " + errorText(errno));
}

void requireNatsCertificate(const char* field, const std::string& path)
{
  requireNatsFile(field, path);
  const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen(path.c_str(), "r"), std::fclose);
  const std::unique_ptr<X509, void (*)(X509*)> certificate(PEM_read_X509(file.get(), nullptr, nullptr, nullptr),
                                                           X509_free);
  requireNats(certificate != nullptr, field, path, "must be a certificate in PEM format");
  requireNats(X509_cmp_current_time(X509_get0_notAfter(certificate.get())) > 0, field, path,
              "has expired; make a new certificate");
  requireNats(X509_cmp_current_time(X509_get0_notBefore(certificate.get())) < 0, field, path,
              "is not valid yet; is the clock right?");
}

/// With the details that libnats has of the last failure on this thread.
std::string natsError(natsStatus status)
{
  natsStatus last = NATS_OK;
  const char* const text = nats_GetLastError(&last);
  std::string details = text != nullptr && last != NATS_OK ? text : "";
  details.erase(0, details.rfind('(', 0) == 0 ? details.find("): ") + 3 : 0);  // its place in the library
  return natsStatus_GetText(status) + (details.empty() ? "" : ": " + details);
}

void checkNats(natsStatus status, const std::string& what)
{
  if (status != NATS_OK)
  {
    throw std::invalid_argument(what + ": " + natsError(status));
  }
}

}  // namespace

bool isLoopback(const std::string& host)
{
  return host == "localhost" || host == "::1" || host.rfind("127.", 0) == 0;
}

void requireNatsToken(const std::string& field, const std::string& value)
{
  requireNats(!value.empty() && value.find_first_of(" \t\r\n.*>") == std::string::npos, field, value,
              "must be without spaces, '.', '*' and '>' for transport nats");
}

void NatsOptions::requireServer(const std::string& field, const std::string& server) const
{
  const HostPort address = parseHostPort(field, server);
  requireNats(tls() || isLoopback(address.host), field, server,
              "must be on the loopback interface unless ca_file, certificate_file and key_file are set");
}

void NatsOptions::validate() const
{
  for (const std::string& server : servers)
  {
    requireServer("nats/servers", server);
  }
  if (!ca_file.empty() || !certificate_file.empty() || !key_file.empty())
  {
    requireNatsCertificate("nats/ca_file", ca_file);
    requireNatsCertificate("nats/certificate_file", certificate_file);
    requireNatsFile("nats/key_file", key_file);
  }
}

/// The threads that all connections share.
class NatsConnection::Loop
{
public:
  Loop()
    : base_(makeBase(), event_base_free)
    , opener_("nats_open", {[this] { return due_.empty() ? INT64_MAX : due_.begin()->first; },
                            [this](int64_t now_ns) { runDue(now_ns); },
                            {}})
    , thread_([this] { event_base_loop(base_.get(), EVLOOP_NO_EXIT_ON_EMPTY); })
  {
    opener_.start();
  }
  ~Loop()
  {
    opener_.call([](int64_t) {});  // what is to be closed
    opener_.stop();
    event_base_loopbreak(base_.get());
    thread_.join();
  }
  static std::shared_ptr<Loop> shared()
  {
    static std::mutex mutex;
    static std::weak_ptr<Loop> current;
    const std::lock_guard<std::mutex> lock(mutex);
    std::shared_ptr<Loop> loop = current.lock();
    if (!loop)
    {
      loop = std::make_shared<Loop>();
      current = loop;
    }
    return loop;
  }

  event_base* base() const { return base_.get(); }
  void post(EventThread::Function function) { opener_.post(std::move(function)); }
  /// From a posted function only.
  void postAt(int64_t time_ns, EventThread::Function function) { due_.emplace(time_ns, std::move(function)); }

private:
  static event_base* makeBase()
  {
    checkNats(nats_Open(-1), "libnats");
    natsLibevent_Init();
    return event_base_new();
  }
  void runDue(int64_t now_ns)
  {
    while (!due_.empty() && due_.begin()->first <= now_ns)
    {
      const EventThread::Function function = std::move(due_.begin()->second);
      due_.erase(due_.begin());
      function(now_ns);
    }
  }

  const std::unique_ptr<event_base, void (*)(event_base*)> base_;
  std::multimap<int64_t, EventThread::Function> due_;
  EventThread opener_;
  std::thread thread_;
};

/// Callbacks of libnats find it by its number: they may come after it has gone.
struct NatsConnection::State : std::enable_shared_from_this<State>
{
  State(const Options& options, std::vector<Subscription> subscriptions, Callbacks callbacks, Loop* loop)
    : options(options), subscriptions(std::move(subscriptions)), callbacks(std::move(callbacks)), loop(loop)
  {
  }
  ~State();

  static std::shared_ptr<State> find(void* number);
  void* registered();
  natsStatus makeOptions(natsOptions* made);
  void open();
  void openLater();
  void shut();
  void tell(bool up, const std::string& reason);
  void report(const std::string& text);
  std::string failure(natsConnection* of) const;
  void onMessage(natsMsg* message);

  const Options options;
  const std::vector<Subscription> subscriptions;
  std::mutex calling;  ///< while a callback runs
  Callbacks callbacks;
  bool ended = false;  ///< no more callbacks
  bool told_up = false;
  std::string told_reason;  ///< of `link`
  Loop* const loop;
  double pause_s = options.reconnect_s;  ///< on the thread that opens

  std::mutex mutex;  ///< of all below; never taken before `calling`
  natsConnection* connection = nullptr;
  std::vector<natsSubscription*> made;
  size_t too_large = 0;  ///< reported: body beyond the server's bound

private:
  static std::mutex registry_mutex;
  static std::map<uintptr_t, std::weak_ptr<State>> registry;
  uintptr_t number = 0;
};

std::mutex NatsConnection::State::registry_mutex;
std::map<uintptr_t, std::weak_ptr<NatsConnection::State>> NatsConnection::State::registry;

std::shared_ptr<NatsConnection::State> NatsConnection::State::find(void* number)
{
  const std::lock_guard<std::mutex> lock(registry_mutex);
  const auto found = registry.find(reinterpret_cast<uintptr_t>(number));
  return found == registry.end() ? nullptr : found->second.lock();
}

NatsConnection::State::~State()
{
  const std::lock_guard<std::mutex> lock(registry_mutex);
  registry.erase(number);
}

void* NatsConnection::State::registered()
{
  static uintptr_t last = 0;
  const std::lock_guard<std::mutex> lock(registry_mutex);
  if (number == 0)
  {
    number = ++last;
    registry[number] = weak_from_this();
  }
  return reinterpret_cast<void*>(number);
}

void NatsConnection::State::tell(bool up, const std::string& reason)
{
  const std::lock_guard<std::mutex> lock(calling);
  if (ended || (up == told_up && reason == told_reason))
  {
    return;
  }
  told_up = up;
  told_reason = reason;
  if (callbacks.link)
  {
    callbacks.link(up, reason);
  }
}

void NatsConnection::State::report(const std::string& text)
{
  const std::lock_guard<std::mutex> lock(calling);
  if (!ended && callbacks.problem)
  {
    callbacks.problem(options.nats.servers.front() + ": " + text);
  }
}

std::string NatsConnection::State::failure(natsConnection* of) const
{
  const char* text = nullptr;
  const natsStatus status = natsConnection_GetLastError(of, &text);
  const std::string details = text != nullptr && *text != '\0' ? text : natsStatus_GetText(status);
  return options.nats.servers.front() + ": " + (status == NATS_OK ? "the connection ended" : details);
}

void NatsConnection::State::onMessage(natsMsg* message)
{
  const std::lock_guard<std::mutex> lock(calling);
  if (ended)
  {
    return;
  }
  Message received;
  received.subject = natsMsg_GetSubject(message);
  const char* const reply = natsMsg_GetReply(message);
  received.reply = reply != nullptr ? reply : "";
  received.unserved = natsMsg_IsNoResponders(message);
  const auto* const data = reinterpret_cast<const uint8_t*>(natsMsg_GetData(message));
  received.body.assign(data, data + natsMsg_GetDataLength(message));
  try
  {
    callbacks.message(std::move(received));
  }
  catch (const std::exception& error)
  {
    if (callbacks.problem)
    {
      callbacks.problem(options.nats.servers.front() + ": a message cannot be used: " + error.what());
    }
  }
}

natsStatus NatsConnection::State::makeOptions(natsOptions* made_options)
{
  std::vector<std::string> urls;
  std::vector<const char*> pointers;
  for (const std::string& server : options.nats.servers)
  {
    urls.push_back((options.nats.tls() ? "tls://" : "nats://") + server);
  }
  for (const std::string& url : urls)
  {
    pointers.push_back(url.c_str());
  }
  void* const self = registered();
  const auto both = [](natsStatus first, natsStatus second) { return first != NATS_OK ? first : second; };
  natsStatus status = natsOptions_SetServers(made_options, pointers.data(), static_cast<int>(pointers.size()));
  status = both(status, natsOptions_SetNoRandomize(made_options, true));
  status = both(status, natsOptions_SetName(made_options, options.name.c_str()));
  status = both(status, natsOptions_SetTimeout(made_options, natsMilliseconds(options.connect_timeout_s)));
  status = both(status, natsOptions_SetPingInterval(made_options, PING_MS));
  status = both(status, natsOptions_SetMaxPingsOut(made_options, 2));
  status = both(status, natsOptions_SetMaxReconnect(made_options, -1));
  status = both(status, natsOptions_SetIgnoreDiscoveredServers(made_options, options.only_these));
  status = both(status, natsOptions_UseGlobalMessageDelivery(made_options, true));
  status = both(status, natsOptions_SetSendAsap(made_options, true));  // no thread of its own that flushes
  status = both(status, natsOptions_SetEventLoop(made_options, loop->base(), natsLibevent_Attach, natsLibevent_Read,
                                                 natsLibevent_Write, natsLibevent_Detach));
  const auto delay = [](natsConnection*, int attempts, void* number) -> int64_t
  {
    const std::shared_ptr<State> state = find(number);
    return state ? natsMilliseconds(std::min(state->options.max_reconnect_s,
                                             state->options.reconnect_s * std::pow(2.0, std::min(attempts, 30) - 1)))
                 : 1000;
  };
  status = both(status, natsOptions_SetCustomReconnectDelay(made_options, delay, self));
  const auto up = [](natsConnection*, void* number)
  {
    if (const std::shared_ptr<State> state = find(number))
    {
      state->tell(true, "");
    }
  };
  const auto down = [](natsConnection* of, void* number)
  {
    if (const std::shared_ptr<State> state = find(number))
    {
      state->tell(false, state->failure(of));
    }
  };
  // It gives up after it was refused twice.
  const auto closed = [](natsConnection* of, void* number)
  {
    if (const std::shared_ptr<State> state = find(number))
    {
      state->tell(false, state->failure(of));
      const std::lock_guard<std::mutex> lock(state->calling);
      if (!state->ended)  // else the loop may be gone
      {
        state->loop->post(
            [state](int64_t)
            {
              state->shut();
              state->openLater();
            });
      }
    }
  };
  const auto failed = [](natsConnection* of, natsSubscription*, natsStatus error, void* number)
  {
    if (const std::shared_ptr<State> state = find(number))
    {
      const char* text = nullptr;
      natsConnection_GetLastError(of, &text);
      state->report(text != nullptr && *text != '\0' ? text : natsStatus_GetText(error));
    }
  };
  status = both(status, natsOptions_SetReconnectedCB(made_options, up, self));
  status = both(status, natsOptions_SetDisconnectedCB(made_options, down, self));
  status = both(status, natsOptions_SetClosedCB(made_options, closed, self));
  status = both(status, natsOptions_SetErrorHandler(made_options, failed, self));
  if (options.nats.tls())
  {
    status = both(status, natsOptions_SetSecure(made_options, true));
    status = both(status, natsOptions_LoadCATrustedCertificates(made_options, options.nats.ca_file.c_str()));
    status = both(status, natsOptions_LoadCertificatesChain(made_options, options.nats.certificate_file.c_str(),
                                                            options.nats.key_file.c_str()));
  }
  return status;
}

/// On the thread of the loop that opens, like the next two.
void NatsConnection::State::open()
{
  {
    const std::lock_guard<std::mutex> lock(calling);
    if (ended)
    {
      return;
    }
  }
  natsOptions* chosen = nullptr;
  natsConnection* opened = nullptr;
  natsStatus status = natsOptions_Create(&chosen);
  status = status != NATS_OK ? status : makeOptions(chosen);
  status = status != NATS_OK ? status : natsConnection_Connect(&opened, chosen);
  const std::string details = status == NATS_OK ? "" : options.nats.servers.front() + ": " + natsError(status);
  natsOptions_Destroy(chosen);
  if (opened == nullptr)
  {
    tell(false, details);
    openLater();
    return;
  }
  pause_s = options.reconnect_s;
  const auto handle = [](natsConnection*, natsSubscription*, natsMsg* message, void* number)
  {
    if (const std::shared_ptr<State> state = find(number))
    {
      state->onMessage(message);
    }
    natsMsg_Destroy(message);
  };
  {
    const std::lock_guard<std::mutex> lock(mutex);
    connection = opened;
    for (const Subscription& wanted : subscriptions)
    {
      natsSubscription* subscription = nullptr;
      if (wanted.group.empty())
      {
        natsConnection_Subscribe(&subscription, opened, wanted.subject.c_str(), handle, registered());
      }
      else
      {
        natsConnection_QueueSubscribe(&subscription, opened, wanted.subject.c_str(), wanted.group.c_str(), handle,
                                      registered());
      }
      if (subscription != nullptr)
      {
        natsSubscription_SetPendingLimits(subscription, MOST_WAITING, MOST_WAITING_BYTES);
        made.push_back(subscription);
      }
    }
  }
  tell(true, "");
}

void NatsConnection::State::openLater()
{
  const double wait_s = std::exchange(pause_s, std::min(2.0 * pause_s, options.max_reconnect_s));
  loop->postAt(pi_node::monotonicNs() + pi_node::nanoseconds(wait_s),
               [weak = weak_from_this()](int64_t)
               {
                 if (const std::shared_ptr<State> state = weak.lock())
                 {
                   state->open();
                 }
               });
}

void NatsConnection::State::shut()
{
  natsConnection* closing = nullptr;
  std::vector<natsSubscription*> subscribed;
  {
    const std::lock_guard<std::mutex> lock(mutex);
    std::swap(closing, connection);
    std::swap(subscribed, made);
  }
  for (natsSubscription* const subscription : subscribed)
  {
    natsSubscription_Destroy(subscription);
  }
  natsConnection_Destroy(closing);
}

NatsConnection::NatsConnection(const Options& options, std::vector<Subscription> subscriptions, Callbacks callbacks)
  : loop_((options.nats.validate(), Loop::shared()))
  , state_(std::make_shared<State>(options, std::move(subscriptions), std::move(callbacks), loop_.get()))
{
  loop_->post([state = state_](int64_t) { state->open(); });
}

NatsConnection::~NatsConnection()
{
  {
    const std::lock_guard<std::mutex> lock(state_->calling);
    state_->ended = true;
  }
  loop_->post([state = state_](int64_t) { state->shut(); });
}

bool NatsConnection::connected() const
{
  const std::lock_guard<std::mutex> lock(state_->mutex);
  return state_->connection != nullptr && natsConnection_Status(state_->connection) == NATS_CONN_STATUS_CONNECTED;
}

bool NatsConnection::publish(const std::string& subject, const std::string& reply, const std::vector<uint8_t>& body)
{
  std::string problem;
  {
    const std::lock_guard<std::mutex> lock(state_->mutex);
    natsConnection* const to = state_->connection;
    if (to == nullptr || natsConnection_Status(to) != NATS_CONN_STATUS_CONNECTED ||
        natsConnection_Buffered(to) + static_cast<int64_t>(body.size()) >
            static_cast<int64_t>(state_->options.max_queued_bytes))
    {
      return false;
    }
    const auto bound = static_cast<size_t>(natsConnection_GetMaxPayload(to));
    if (body.size() <= bound)
    {
      const auto size = static_cast<int>(body.size());
      return NATS_OK == (reply.empty()
                             ? natsConnection_Publish(to, subject.c_str(), body.data(), size)
                             : natsConnection_PublishRequest(to, subject.c_str(), reply.c_str(), body.data(), size));
    }
    if (state_->too_large == bound)
    {
      return false;
    }
    state_->too_large = bound;
    problem = "a message of " + std::to_string(body.size()) +
              " bytes is above the server's max_payload = " + std::to_string(bound) +
              "; raise max_payload in its configuration";
  }
  loop_->post([state = state_, problem](int64_t) { state->report(problem); });  // this may be within a callback
  return false;
}

void NatsConnection::unsubscribe()
{
  const std::lock_guard<std::mutex> lock(state_->mutex);
  for (natsSubscription* const subscription : state_->made)
  {
    natsSubscription_Drain(subscription);
  }
}

bool NatsConnection::flush(double timeout_s)
{
  const std::lock_guard<std::mutex> lock(state_->mutex);
  natsConnection* const of = state_->connection;
  // Without a connection there was no request, so nothing is left to send.
  return of == nullptr || natsConnection_FlushTimeout(of, natsMilliseconds(timeout_s)) == NATS_OK;
}

std::string NatsConnection::uniqueToken()
{
  natsInbox* inbox = nullptr;
  checkNats(nats_Open(-1), "libnats");
  checkNats(natsInbox_Create(&inbox), "libnats");
  std::string token = inbox;
  natsInbox_Destroy(inbox);
  return token.substr(token.rfind('.') + 1);
}

}  // namespace pi_offload
