#include "ros/vio_pipeline.h"

#include <pi_node/vehicle_clock.h>

#include <filesystem>

namespace pi_slam
{

namespace
{

/// Tiles lie beside the map's file, if nobody said where.
MapperOptions mapperOptions(const VioRosOptions& options)
{
  MapperOptions mapper = options.mapper;
  const std::filesystem::path folder = std::filesystem::path(options.map_file).parent_path();
  if (mapper.tile_folder.empty() && !options.map_file.empty())
  {
    mapper.tile_folder = folder.empty() ? "." : folder.string();
  }
  return mapper;
}

}  // namespace

VioPipeline::Ptr VioPipeline::make(const VioRosOptions& options, const RuntimePtr& runtime,
                                   const FileCalibration& calibration, const Eigen::Isometry3d& T_base_body)
{
  const auto pipeline = std::make_shared<VioPipeline>();
  pipeline->cameras = calibration.cameras;
  pipeline->vio_options = options.vio;
  pipeline->vio_options.imu = calibration.imu;
  pipeline->vio_options.wheels.T_body_wheels = T_base_body.inverse();
  if (pi_node::isTimeSimulated())
  {
    // The simulator waits for the pairs: how long one takes on this computer must not change the estimate.
    pipeline->vio_options.frame_budget_s = 0.0;
  }
  pipeline->T_base_body = T_base_body;
  pipeline->gyro_variance =
      calibration.imu.gyro_noise_density * calibration.imu.gyro_noise_density * calibration.imu.rate_hz;
  if (options.mapping)
  {
    pipeline->mapper = std::make_shared<Mapper>(calibration.cameras, mapperOptions(options), runtime);
  }
  pipeline->startVio(runtime, RigReport());
  return pipeline;
}

VioPipeline::Ptr VioPipeline::again(const VioRosOptions& options, const RuntimePtr& runtime, bool forget_map) const
{
  const auto pipeline = std::make_shared<VioPipeline>(*this);
  if (pipeline->mapper && forget_map)
  {
    pipeline->mapper = std::make_shared<Mapper>(pipeline->cameras, mapperOptions(options), runtime);
  }
  pipeline->startVio(runtime, vio->rig());
  return pipeline;
}

void VioPipeline::startVio(const RuntimePtr& runtime, const RigReport& found)
{
  vio = std::make_shared<Vio>(cameras, vio_options, runtime, found);
  if (mapper)
  {
    vio->setKeyframeCallback([mapper = mapper](const MapFrame& frame) { mapper->add(frame); });
  }
}

}  // namespace pi_slam
