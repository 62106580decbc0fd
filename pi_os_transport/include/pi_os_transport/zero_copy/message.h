#pragma once

#include <ros/builtin_message_traits.h>
#include <ros/message_traits.h>

#include <boost/shared_ptr.hpp>

#include <memory>
#include <type_traits>

#include "pi_os_transport/zero_copy/allocator.h"

namespace pi_os_transport::zero_copy
{

/// The forms of a generated message. Undefined for other types.
template <typename M>
struct Forms;

template <template <typename> class Template, typename Alloc>
struct Forms<Template<Alloc>>
{
  using Standard = Template<std::allocator<void>>;
  using ZeroCopy = Template<Allocator<void>>;
};

/// The zero-copy form of message M, for example Message<sensor_msgs::Image>. Type name, checksum, fields and
/// serialisation equal those of M. Arrays are std::vector with another allocator, strings are std::string.
template <typename M>
using Message = typename Forms<M>::ZeroCopy;

/// A received message. Its large arrays are views of read-only memory, which stays valid and unchanged until the last
/// copy of the handle is destroyed, also after the end of the callback, the subscriber or the publisher. Never write
/// the arrays, not even after a cast; copy the message instead. May be read from any thread. Not for use in a child
/// process after fork().
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

/// True if the array is a view of received memory.
template <typename T>
bool isView(const std::vector<T, Allocator<T>>& array)
{
  return array.get_allocator().isView(array.data());
}

/// Copies a header between messages of different forms.
template <typename Header, typename OtherHeader>
void copyHeader(const Header& from, OtherHeader* to)
{
  to->seq = from.seq;
  to->stamp = from.stamp;
  to->frame_id = from.frame_id;
}

}  // namespace pi_os_transport::zero_copy
