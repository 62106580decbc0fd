#pragma once

#include <memory>
#include <utility>

namespace pi_os_transport
{

/// Makes a callback that calls `action(shared_ptr, arguments...)` if the object still exists, and does nothing
/// otherwise.
template <typename Object, typename Action>
auto ifAlive(std::weak_ptr<Object> object, Action action)
{
  return [object = std::move(object), action = std::move(action)](auto&&... arguments)
  {
    if (const std::shared_ptr<Object> alive = object.lock())
    {
      action(alive, std::forward<decltype(arguments)>(arguments)...);
    }
  };
}

template <typename Object, typename Action>
auto ifAlive(const std::shared_ptr<Object>& object, Action action)
{
  return ifAlive(std::weak_ptr<Object>(object), std::move(action));
}

}  // namespace pi_os_transport
