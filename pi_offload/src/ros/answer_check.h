#pragma once

#include <pi_detect/detection.h>

#include <cstdint>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

namespace pi_offload
{

/// How the vehicle finds nodes that give false answers.
struct AnswerCheckOptions
{
  int every = 50;              ///< one of so many answered pictures of a node is also detected on board; 0: none
  int suspect_every = 5;       ///< the same for a node that disagreed lately or was hardly checked, in [1, every]
  double cool_down_s = 600.0;  ///< a node that was taken out comes back after this time [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Compares answers of nodes with what the vehicle's own detector finds in the same pictures, and says which node is to
/// be taken out.
///
/// In each run of `every` answers one is due, at a random place: a node cannot know which. A comparison gives a
/// disagreement of 0 to 1: the share of clear objects (score, size) of one side without a partner on the other. A
/// cumulative sum decides: score = max(0, score + disagreement - ALLOWED), out at LIMIT. A node whose answers have
/// nothing to do with the pictures is out after 7 comparisons, see docs/design/offload.md for the figures. The same
/// disagreement at the same place counts once in REPEAT_S: a standing vehicle sees one odd thing in many pictures.
/// Not thread safe.
class AnswerCheck
{
public:
  static constexpr double ALLOWED = 0.35;  ///< disagreement of honest networks; those of pi_detect have 0 to 0.10
  static constexpr double LIMIT = 4.0;
  static constexpr float CLEAR_SCORE = 0.6F;  ///< objects below are matched, but need no partner
  static constexpr float CLEAR_AREA = 0.01F;  ///< in parts of the picture; likewise
  static constexpr float SAME_PLACE = 0.4F;   ///< overlap of partners
  static constexpr double REPEAT_S = 60.0;

  /// @param seed  of the places of checks, which nodes must not know. @throws std::invalid_argument for options.
  explicit AnswerCheck(const AnswerCheckOptions& options, uint32_t seed = std::random_device()());

  /// A node answered a picture. @return true: this one is to be detected on board, too.
  bool due(const std::string& node);

  struct Pair
  {
    pi_detect::Detections answered;  ///< by the node
    pi_detect::Detections own;       ///< by the vehicle
    float area = 0.0F;               ///< of the picture [px^2]
    /// Classes that both networks have; null: not known. Then those count that the node ever answered, if there are
    /// any.
    const std::set<int>* common = nullptr;
  };
  /// @return true: the node is to be taken out now; status() has the reason.
  bool judge(const std::string& node, const Pair& pair, int64_t now_ns);

  /// Nodes whose time out is over. They begin anew, as nodes that were hardly checked.
  std::vector<std::string> pardoned(int64_t now_ns);
  /// The node was registered anew or removed.
  void forget(const std::string& node) { nodes_.erase(node); }

  struct Status
  {
    uint64_t checked = 0;    ///< comparisons with at least one clear object
    uint64_t disagreed = 0;  ///< of them, with a disagreement above ALLOWED
    std::string reason;      ///< why it is out; empty: it is not
  };
  Status status(const std::string& node) const;
  std::map<std::string, Status> statuses() const;  ///< by node

private:
  /// A clear object without a partner.
  struct Odd
  {
    pi_detect::Detection object;
    bool answered = false;  ///< by the node
    int64_t counted_ns = 0;
  };
  struct Node
  {
    int left = 0;  ///< answers of the present run
    int until_due = 0;
    bool close = true;  ///< the run is of suspect_every
    double score = 0.0;
    Status status;
    std::set<int> classes;  ///< that it answered
    std::vector<Odd> odd;
    int64_t out_ns = 0;
  };
  struct Count
  {
    int clear = 0;
    int odd = 0;
  };

  static void count(Node* node, const Pair& pair, bool answered, int64_t now_ns, Count* sum);

  const AnswerCheckOptions options_;
  std::mt19937 random_;
  std::map<std::string, Node> nodes_;
};

}  // namespace pi_offload
