#include "roscpp/topics/outbox_writer.h"

#include <ros/publication.h>

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
  // Otherwise roscpp writes the outbox after the current message.
  if (link->header_written_ && !link->writing_message_)
  {
    added().push_back(link->shared_from_this());
  }
}

void OutboxWriter::flush()
{
  Links links;
  links.swap(added());
  const auto write = [links](bool immediately)
  {
    for (const auto& link : links)
    {
      start(link, immediately);
    }
  };
  if (!links.empty() && !Runtime::instance().later([write]() { write(true); }))
  {
    write(false);
  }
}

}  // namespace pi_os_transport
