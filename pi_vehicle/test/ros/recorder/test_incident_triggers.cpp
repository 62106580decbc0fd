#include "ros/recorder/incident_triggers.h"

#include <gtest/gtest.h>
#include <std_msgs/Bool.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>

namespace pi_vehicle::recorder
{
namespace
{

constexpr int64_t TRIGGER_SECOND = 1000000000;

std::string causeOf(const std::optional<Trigger>& trigger)
{
  return trigger ? trigger->cause : "";
}

VehicleState vehicle(uint8_t mode, double speed = 0.0)
{
  VehicleState state;
  state.mode = mode;
  state.speed = speed;
  return state;
}

ArbiterState arbiter(const std::string& driver, bool emergency, bool reaction_alive)
{
  ArbiterState state;
  state.driver = driver;
  state.emergency = emergency;
  state.sources.resize(2);
  state.sources[0].name = "navigation";
  state.sources[1].name = "reaction";
  state.sources[1].required = true;
  state.sources[1].alive = reaction_alive;
  return state;
}

template <typename Message>
topic_tools::ShapeShifter shapeOf(const Message& message)
{
  topic_tools::ShapeShifter shape;
  shape.morph(ros::message_traits::md5sum(message), ros::message_traits::datatype(message),
              ros::message_traits::definition(message), "0");
  std::vector<uint8_t> bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream out(bytes.data(), static_cast<uint32_t>(bytes.size()));
  ros::serialization::serialize(out, message);
  ros::serialization::IStream in(bytes.data(), static_cast<uint32_t>(bytes.size()));
  shape.read(in);
  return shape;
}

IncidentTriggers triggers()
{
  return IncidentTriggers(2.0, {"remote"});
}

TEST(IncidentTriggers, TheEmergencyStopOfTheArbiterTriggersOnce)
{
  IncidentTriggers found = triggers();
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("navigation", false, true))));
  EXPECT_EQ("emergency_braking", causeOf(found.onArbiter(arbiter("navigation", true, true))));
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("navigation", true, true))));
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("navigation", false, true))));
  EXPECT_EQ("emergency_braking", causeOf(found.onArbiter(arbiter("navigation", true, true))));
}

TEST(IncidentTriggers, APersonWhoDrivesIsATakeOver)
{
  IncidentTriggers found = triggers();
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("navigation", false, true))));
  EXPECT_EQ("take_over", causeOf(found.onArbiter(arbiter("remote", false, true))));
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("remote", false, true))));
}

TEST(IncidentTriggers, ARequiredSourceTriggersWhenItFallsSilentNotBeforeItSpoke)
{
  IncidentTriggers found = triggers();
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("", false, false))));
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("", false, true))));
  const std::optional<Trigger> trigger = found.onArbiter(arbiter("", false, false));
  EXPECT_EQ("watchdog", causeOf(trigger));
  EXPECT_EQ("silent to the arbiter: reaction", trigger->text);
  EXPECT_EQ("", causeOf(found.onArbiter(arbiter("", false, false))));
}

TEST(IncidentTriggers, TroubleOfAChassisThatWasReadyIsAWatchdog)
{
  for (const uint8_t mode : {VehicleState::STOPPED_WATCHDOG, VehicleState::FAULT, VehicleState::DISCONNECTED})
  {
    IncidentTriggers found = triggers();
    EXPECT_EQ("", causeOf(found.onVehicle(vehicle(VehicleState::DISCONNECTED)))) << "not connected yet";
    EXPECT_EQ("", causeOf(found.onVehicle(vehicle(VehicleState::DRIVING))));
    EXPECT_EQ("watchdog", causeOf(found.onVehicle(vehicle(mode))));
    EXPECT_EQ("", causeOf(found.onVehicle(vehicle(mode))));
    EXPECT_EQ("", causeOf(found.onVehicle(vehicle(VehicleState::READY))));
    EXPECT_EQ("watchdog", causeOf(found.onVehicle(vehicle(mode))));
  }
}

TEST(IncidentTriggers, TheEmergencyStopOfTheChassisIsAnEmergencyBraking)
{
  IncidentTriggers found = triggers();
  found.onVehicle(vehicle(VehicleState::READY));
  EXPECT_EQ("emergency_braking", causeOf(found.onVehicle(vehicle(VehicleState::EMERGENCY_STOP))));
  EXPECT_EQ("", causeOf(found.onVehicle(vehicle(VehicleState::EMERGENCY_STOP))));
}

TEST(IncidentTriggers, AHardBrakingOfAMovingVehicleTriggersOnce)
{
  IncidentTriggers found = triggers();
  MotionCommand command;
  command.max_deceleration = 2.5;
  EXPECT_EQ("", causeOf(found.onMotion(command, 0))) << "the vehicle stands";
  found.onVehicle(vehicle(VehicleState::DRIVING, 2.0));
  EXPECT_EQ("emergency_braking", causeOf(found.onMotion(command, TRIGGER_SECOND)));
  EXPECT_EQ("", causeOf(found.onMotion(command, TRIGGER_SECOND + TRIGGER_SECOND / 2)));
  EXPECT_EQ("", causeOf(found.onMotion(command, 2 * TRIGGER_SECOND)));
  EXPECT_EQ("emergency_braking", causeOf(found.onMotion(command, 4 * TRIGGER_SECOND)));
  command.max_deceleration = 1.5;
  EXPECT_EQ("", causeOf(found.onMotion(command, 9 * TRIGGER_SECOND))) << "usual braking";
  command.max_deceleration = 2.5;
  command.speed = 2.5;
  EXPECT_EQ("", causeOf(found.onMotion(command, 9 * TRIGGER_SECOND))) << "does not brake";
}

TEST(IncidentTriggers, CollisionsOfAnyTypeOfMessage)
{
  IncidentTriggers found = triggers();
  std_msgs::Bool touch;
  EXPECT_EQ("", causeOf(found.onCollision(shapeOf(touch))));
  touch.data = 1;
  EXPECT_EQ("collision", causeOf(found.onCollision(shapeOf(touch))));
  EXPECT_EQ("", causeOf(found.onCollision(shapeOf(touch)))) << "still the same";
  std_msgs::String text;
  text.data = "box";
  EXPECT_EQ("box", found.onCollision(shapeOf(text))->text);
  EXPECT_EQ("collision", causeOf(found.onCollision(shapeOf(std_msgs::Empty()))));
}

}  // namespace
}  // namespace pi_vehicle::recorder
