// Replaces the function of roscpp that turns received bytes into a message. Compiled without access control, like
// roscpp_hooks.cpp.

#include <ros/subscription_callback_helper.h>
#include <std_msgs/Empty.h>

#include <string_view>
#include <typeinfo>

#include "roscpp/hooks.h"
#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

bool startsWith(std::string_view text, std::string_view start)
{
  return text.substr(0, start.size()) == start;
}

bool endsWith(std::string_view text, std::string_view end)
{
  return text.size() >= end.size() && text.substr(text.size() - end.size()) == end;
}

/// True if `helper` makes messages by roscpp's own factory, of a class that genmsg generated, with the standard
/// allocator. Then each byte of an array is overwritten before anybody reads it, or deserialisation throws and drops
/// the message. A type, a factory or an allocator of the user's own may rely on the zeros.
bool overwritesArrays(ros::SubscriptionCallbackHelper* helper)
{
  if (!startsWith(typeid(*helper).name(), "N3ros27SubscriptionCallbackHelperTI"))
  {
    return false;
  }
  using AnyHelper = ros::SubscriptionCallbackHelperT<const boost::shared_ptr<const std_msgs::Empty>&>;
  // The layout is the same for all messages.
  const std::string_view factory = reinterpret_cast<AnyHelper*>(helper)->create_.target_type().name();
  return startsWith(factory, "N3ros21DefaultMessageCreatorIN") && endsWith(factory, "_ISaIvEEEEE");
}

/// While this object lives, arrays of this thread of up to `longest` bytes are not filled with zeros.
class ZeroFillScope
{
public:
  explicit ZeroFillScope(size_t longest) : state_(*Runtime::instance().shim->zero_fill()), outer_(state_)
  {
    state_ = {longest, nullptr, 0, 0};
  }
  ~ZeroFillScope()
  {
    if (state_.skipped != 0)
    {
      Runtime::instance().skipped_zero_fills += state_.skipped;
    }
    state_ = outer_;
  }
  ZeroFillScope(const ZeroFillScope&) = delete;
  ZeroFillScope& operator=(const ZeroFillScope&) = delete;

private:
  PiOsZeroFill& state_;
  const PiOsZeroFill outer_;  ///< of the message whose deserialisation deserialises this one; else empty
};

ros::VoidConstPtr deserialize(ros::MessageDeserializer* self)
{
  Runtime& runtime = Runtime::instance();
  // What only the first call reads: it deserialises, and keeps the message for further ones.
  const size_t bytes = self->serialized_message_.num_bytes;
  const bool skips = bytes >= PI_OS_ZERO_FILL_MIN && runtime.active() && runtime.options.enable &&
                     runtime.options.skip_zero_fill && overwritesArrays(self->helper_.get());
  ZeroFillScope scope(skips ? bytes : 0);
  return runtime.original.deserialize(self);
}

}  // namespace

void attachDeserializeHooks(PiOsShim* shim)
{
  takeOver(shim, PI_OS_MESSAGE_DESERIALIZE, &Runtime::instance().original.deserialize, deserialize);
}

}  // namespace pi_os_transport
