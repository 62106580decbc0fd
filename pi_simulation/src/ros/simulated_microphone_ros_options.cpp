#include "ros/simulated_microphone_ros_options.h"

#include <pi_node/ros/parameter_tree.h>

namespace pi_simulation
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(SimulatedMicrophoneRosOptions& options, Visitor&& visit)
{
  visit("frame_id", options.frame_id);
  visit("noise_level_dbfs", options.mixer.noise_level_dbfs);
  visit("seed", options.mixer.seed);
  visit("background", options.mixer.background);
  visit("background_level_dbfs", options.mixer.background_level_dbfs);
  visit("play_gain_db", options.mixer.play_gain_db);
}

void SimulatedMicrophoneRosOptions::validate() const
{
  mixer.validate();
  const std::string& sound = mixer.background;
  pi_node::parameters::require(sound.empty() || sound.front() == '/' || pi_speech::NoiseSource::isMade(sound),
                               "background", "\"" + sound + "\"",
                               "white, pink, wind, or an absolute path: a node's working folder is not its user's");
}

}  // namespace pi_simulation

template struct pi_node::NodeParameters<pi_simulation::SimulatedMicrophoneRosOptions>;
