#pragma once

#include <optional>
#include <string>
#include <vector>

namespace pi_vehicle
{

/// A joystick of the kernel's joystick interface, /dev/input/js0. Not thread safe.
class JoystickDevice
{
public:
  struct State
  {
    std::vector<float> axes;   ///< -1 to 1, left and forward positive, as sensor_msgs/Joy has them
    std::vector<int> buttons;  ///< 1: pressed
    bool changed = false;      ///< by this update()
  };

  explicit JoystickDevice(std::string path);
  ~JoystickDevice();
  JoystickDevice(const JoystickDevice&) = delete;
  JoystickDevice& operator=(const JoystickDevice&) = delete;

  /// Reads what has come, without waiting; opens the device if it is not open.
  /// @param[out] problem  why there is no joystick, and the way out; empty: there is one.
  /// @return nullopt without a joystick: nothing may be taken for pressed any more.
  std::optional<State> update(std::string* problem);

private:
  bool open(std::string* problem);
  void close();

  const std::string path_;
  int descriptor_ = -1;
  State state_;
};

}  // namespace pi_vehicle
