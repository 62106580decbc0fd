#include "vehicle/vehicle_simulation.h"

#include "vehicle/rounded_json.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace pi_simulation
{
namespace
{

constexpr int64_t STEP_NS = MotionWindow::PERIOD_NS;
constexpr int64_t SECOND_NS = 1'000'000'000;
constexpr int64_t IMU_STEPS = MotionWindow::REACH;
constexpr int64_t POSE_STEPS = 20;
constexpr int64_t JUDGE_STEPS = 50;
const char* const COMMANDS = ", camera left|right|both on|off|dark, imu on|off, actor ID go";

pi_vehicle::Pose2 mapOrigin(const Scenario& scenario, const VehicleSimulationOptions& options)
{
  return scenario.start * pi_vehicle::Pose2{options.imu_in_base.x(), options.imu_in_base.y(), 0.0};
}

SimulationOptions chassisOptions(const Scenario& scenario, const VehicleSimulationOptions& options)
{
  options.validate();
  SimulationOptions chassis = options.chassis;
  chassis.start = {scenario.start.x, scenario.start.y, scenario.start.heading};
  return chassis;
}

std::shared_ptr<const SyntheticWorld> buildWorld(const Scenario& scenario, const VehicleSimulationOptions& options)
{
  SyntheticWorldOptions world;
  world.seed = scenario.world_seed;
  world.parked = scenario.parked;
  world.crossing = false;
  world.road = scenario.road;
  for (const ActorPlan& plan : scenario.actors)
  {
    world.actors.push_back({plan.class_name, plan.size, plan.path});
  }
  std::vector<pi_slam::StampedPose> drive;
  const auto add = [&](const Eigen::Vector2d& place)
  {
    pi_slam::StampedPose pose;
    pose.stamp_ns = static_cast<int64_t>(drive.size() + 1) * SECOND_NS;
    pose.T_world_body.translation() << place, options.imu_in_base.z();
    drive.push_back(pose);
  };
  std::for_each(scenario.road.begin(), scenario.road.end(), add);
  add(scenario.start.position());
  add(scenario.goal.position());
  return SyntheticWorld::build(world, drive);
}

}  // namespace

void VehicleSimulationOptions::validate() const
{
  chassis.validate();
  imu.validate();
  footprint.validate();
  const pi_node::OptionCheck check("");
  check.range("imu/rate_hz", imu.rate_hz, 200.0, 200.0);
  check.range("imu_in_base/x", imu_in_base.x(), -5.0, 5.0);
  check.range("imu_in_base/y", imu_in_base.y(), -5.0, 5.0);
  check.range("imu_in_base/z", imu_in_base.z(), 0.1, 5.0);
  check.range("frame_rate_hz", frame_rate_hz, 0.5, 100.0);
}

VehicleSimulation::VehicleSimulation(const Scenario& scenario, const VehicleSimulationOptions& options,
                                     SimulationOutputs outputs, int64_t start_ns)
  : scenario_(scenario)
  , options_((options.validate(), options))
  , outputs_(std::move(outputs))
  , surface_(scenario.bumps, scenario.world_seed)
  , map_in_world_(mapOrigin(scenario, options))
  , world_(buildWorld(scenario, options))
  , start_ns_(start_ns)
  , chassis_(chassisOptions(scenario, options), start_ns_)
  , noise_(options.imu)
  , now_ns_(start_ns_)
  , faults_(scenario.faults)
{
  T_base_body_.translation() = options_.imu_in_base;
  T_map_world_ = (Eigen::Translation3d(map_in_world_.x, map_in_world_.y, options_.imu_in_base.z()) *
                  Eigen::AngleAxisd(map_in_world_.heading, Eigen::Vector3d::UnitZ()))
                     .inverse();
  for (const ActorPlan& plan : scenario_.actors)
  {
    actors_.emplace_back(plan);
  }
  log("start", {{"scenario", Json::parse(scenario_.toJson(map_in_world_.inverse()))}});
}

void VehicleSimulation::advance(int64_t now_ns)
{
  if (now_ns_ + STEP_NS > now_ns)
  {
    chassis_.step(now_ns_);  // reads its line
  }
  while (now_ns_ + STEP_NS <= now_ns)
  {
    now_ns_ += STEP_NS;
    step();
  }
}

void VehicleSimulation::step()
{
  runFaults();
  chassis_.step(now_ns_);
  const pi_vehicle::Pose2& pose = chassis_.model().pose();
  for (Actor& actor : actors_)
  {
    if (actor.step(time(), 1e-9 * static_cast<double>(STEP_NS), {pose.x, pose.y}))
    {
      log("trigger", {{"actor", actor.plan().id}});
    }
  }
  window_.add(now_ns_, surface_.T_world_base(pose.x, pose.y, pose.heading));
  publish();
}

void VehicleSimulation::runFaults()
{
  for (const auto& [line, restores] : faults_.due(time(), chassis_.model().pose().position()))
  {
    const std::string problem = isForRunner(line) ? "" : execute(line);
    if (problem.empty())
    {
      log("command", {{"line", line}, {"restores", restores}});
    }
    else
    {
      log("error", {{"text", problem}});
    }
  }
}

void VehicleSimulation::publish()
{
  const int64_t number = (now_ns_ - start_ns_) / STEP_NS;
  if (window_.ready() && number % IMU_STEPS == 0)
  {
    pi_slam::ImuSample sample = window_.imu(T_base_body_, options_.imu.gravity);
    noise_.apply(&sample);
    if (imu_on_ && outputs_.imu)
    {
      outputs_.imu(sample);
    }
  }
  if (window_.ready() && number % POSE_STEPS == 0 && outputs_.pose)
  {
    outputs_.pose({window_.stampNs(), T_map_world_ * window_.pose(), window_.velocity(), window_.angularRate()});
  }
  if (const StockBase* base = chassis_.teller(); base != nullptr && number % POSE_STEPS == 0 && outputs_.odometry)
  {
    const Measurement measured = chassis_.model().measurement();
    outputs_.odometry({now_ns_, base->odometry(), base->speed(measured), base->yawRate(measured)});
  }
  const auto due = [this](int64_t frame)
  { return start_ns_ + std::llround(1e9 * static_cast<double>(frame) / options_.frame_rate_hz); };
  if (now_ns_ >= due(frame_))
  {
    while (due(frame_) <= now_ns_)
    {
      ++frame_;
    }
    if (outputs_.exposure)
    {
      const pi_vehicle::Pose2& pose = chassis_.model().pose();
      outputs_.exposure(
          {now_ns_, surface_.T_world_base(pose.x, pose.y, pose.heading) * T_base_body_, actorStates(), left_, right_});
    }
  }
  if (number % JUDGE_STEPS == 0)
  {
    judge();
  }
}

std::vector<ActorState> VehicleSimulation::actorStates() const
{
  std::vector<ActorState> states;
  for (const Actor& actor : actors_)
  {
    states.push_back(actor.state());
  }
  return states;
}

OrientedBox VehicleSimulation::outline() const
{
  return {{0.5 * (options_.footprint.front - options_.footprint.rear), 0.0},
          0.0,
          {0.5 * (options_.footprint.front + options_.footprint.rear), options_.footprint.half_width}};
}

std::vector<TrueObstacle> VehicleSimulation::obstacles() const
{
  const pi_vehicle::Pose2 T_base_world = chassis_.model().pose().inverse();
  const OrientedBox vehicle = outline();
  std::vector<TrueObstacle> obstacles;
  for (const ObstacleState& state : world_->obstaclesAt(now_ns_, actorStates()))
  {
    const Eigen::Vector3d center = state.T_world_object.translation();
    const Eigen::Vector2d in_base = T_base_world * Eigen::Vector2d(center.head<2>());
    const Eigen::Vector2d half = 0.5 * state.size.head<2>();
    const bool hangs = state.class_name == "lamp" || state.class_name == "pipe" ||
                       center.z() - 0.5 * state.size.z() > options_.footprint.height;
    if (hangs || in_base.norm() - half.norm() > OBSTACLE_RANGE_M)
    {
      continue;
    }
    TrueObstacle obstacle;
    obstacle.id = state.id;
    obstacle.name = state.actor < 0 ? "" : scenario_.actors[static_cast<size_t>(state.actor)].id;
    obstacle.class_name = state.class_name;
    const Eigen::Matrix3d R = state.T_world_object.linear();
    obstacle.box = {in_base, T_base_world.heading + std::atan2(R(1, 0), R(0, 0)), half};
    obstacle.height = state.size.z();
    const pi_vehicle::Pose2 turn{0.0, 0.0, T_base_world.heading};
    obstacle.velocity = turn * Eigen::Vector2d(state.v_world.head<2>());
    obstacle.distance = distanceBetween(vehicle, obstacle.box);
    obstacles.push_back(obstacle);
  }
  std::sort(obstacles.begin(), obstacles.end(),
            [](const TrueObstacle& a, const TrueObstacle& b)
            { return a.distance != b.distance ? a.distance < b.distance : a.id < b.id; });
  return obstacles;
}

void VehicleSimulation::judge()
{
  const std::vector<TrueObstacle> all = obstacles();
  if (outputs_.obstacles)
  {
    outputs_.obstacles(now_ns_, all);
  }
  const pi_vehicle::Pose2& pose = chassis_.model().pose();
  const pi_vehicle::Pose2 in_map = map_in_world_.inverse() * pose;
  const Measurement measured = chassis_.model().measurement();
  const auto describe = [](const TrueObstacle& obstacle) -> Json
  {
    return {{"id", obstacle.id},
            {"actor", obstacle.name},
            {"class", obstacle.class_name},
            {"distance", rounded(obstacle.distance)},
            {"position", toJson(obstacle.box.center)},
            {"velocity", toJson(obstacle.velocity)}};
  };
  Json fields = {{"pose", toJson(in_map)},
                 {"speed", rounded(chassis_.model().groundSpeed())},
                 {"curvature", rounded(measured.curvature)},
                 {"mode", chassis::modeText(chassis_.mode())}};
  fields["people"] = Json::array();
  for (const TrueObstacle& obstacle : all)
  {
    if (obstacle.class_name == "person" || obstacle.class_name == "cyclist")
    {
      fields["people"].push_back(toJson(obstacle.box.center));
    }
  }
  if (!all.empty())
  {
    fields["nearest"] = describe(all.front());
  }
  const auto actor = std::find_if(all.begin(), all.end(), [](const TrueObstacle& one) { return !one.name.empty(); });
  if (actor != all.end())
  {
    fields["nearest_actor"] = describe(*actor);
  }
  log("state", fields);
  std::set<int> touching;
  for (const TrueObstacle& obstacle : all)
  {
    if (obstacle.distance > 0.0)
    {
      break;
    }
    touching.insert(obstacle.id);
    if (touching_.count(obstacle.id) == 0)
    {
      ++collisions_;
      if (outputs_.collision)
      {
        outputs_.collision(obstacle.name.empty() ? obstacle.class_name : obstacle.name);
      }
      log("collision", {{"speed", rounded(chassis_.model().groundSpeed())}, {"with", describe(obstacle)}});
    }
  }
  touching_ = touching;
}

std::string VehicleSimulation::command(const std::string& line)
{
  const std::string problem = execute(line);
  if (problem.empty())
  {
    log("command", {{"line", line}});
  }
  return problem;
}

std::string VehicleSimulation::execute(const std::string& line)
{
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;)
  {
    words.push_back(word);
  }
  if (words.size() == 3 && words[0] == "camera" && (words[1] == "left" || words[1] == "right" || words[1] == "both") &&
      (words[2] == "on" || words[2] == "off" || words[2] == "dark"))
  {
    const CameraState state = words[2] == "on"    ? CameraState::ON
                              : words[2] == "off" ? CameraState::OFF
                                                  : CameraState::DARK;
    left_ = words[1] != "right" ? state : left_;
    right_ = words[1] != "left" ? state : right_;
    return "";
  }
  if (words.size() == 2 && words[0] == "imu" && (words[1] == "on" || words[1] == "off"))
  {
    imu_on_ = words[1] == "on";
    return "";
  }
  if (words.size() == 3 && words[0] == "actor" && words[2] == "go")
  {
    std::string known;
    for (Actor& actor : actors_)
    {
      if (actor.plan().id == words[1])
      {
        actor.go();
        return "";
      }
      known += (known.empty() ? "" : ", ") + actor.plan().id;
    }
    return "command \"" + line + "\": there is no actor " + words[1] + ", must be one of: " + known;
  }
  const std::string problem = chassis_.command(line, now_ns_);
  if (!words.empty() && words[0] == "pose" && problem.empty())
  {
    window_.clear();  // a jump must not look like an acceleration
  }
  return problem.find("is not understood") == std::string::npos ? problem : problem + COMMANDS;
}

void VehicleSimulation::logError(const std::string& text)
{
  log("error", {{"text", text}});
}

void VehicleSimulation::log(const std::string& type, const nlohmann::ordered_json& fields)
{
  if (outputs_.log)
  {
    Json line = {{"stamp", std::round(1e-6 * static_cast<double>(now_ns_)) / 1e3},
                 {"t", std::round(1e3 * time()) / 1e3},
                 {"type", type}};
    line.update(fields);
    outputs_.log(toLine(line));
  }
}

}  // namespace pi_simulation
