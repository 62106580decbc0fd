#include "ros/answer_check.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>

#include <algorithm>

namespace pi_offload
{
namespace
{

using pi_detect::Detection;
using pi_node::format;

constexpr uint64_t PROVEN = 5;  ///< comparisons without a lasting disagreement, after which a node is checked seldom

bool clear(const Detection& object, float area)
{
  return object.score >= AnswerCheck::CLEAR_SCORE && object.box.area() >= AnswerCheck::CLEAR_AREA * area;
}

bool same(const Detection& a, const Detection& b)
{
  return a.class_id == b.class_id && pi_detect::overlap(a.box, b.box) >= AnswerCheck::SAME_PLACE;
}

}  // namespace

void AnswerCheckOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("every", every, 0, 1000000);
  check.range("suspect_every", suspect_every, 1, every > 0 ? every : 1000000);
  check.range("cool_down_s", cool_down_s, 1.0, 1e6);
}

AnswerCheck::AnswerCheck(const AnswerCheckOptions& options, uint32_t seed)
  : options_((options.validate(), options)), random_(seed)
{
}

bool AnswerCheck::due(const std::string& id)
{
  if (options_.every == 0)
  {
    return false;
  }
  Node& node = nodes_[id];
  const bool close = node.score > 0.0 || node.status.checked < PROVEN;
  if (node.left == 0 || (close && !node.close))
  {
    node.close = close;
    node.left = close ? options_.suspect_every : options_.every;
    node.until_due = std::uniform_int_distribution<int>(0, node.left - 1)(random_);
  }
  --node.left;
  return node.until_due-- == 0;
}

/// Adds the clear objects of one side.
void AnswerCheck::count(Node* node, const Pair& pair, bool answered, int64_t now_ns, Count* sum)
{
  const pi_detect::Detections& from = answered ? pair.answered : pair.own;
  const pi_detect::Detections& others = answered ? pair.own : pair.answered;
  const std::set<int>* classes = pair.common != nullptr ? pair.common : &node->classes;
  const bool all_classes = pair.common == nullptr && node->classes.empty();
  for (const Detection& object : from)
  {
    if (!clear(object, pair.area) || (!all_classes && classes->count(object.class_id) == 0))
    {
      continue;
    }
    const auto is_same = [&object](const Detection& other) { return same(object, other); };
    if (std::any_of(others.begin(), others.end(), is_same))
    {
      ++sum->clear;
      continue;
    }
    const auto is_known = [&](const Odd& odd) { return odd.answered == answered && same(odd.object, object); };
    if (std::none_of(node->odd.begin(), node->odd.end(), is_known))
    {
      ++sum->clear;
      ++sum->odd;
      node->odd.push_back({object, answered, now_ns});
    }
  }
}

bool AnswerCheck::judge(const std::string& id, const Pair& pair, int64_t now_ns)
{
  Node& node = nodes_[id];
  const auto is_old = [now_ns](const Odd& odd) { return pi_node::secondsBetween(odd.counted_ns, now_ns) >= REPEAT_S; };
  node.odd.erase(std::remove_if(node.odd.begin(), node.odd.end(), is_old), node.odd.end());
  for (const Detection& object : pair.answered)
  {
    node.classes.insert(object.class_id);
  }
  Count sum;
  count(&node, pair, true, now_ns, &sum);
  count(&node, pair, false, now_ns, &sum);
  if (sum.clear == 0 || !node.status.reason.empty())
  {
    return false;
  }
  const double disagreement = static_cast<double>(sum.odd) / sum.clear;
  ++node.status.checked;
  node.status.disagreed += disagreement > ALLOWED ? 1 : 0;
  node.score = std::max(0.0, node.score + disagreement - ALLOWED);
  if (node.score < LIMIT)
  {
    return false;
  }
  node.status.reason = "its answers do not fit the pictures: " + std::to_string(node.status.disagreed) + " of " +
                       std::to_string(node.status.checked) +
                       " compared ones disagree with the vehicle's own detector; it gets no tasks" +
                       format(" for %.0f s, or until it is registered again", options_.cool_down_s);
  node.out_ns = now_ns;
  return true;
}

std::vector<std::string> AnswerCheck::pardoned(int64_t now_ns)
{
  std::vector<std::string> pardoned;
  for (auto& [id, node] : nodes_)
  {
    if (!node.status.reason.empty() && pi_node::secondsBetween(node.out_ns, now_ns) >= options_.cool_down_s)
    {
      pardoned.push_back(id);
      node = Node();
    }
  }
  return pardoned;
}

AnswerCheck::Status AnswerCheck::status(const std::string& id) const
{
  const auto node = nodes_.find(id);
  return node == nodes_.end() ? Status() : node->second.status;
}

std::map<std::string, AnswerCheck::Status> AnswerCheck::statuses() const
{
  std::map<std::string, Status> statuses;
  for (const auto& [id, node] : nodes_)
  {
    statuses[id] = node.status;
  }
  return statuses;
}

}  // namespace pi_offload
