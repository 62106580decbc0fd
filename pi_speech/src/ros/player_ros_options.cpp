#include "ros/player_ros_options.h"
#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>

namespace pi_speech
{

namespace parameter_tree = pi_node::parameter_tree;
using XmlRpc::XmlRpcValue;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(PlayerRosOptions& options, Visitor&& visit)
{
  visit("files", options.files);
  visit("rate", options.rate);
  visit("loop", options.loop);
  visit("gap_s", options.gap_s);
  visit("gap_level_dbfs", options.gap_level_dbfs);
  visit("period_s", options.period_s);
  visit("start_when_subscribed", options.start_when_subscribed);
  visit("frame_id", options.frame_id);
}

static void read(const XmlRpcValue& value, SoundFileEntries* field)
{
  if (value.getType() == XmlRpcValue::TypeString)
  {
    std::string entry;
    pi_node::parameters::read(value, &entry);
    field->entries.clear();
    if (!entry.empty())
    {
      field->entries.push_back(entry);
    }
    return;
  }
  pi_node::parameters::requireType(value, XmlRpcValue::TypeArray, "a text or a list of texts");
  pi_node::parameters::read(value, &field->entries);
}

static XmlRpcValue write(const SoundFileEntries& field)
{
  return pi_node::parameters::write(field.entries);
}

void PlayerRosOptions::validate() const
{
  for (const std::string& entry : files.entries)
  {
    pi_node::parameters::require(!entry.empty() && entry.front() == '/', "files", "\"" + entry + "\"",
                                 "absolute paths: a node's working folder is not its user's");
  }
  const pi_node::OptionCheck check("");
  check.range("rate", rate, 0.01, 1000.0);
  check.range("gap_s", gap_s, 0.0, 60.0);
  check.range("gap_level_dbfs", gap_level_dbfs, -120.0, 0.0);
  check.range("period_s", period_s, 0.002, 1.0);
}

}  // namespace pi_speech

template struct pi_node::NodeParameters<pi_speech::PlayerRosOptions>;
