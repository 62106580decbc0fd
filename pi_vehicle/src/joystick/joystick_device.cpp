#include "joystick/joystick_device.h"

#include <fcntl.h>
#include <linux/joystick.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace pi_vehicle
{
namespace
{

constexpr float FULL = 32767.0F;  ///< of an axis
constexpr int MAX_EVENTS = 256;   ///< at once: a device that floods must not hold the thread

template <typename Value>
void set(std::vector<Value>* values, size_t index, Value value)
{
  if (values->size() <= index)
  {
    values->resize(index + 1);
  }
  (*values)[index] = value;
}

}  // namespace

JoystickDevice::JoystickDevice(std::string path) : path_(std::move(path)) {}

JoystickDevice::~JoystickDevice()
{
  close();
}

void JoystickDevice::close()
{
  if (descriptor_ >= 0)
  {
    ::close(descriptor_);
  }
  descriptor_ = -1;
  state_ = State();
}

bool JoystickDevice::open(std::string* problem)
{
  descriptor_ = ::open(path_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (descriptor_ < 0)
  {
    *problem = "joystick " + path_ + ": " + std::strerror(errno) +
               (errno == EACCES ? "; put the user into the group input" : "; plug it in, or give another device");
  }
  return descriptor_ >= 0;
}

std::optional<JoystickDevice::State> JoystickDevice::update(std::string* problem)
{
  problem->clear();
  if (descriptor_ < 0 && !open(problem))
  {
    return std::nullopt;
  }
  state_.changed = false;
  for (int i = 0; i < MAX_EVENTS; ++i)
  {
    js_event event = {};
    const ssize_t size = ::read(descriptor_, &event, sizeof event);
    if (size < 0 && (errno == EAGAIN || errno == EINTR))
    {
      break;
    }
    if (size != sizeof event)
    {
      *problem = "joystick " + path_ + " is gone" + (size < 0 ? std::string(": ") + std::strerror(errno) : "") +
                 "; plug it in again";
      close();
      return std::nullopt;
    }
    const int type = event.type & ~JS_EVENT_INIT;
    if (type == JS_EVENT_AXIS)
    {
      set(&state_.axes, event.number, -static_cast<float>(event.value) / FULL);
    }
    else if (type == JS_EVENT_BUTTON)
    {
      set(&state_.buttons, event.number, static_cast<int>(event.value != 0));
    }
    state_.changed = true;
  }
  return state_;
}

}  // namespace pi_vehicle
