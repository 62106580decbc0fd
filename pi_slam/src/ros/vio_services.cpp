#include "ros/vio_services.h"

#include <ros/console.h>

#include <exception>
#include <filesystem>

namespace pi_slam
{

VioServices::VioServices(const VioRosOptions& options, ros::NodeHandle private_node, VioSession* session)
  : options_(options)
  , session_(*session)
  , save_map_(private_node.advertiseService("save_map", &VioServices::saveMap, this))
  , load_map_(private_node.advertiseService("load_map", &VioServices::loadMap, this))
  , reset_(private_node.advertiseService("reset", &VioServices::reset, this))
{
}

namespace
{

std::string writeMap(Mapper* mapper, const std::string& file)
{
  mapper->flush();
  const MapStatistics statistics = mapper->statistics();
  mapper->save(file);
  return std::to_string(statistics.keyframes) + " keyframes with " + std::to_string(statistics.landmarks) +
         " landmarks written to " + file;
}

}  // namespace

void VioServices::saveCalibration() const
{
  const CalibrationOptions& calibration = options_.calibration;
  const VioPipeline::Ptr pipeline = session_.pipeline();
  if (!pipeline || (calibration.refined_camchain.empty() && calibration.refined_imu.empty()))
  {
    return;
  }
  const ImuCorrection found = pipeline->vio->rig().used;
  const ImuModel& imu = pipeline->vio_options.imu;
  try
  {
    if (const std::string& file = calibration.refined_camchain; !file.empty())
    {
      Eigen::Isometry3d T_body_imu = Eigen::Isometry3d::Identity();
      T_body_imu.linear() = found.R_body_imu;
      T_body_imu.translation() = found.p_body_imu;
      pipeline->cameras.saveKalibr(file, T_body_imu, imu.time_offset_s - found.late_s);
      ROS_INFO_STREAM_NAMED("vio", "calibration written to " << file);
    }
    if (const std::string& file = calibration.refined_imu; !file.empty())
    {
      ImuModel refined = imu;
      for (int axis = 0; axis < 3; ++axis)
      {
        refined.gyro_scale[static_cast<size_t>(axis)] *= found.gyro_scale[axis];
      }
      refined.saveYaml(file);
      ROS_INFO_STREAM_NAMED("vio", "IMU's model written to " << file);
    }
  }
  catch (const CalibrationError& error)
  {
    ROS_ERROR_STREAM_NAMED("vio", "the calibration is not saved: " << error.what());
  }
}

void VioServices::saveAtEnd() const
{
  saveCalibration();
  const std::string& file = options_.map_file;
  std::string problem;
  try
  {
    if (const std::shared_ptr<Mapper> mapper = options_.save_map ? mapperFor(file, &problem) : nullptr)
    {
      if (std::filesystem::exists(file))
      {
        std::filesystem::copy_file(file, file + ".before", std::filesystem::copy_options::overwrite_existing);
      }
      ROS_INFO_STREAM_NAMED("vio", "map: " << writeMap(mapper.get(), file));
    }
  }
  catch (const std::exception& error)
  {
    problem = error.what();
  }
  if (!problem.empty())
  {
    ROS_ERROR_STREAM_NAMED("vio", "the map is not saved: " << problem);
  }
}

std::shared_ptr<Mapper> VioServices::mapperFor(const std::string& file, std::string* problem) const
{
  if (file.empty() || file.front() != '/')
  {
    *problem = "file = \"" + file + "\", must be an absolute path: the node's working folder is not the caller's";
    return nullptr;
  }
  if (!options_.mapping)
  {
    *problem = "mapping = false: there is no map";
    return nullptr;
  }
  if (const VioPipeline::Ptr pipeline = session_.pipeline())
  {
    return pipeline->mapper;
  }
  *problem = "there is no map yet: " + session_.problem().text;
  return nullptr;
}

template <typename Response>
bool VioServices::answer(const std::string& file, Response* response,
                         const std::function<std::string(Mapper&)>& work) const
{
  try
  {
    if (const std::shared_ptr<Mapper> mapper = mapperFor(file, &response->message))
    {
      response->message = work(*mapper);
      response->success = true;
    }
  }
  catch (const std::exception& error)
  {
    response->message = error.what();
  }
  return true;
}

bool VioServices::saveMap(SaveMap::Request& request, SaveMap::Response& response)
{
  return answer(request.file, &response, [&request](Mapper& mapper) { return writeMap(&mapper, request.file); });
}

bool VioServices::loadMap(LoadMap::Request& request, LoadMap::Response& response)
{
  return answer(request.file, &response,
                [&request](Mapper& mapper)
                {
                  mapper.load(request.file);
                  return std::to_string(mapper.statistics().keyframes) + " keyframes read from " + request.file +
                         "; localised as soon as a place is recognised";
                });
}

bool VioServices::reset(std_srvs::Trigger::Request&, std_srvs::Trigger::Response& response)
{
  if (!session_.pipeline())
  {
    response.message = "there is nothing to reset yet: " + session_.problem().text;
    return true;
  }
  session_.restart("~reset: odometry and map begin anew", true);
  response.success = true;
  response.message = "odometry and map begin anew";
  return true;
}

}  // namespace pi_slam
