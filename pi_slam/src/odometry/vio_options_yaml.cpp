#include "odometry/vio_options_yaml.h"
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

namespace pi_slam
{

namespace
{

/// Levenshtein's distance: letters to insert, delete or replace.
size_t editDistance(const std::string& a, const std::string& b)
{
  std::vector<size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (size_t i = 0; i < a.size(); ++i)
  {
    size_t diagonal = row[0];
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j)
    {
      const size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

/// The known key with the most similar spelling.
std::string nearestKey(const std::string& key, const std::vector<OptionField>& fields)
{
  std::string nearest;
  size_t least = std::numeric_limits<size_t>::max();
  for (const OptionField& field : fields)
  {
    // A key whose group is missing is as near as its last part.
    const std::string name = field.key.substr(field.key.find('/') + 1);
    const size_t distance = std::min(editDistance(key, field.key), editDistance(key, name));
    if (distance < least)
    {
      least = distance;
      nearest = field.key;
    }
  }
  return nearest;
}

/// Assigns scalars of YAML to the fields of their names.
class Loader
{
public:
  Loader(const std::string& file, const std::vector<OptionField>& fields, const std::vector<std::string>& foreign)
    : file_(file), fields_(fields), foreign_(foreign)
  {
  }

  void load(const YAML::Node& node, const std::string& prefix)
  {
    for (const auto& entry : node)
    {
      if (!entry.first.IsScalar())
      {
        throw OptionsError(file_ + ": a key is no word");
      }
      const std::string key = prefix + entry.first.Scalar();
      if (std::find(foreign_.begin(), foreign_.end(), key) != foreign_.end())
      {
        continue;
      }
      if (entry.second.IsMap())
      {
        load(entry.second, key + "/");
        continue;
      }
      const auto field = std::find_if(fields_.begin(), fields_.end(),
                                      [&](const OptionField& candidate) { return candidate.key == key; });
      if (field == fields_.end())
      {
        fail(key, "is not known; did you mean " + nearestKey(key, fields_) + "?");
      }
      if (!loaded_.insert(key).second)
      {
        fail(key, "is there twice");
      }
      assign(*field, entry.second);
    }
  }

private:
  [[noreturn]] void fail(const std::string& key, const std::string& defect) const
  {
    throw OptionsError(file_ + ": " + key + " " + defect);
  }

  template <typename Value>
  Value parse(const std::string& key, const YAML::Node& node, const char* kind) const
  {
    try
    {
      return node.as<Value>();
    }
    catch (const YAML::Exception&)
    {
      fail(key, "is " + (node.IsScalar() ? "\"" + node.Scalar() + "\"" : std::string("no single value")) +
                    ", expected " + kind);
    }
  }

  void assign(const OptionField& field, const YAML::Node& node) const
  {
    if (bool* const* truth = std::get_if<bool*>(&field.value))
    {
      **truth = parse<bool>(field.key, node, "true or false");
    }
    else if (int* const* whole = std::get_if<int*>(&field.value))
    {
      **whole = parse<int>(field.key, node, "a whole number");
    }
    else if (size_t* const* count = std::get_if<size_t*>(&field.value))
    {
      const auto value = parse<long long>(field.key, node, "a whole number, 0 or more");
      if (value < 0)
      {
        fail(field.key, "is " + node.Scalar() + ", expected a whole number, 0 or more");
      }
      **count = static_cast<size_t>(value);
    }
    else if (std::string* const* text = std::get_if<std::string*>(&field.value))
    {
      **text = parse<std::string>(field.key, node, "a text");
    }
    else if (std::vector<double>* const* numbers = std::get_if<std::vector<double>*>(&field.value))
    {
      **numbers = parse<std::vector<double>>(field.key, node, "a list of numbers");
    }
    else
    {
      const auto value = parse<double>(field.key, node, "a number");
      if (!std::isfinite(value))
      {
        fail(field.key, "is " + node.Scalar() + ", expected a finite number");
      }
      *std::get<double*>(field.value) = value;
    }
  }

  const std::string& file_;
  const std::vector<OptionField>& fields_;
  const std::vector<std::string>& foreign_;
  std::set<std::string> loaded_;
};

}  // namespace

std::vector<OptionField> optionFields(VioOptions* vio, MapperOptions* mapper)
{
  ImuModel& imu = vio->imu;
  StereoTrackerOptions& tracker = vio->tracker;
  InitializerOptions& initializer = vio->initializer;
  StandstillOptions& standstill = vio->standstill;
  WindowOptions& window = vio->window;
  WheelOptions& wheels = vio->wheels;
  return {
      {"imu/rate_hz", &imu.rate_hz},
      {"imu/gyro_noise_density", &imu.gyro_noise_density},
      {"imu/gyro_random_walk", &imu.gyro_random_walk},
      {"imu/accel_noise_density", &imu.accel_noise_density},
      {"imu/accel_random_walk", &imu.accel_random_walk},
      {"imu/gyro_limit", &imu.gyro_limit},
      {"imu/accel_limit", &imu.accel_limit},
      {"imu/gravity", &imu.gravity},
      {"imu/time_offset_s", &imu.time_offset_s},
      {"imu/gyro_scale", &imu.gyro_scale},
      {"imu/accel_scale", &imu.accel_scale},

      {"tracker/max_features", &tracker.max_features},
      {"tracker/cell_px", &tracker.cell_px},
      {"tracker/min_distance_px", &tracker.min_distance_px},
      {"tracker/fast_threshold", &tracker.fast_threshold},
      {"tracker/levels", &tracker.levels},
      {"tracker/window_px", &tracker.window_px},
      {"tracker/max_iterations", &tracker.max_iterations},
      {"tracker/epsilon_px", &tracker.epsilon_px},
      {"tracker/slow_px", &tracker.slow_px},
      {"tracker/max_residual", &tracker.max_residual},
      {"tracker/epipolar_px", &tracker.epipolar_px},
      {"tracker/min_depth_m", &tracker.min_depth_m},
      {"tracker/kernel_tasks", &tracker.kernel_tasks},

      {"initializer/interval_s", &initializer.interval_s},
      {"initializer/still_window_s", &initializer.still_window_s},
      {"initializer/moving_window_s", &initializer.moving_window_s},
      {"initializer/max_window_s", &initializer.max_window_s},
      {"initializer/min_features", &initializer.min_features},
      {"initializer/gravity_tolerance", &initializer.gravity_tolerance},
      {"initializer/max_accel_bias", &initializer.max_accel_bias},
      {"initializer/max_gyro_bias", &initializer.max_gyro_bias},

      {"standstill/enabled", &standstill.enabled},
      {"standstill/window_s", &standstill.window_s},
      {"standstill/max_flow_px", &standstill.max_flow_px},
      {"standstill/max_gyro_deviation", &standstill.max_gyro_deviation},
      {"standstill/max_accel_deviation", &standstill.max_accel_deviation},
      {"standstill/max_rate", &standstill.max_rate},

      {"window/keyframes", &window.keyframes},
      {"window/max_landmarks", &window.max_landmarks},
      {"window/max_iterations", &window.max_iterations},
      {"window/pixel_noise", &window.pixel_noise},
      {"window/huber_px", &window.huber_px},
      {"window/max_error_px", &window.max_error_px},

      {"wheels/scale_deviation", &wheels.scale_deviation},
      {"wheels/speed_noise", &wheels.speed_noise},
      {"wheels/speed_noise_ratio", &wheels.speed_noise_ratio},
      {"wheels/side_noise", &wheels.side_noise},
      {"wheels/up_noise", &wheels.up_noise},

      {"vio/frame_budget_s", &vio->frame_budget_s},
      {"vio/keyframe_parallax_px", &vio->keyframe_parallax_px},
      {"vio/keyframe_tracked_ratio", &vio->keyframe_tracked_ratio},
      {"vio/keyframe_max_interval_s", &vio->keyframe_max_interval_s},
      {"vio/keyframe_min_interval_s", &vio->keyframe_min_interval_s},
      {"vio/max_speed", &vio->max_speed},
      {"vio/max_blind_s", &vio->max_blind_s},
      {"vio/readout_s", &vio->readout_s},
      {"vio/refine_calibration", &vio->refine_calibration},

      {"map/keyframe_distance_m", &mapper->keyframe_distance_m},
      {"map/keyframe_angle_deg", &mapper->keyframe_angle_deg},
      {"map/features", &mapper->features},
      {"map/max_keyframes", &mapper->max_keyframes},
      {"map/tile_folder", &mapper->tile_folder},
      {"map/max_stored_keyframes", &mapper->max_stored_keyframes},
      {"map/max_landmark_range_m", &mapper->max_landmark_range_m},
      {"map/voxel_m", &mapper->voxel_m},
      {"map/loop_closure", &mapper->loop_closure},
      {"map/min_inliers", &mapper->min_inliers},
      {"map/threaded", &mapper->threaded},
      {"map/kernel_tasks", &mapper->kernel_tasks},
  };
}

void loadOptionsYaml(const std::string& file, VioOptions* vio, MapperOptions* mapper,
                     const std::vector<std::string>& foreign)
{
  VioOptions new_vio = *vio;
  MapperOptions new_mapper = *mapper;
  const std::vector<OptionField> fields = optionFields(&new_vio, &new_mapper);
  YAML::Node root;
  try
  {
    root = YAML::LoadFile(file);
  }
  catch (const YAML::BadFile&)
  {
    throw OptionsError(file + ": missing or not readable");
  }
  catch (const YAML::Exception& exception)
  {
    throw OptionsError(file + ": is no YAML: " + exception.what());
  }
  if (!root.IsNull() && !root.IsMap())
  {
    throw OptionsError(file + ": is no map of options, as in tracker: {max_features: 200}");
  }
  Loader(file, fields, foreign).load(root, "");
  *vio = new_vio;
  *mapper = new_mapper;
}

}  // namespace pi_slam
