#include "roscpp/topics/outbox_writer.h"

#include <ros/publication.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>

#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

void start(const boost::weak_ptr<ros::SubscriberLink>& link, bool immediately)
{
  if (const ros::SubscriberLinkPtr locked = link.lock())
  {
    static_cast<ros::TransportSubscriberLink*>(locked.get())->startMessageWrite(immediately);
  }
}

}  // namespace

OutboxWriter& OutboxWriter::instance()
{
  static OutboxWriter* writer = new OutboxWriter;
  return *writer;
}

OutboxWriter::OutboxWriter() : doorbell_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK))
{
  if (doorbell_)
  {
    Runtime::instance().watch(doorbell_.get(), [this](int) { write(); });
  }
}

OutboxWriter::Links& OutboxWriter::added()
{
  static thread_local Links links;
  return links;
}

void OutboxWriter::enqueue(ros::TransportSubscriberLink* link, const ros::SerializedMessage& message)
{
  {
    const ros::PublicationPtr parent = link->parent_.lock();
    const size_t max_queue = parent ? parent->getMaxQueue() : 0;
    boost::mutex::scoped_lock lock(link->outbox_mutex_);
    link->queue_full_ = max_queue > 0 && link->outbox_.size() >= max_queue;
    if (link->queue_full_)
    {
      link->outbox_.pop();
    }
    link->outbox_.push(message);
  }
  add(link);
  link->stats_.messages_sent_++;
  link->stats_.bytes_sent_ += message.num_bytes;
  link->stats_.message_data_sent_ += message.num_bytes;
}

void OutboxWriter::add(ros::TransportSubscriberLink* link)
{
  boost::mutex::scoped_lock lock(link->outbox_mutex_);
  // Otherwise roscpp goes on with the outbox as soon as what it writes now is written.
  if (link->header_written_ && !link->writing_message_)
  {
    added().push_back(link->shared_from_this());
  }
}

void OutboxWriter::flush()
{
  Links& links = added();
  if (!links.empty())
  {
    instance().submit(links);
    links.clear();
  }
}

void OutboxWriter::submit(const Links& links)
{
  if (!doorbell_)
  {
    for (const auto& link : links)
    {
      start(link, false);
    }
    return;
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    links_.insert(links_.end(), links.begin(), links.end());
  }
  const uint64_t one = 1;
  while (::write(doorbell_.get(), &one, sizeof(one)) < 0 && errno == EINTR)
  {
  }
}

void OutboxWriter::write()
{
  uint64_t rings;
  if (read(doorbell_.get(), &rings, sizeof(rings)) != static_cast<ssize_t>(sizeof(rings)))
  {
    return;
  }
  Links links;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    links.swap(links_);
  }
  for (const auto& link : links)
  {
    start(link, true);
  }
}

}  // namespace pi_os_transport
