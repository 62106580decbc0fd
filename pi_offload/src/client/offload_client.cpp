#include "client/offload_client.h"

#include <pi_node/option_check.h>

#include <stdexcept>
#include <utility>

#include "client/client_impl.h"

namespace pi_offload
{
namespace
{

constexpr size_t LONGEST_NAME = 64;

}  // namespace

void OffloadClientOptions::validate() const
{
  if (vehicle.empty() || vehicle.size() > LONGEST_NAME)
  {
    throw std::invalid_argument("vehicle = \"" + vehicle + "\", must be 1 to 64 bytes");
  }
  engine.validate();
  encoder.validate();
  SpRequester::Options some = link;
  some.address = "localhost:1";
  some.validate();
  const pi_node::OptionCheck check("");
  check.range("unanswered_s", unanswered_s, 0.05, 60.0);
  check.range<size_t>("max_encoding", max_encoding, 1, 64);
  check.range<size_t>("max_connections", max_connections, 1, 1000);
  if (transport == Transport::NATS)
  {
    requireNatsToken("vehicle", vehicle);
    requireNatsToken("nats/network", network);
    nats.validate();
  }
}

OffloadClient::OffloadClient(const OffloadClientOptions& options, Callbacks callbacks)
  : options_((options.validate(), options))
  , callbacks_(std::move(callbacks))
  , encoder_(std::make_unique<PictureEncoder>(options_.encoder))
  , engine_(options_.engine, actions())
  , impl_(std::make_unique<Impl>(this))
  , thread_("offload_engine", events())
{
}

std::string OffloadClient::encoding() const
{
  return impl_->encode_stage.status().text();
}

OffloadClient::~OffloadClient()
{
  stop();
  impl_.reset();  // its connections post to the thread
}

void OffloadClient::start()
{
  impl_->encode_thread.start();
  thread_.start();
}

void OffloadClient::stop()
{
  impl_->encode_thread.stop();
  thread_.stop();
}

OffloadEngine::Actions OffloadClient::actions()
{
  OffloadEngine::Actions actions;
  actions.send = [this](const std::string& node, uint64_t number, const Task& task)
  { return impl_->sendTask(node, number, task); };
  actions.probe = [this](const std::string& node, uint64_t number) { return impl_->sendProbe(node, number); };
  actions.run_local = [this](const Task& task, double) { callbacks_.run_local(task); };
  actions.cancel = [this](const std::string& node, uint64_t number) { impl_->cancel(node, number); };
  actions.deliver = [this](const Outcome& outcome) { impl_->deliver(outcome); };
  return actions;
}

EventThread::Callbacks OffloadClient::events()
{
  EventThread::Callbacks events;
  events.next_time = [this]
  {
    const int64_t own_ns =
        impl_->nodes.empty() ? engine_.nextTime() : std::min(engine_.nextTime(), impl_->choose_links_ns);
    return callbacks_.next_time ? std::min(own_ns, callbacks_.next_time()) : own_ns;
  };
  events.on_time = [this](int64_t now_ns)
  {
    impl_->forgetOld(now_ns);
    if (now_ns >= impl_->choose_links_ns)
    {
      impl_->chooseLinks(now_ns);
    }
    engine_.onTime(now_ns);
    if (callbacks_.on_time)
    {
      callbacks_.on_time(now_ns);
    }
  };
  events.failed = [this](const std::string& text) { callbacks_.log(true, text); };
  return events;
}

void OffloadClient::setNode(const NodeDescription& node, int64_t now_ns)
{
  node.validate();
  if (node.address.empty())
  {
    throw std::invalid_argument("node " + node.id + ": address = \"\", must be host:port");
  }
  if (options_.transport == Transport::NATS)
  {
    options_.nats.requireServer("node " + node.id + ": address", node.address);
  }
  SpRequester::Options link = options_.link;
  link.address = node.address;
  link.validate();
  engine_.setNode(node, now_ns);
  impl_->setAddress(node.id, node.address);
  impl_->chooseLinks(now_ns);
}

bool OffloadClient::removeNode(const std::string& node, int64_t now_ns)
{
  impl_->nodes.erase(node);
  return engine_.removeNode(node, now_ns);
}

void OffloadClient::setClassesKnown(bool known)
{
  impl_->classes_known = known;
}

Decision OffloadClient::submit(uint64_t task, TaskKind kind, int64_t created_ns, double deadline_s, TaskData data,
                               int64_t now_ns)
{
  Task submitted;
  submitted.id = task;
  submitted.kind = kind;
  submitted.created_ns = created_ns;
  submitted.deadline_s = deadline_s;
  submitted.input_bytes = data.bytes.size();
  if (data.picture.data != nullptr)
  {
    const std::string& node = engine_.lastNode(kind);
    const Encoding encoding = encoder_->choose(data.picture, impl_->situation(node, submitted, now_ns));
    submitted.input_bytes = encoder_->expectedBytes(data.picture, encoding);
  }
  last_bytes_[static_cast<size_t>(kind)] = submitted.input_bytes;
  Impl::TaskState state;
  state.task = submitted;
  if (data.picture.data == nullptr)
  {
    state.encoding = data.encoding;
    state.payload = std::make_shared<const std::vector<uint8_t>>(std::move(data.bytes));
  }
  state.data = std::make_shared<const TaskData>(std::move(data));
  const auto added = impl_->tasks.emplace(task, std::move(state));
  try
  {
    return engine_.submit(submitted, now_ns);
  }
  catch (const std::invalid_argument&)
  {
    if (added.second)
    {
      impl_->tasks.erase(task);
    }
    throw;
  }
}

void OffloadClient::setEta(double eta)
{
  engine_.setEta(eta);
  impl_->eta = eta;
}

double OffloadClient::eta() const
{
  return impl_->eta;
}

void OffloadClient::setEnabled(bool enabled, int64_t now_ns)
{
  enabled_ = enabled;
  engine_.setEnabled(enabled, now_ns);
}

std::map<std::string, OffloadClient::LinkStatus> OffloadClient::links() const
{
  std::map<std::string, LinkStatus> links;
  for (const auto& [id, node] : impl_->nodes)
  {
    links[id] = node.status;
  }
  return links;
}

}  // namespace pi_offload
