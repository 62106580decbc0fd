#include "client/node_links.h"

#include <utility>

namespace pi_offload
{
namespace
{

constexpr uint32_t CANCEL_ID = 1U << 30U;
constexpr uint32_t ID_MASK = CANCEL_ID - 1U;

/// The ids of cancellations are others than those of what they cancel: a request ends with the first reply to its id.
uint32_t idOf(const OffloadRequest& request)
{
  const auto id = static_cast<uint32_t>(request.request) & ID_MASK;
  return request.type == OffloadRequest::Type::CANCEL ? id | CANCEL_ID : id;
}

}  // namespace

struct NodeLinks::Shared
{
  NodeLinks* links = nullptr;  ///< null: they have ended; of the thread that uses them
};

NodeLinks::NodeLinks(const Options& options, Callbacks callbacks)
  : options_(options), callbacks_(std::move(callbacks)), shared_(std::make_shared<Shared>())
{
  shared_->links = this;
}

NodeLinks::~NodeLinks()
{
  shared_->links = nullptr;
  links_.clear();
}

void NodeLinks::set(const std::string& node, const std::string& address)
{
  const auto found = links_.find(node);
  if (found != links_.end() && found->second->address == address)
  {
    return;
  }
  SpRequester::Options options = options_.link;
  options.address = address;
  options.validate();
  links_.erase(node);
  const auto link = std::make_shared<Link>();
  link->address = address;
  // Events hold the link weakly: those of a connection that was replaced mean nothing any more.
  const auto post = [shared = shared_, weak = std::weak_ptr<Link>(link), post = callbacks_.post](auto function)
  {
    post(
        [shared, weak, function = std::move(function)]
        {
          const std::shared_ptr<Link> link = weak.lock();
          if (shared->links != nullptr && link)
          {
            function(shared->links->callbacks_, link.get());
          }
        });
  };
  SpRequester::Callbacks callbacks;
  callbacks.reply = [post, node](uint32_t, std::vector<uint8_t> body, int64_t received_ns)
  {
    try
    {
      auto reply = std::make_shared<OffloadReply>(decodeReply(body.data(), body.size()));
      post(
          [node, reply, received_ns](const Callbacks& callbacks, Link* link)
          {
            link->unanswered_since_ns = 0;
            callbacks.reply(node, *reply, received_ns);
          });
    }
    catch (const WireError& error)
    {
      post([node, problem = std::string(error.what())](const Callbacks& callbacks, Link*)
           { callbacks.damaged(node, problem); });
    }
  };
  callbacks.link = [post, node](bool up, const std::string& reason)
  {
    post(
        [node, up, reason](const Callbacks& callbacks, Link* link)
        {
          link->up = up;
          link->unanswered_since_ns = 0;
          callbacks.link(node, up, reason);
        });
  };
  links_.emplace(node, link);
  link->requester = std::make_unique<SpRequester>(options, std::move(callbacks));
}

void NodeLinks::remove(const std::string& node)
{
  links_.erase(node);
}

bool NodeLinks::connected(const std::string& node) const
{
  const auto link = links_.find(node);
  return link != links_.end() && link->second->up && link->second->requester->connected();
}

bool NodeLinks::send(const std::string& node, const OffloadRequest& request, int64_t now_ns)
{
  const auto found = links_.find(node);
  if (found == links_.end() || !found->second->up)
  {
    return false;
  }
  Link& link = *found->second;
  if (link.unanswered_since_ns != 0 &&
      1e-9 * static_cast<double>(now_ns - link.unanswered_since_ns) > options_.unanswered_s)
  {
    // What is on its way to a node that went silent would delay all that follows it.
    link.unanswered_since_ns = 0;
    link.requester->reconnect("no answer for too long");
    return false;
  }
  if (!link.requester->send(idOf(request), encode(request)))
  {
    return false;
  }
  if (link.unanswered_since_ns == 0 && request.type != OffloadRequest::Type::CANCEL)
  {
    link.unanswered_since_ns = now_ns;
  }
  return true;
}

}  // namespace pi_offload
