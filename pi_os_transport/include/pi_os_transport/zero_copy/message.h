#pragma once

#include <ros/builtin_message_traits.h>
#include <ros/message_traits.h>

#include <boost/shared_ptr.hpp>

#include <memory>
#include <type_traits>

#include "pi_os_transport/zero_copy/allocator.h"

namespace pi_os_transport::zero_copy
{

/// The forms of a generated message. Undefined for anything else.
template <typename M>
struct Forms;

template <template <typename> class Template, typename Alloc>
struct Forms<Template<Alloc>>
{
  using Standard = Template<std::allocator<void>>;
  using ZeroCopy = Template<Allocator<void>>;
};

/// The message that M is, with large arrays that are not copied: Message<sensor_msgs::Image>. Type name, checksum,
/// fields and serialisation are those of M; its arrays are other instances of std::vector, its strings std::string.
template <typename M>
using Message = typename Forms<M>::ZeroCopy;

/// What a subscriber gets. Its large arrays are views of read-only memory, which stays as it is, and mapped, until the
/// last copy of the handle is gone: after the callback, after the end of the subscriber, and after that of the
/// publisher. Arrays must not be written, not even after a cast. Copy the message for that; the copy is independent.
/// To be read from any thread. Not for use in a child process after fork().
template <typename M>
using ConstPtr = boost::shared_ptr<Message<M> const>;

/// True for Message<M>.
template <typename M>
struct IsZeroCopy : std::false_type
{
};

template <template <typename> class Template>
struct IsZeroCopy<Template<Allocator<void>>>
  : std::bool_constant<ros::message_traits::IsMessage<Template<Allocator<void>>>::value>
{
};

/// True if the array lies in received memory instead of being a copy.
template <typename T>
bool isView(const std::vector<T, Allocator<T>>& array)
{
  return array.get_allocator().isView(array.data());
}

/// Copies a header between a message of one form and one of the other.
template <typename Header, typename OtherHeader>
void copyHeader(const Header& from, OtherHeader* to)
{
  to->seq = from.seq;
  to->stamp = from.stamp;
  to->frame_id = from.frame_id;
}

}  // namespace pi_os_transport::zero_copy
