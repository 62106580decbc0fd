#pragma once

#include "map/mapper.h"
#include "odometry/vio.h"

#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace pi_slam
{

/// A file of options that cannot be used. what() names the file, the key and the defect.
class OptionsError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// One option under the name it has in YAML files and as a parameter of the nodelet: "tracker/max_features".
struct OptionField
{
  std::string key;
  std::variant<bool*, int*, size_t*, double*, std::string*, std::vector<double>*> value;
};

/// Every option of odometry (imu/, tracker/, initializer/, standstill/, window/, wheels/, vio/ for VioOptions' own) and
/// of the map (map/).
/// @param vio,mapper  what the fields point into.
std::vector<OptionField> optionFields(VioOptions* vio, MapperOptions* mapper);

/// Replaces the options that a YAML file names; the others stay as they are. Groups are nested maps or written with a
/// slash: {tracker: {max_features: 200}} or {tracker/max_features: 200}. Ranges are checked by validate().
/// @param foreign  keys, or whole groups, of other readers (frames of the nodelet), which are ignored.
/// @throws OptionsError for a file that is missing or no YAML, an unknown key (with the nearest known one), a key that
///         is there twice, or a value of another type; the options are unchanged then.
void loadOptionsYaml(const std::string& file, VioOptions* vio, MapperOptions* mapper,
                     const std::vector<std::string>& foreign = {});

}  // namespace pi_slam
