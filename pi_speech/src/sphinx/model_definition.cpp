#include "sphinx/model_definition.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <optional>

namespace pi_speech
{
namespace
{

constexpr char BINARY[] = "BMDF";

/// The numbers that the file begins with, in their order.
enum Count
{
  CI_PHONES,
  PHONES,
  STATES,
  CI_SENONES,
  SENONES,
  TRANSITION_MATRICES,
  SEQUENCES,
  CONTEXTS,
  TREE_NODES,
  SILENCE,
  COUNTS
};

/// Node of the tree that finds a triphone by its context.
struct TreeNode
{
  int16_t context;
  int16_t children;
  int32_t first_child_or_phone;
};

struct PhoneEntry
{
  int32_t sequence;
  int32_t transition_matrix;
  std::array<uint8_t, 4> position_and_context;
};

class Bytes
{
public:
  explicit Bytes(std::string content) : content_(std::move(content)) {}

  bool skip(int64_t count)
  {
    if (count < 0 || count > static_cast<int64_t>(content_.size() - position_))
    {
      return false;
    }
    position_ += static_cast<size_t>(count);
    return true;
  }

  template <typename T>
  std::optional<T> next()
  {
    T value;
    const size_t begin = position_;
    if (!skip(sizeof(T)))
    {
      return std::nullopt;
    }
    std::memcpy(&value, content_.data() + begin, sizeof(T));
    return value;
  }

  /// Past a text and the zero behind it.
  bool skipText()
  {
    const size_t end = content_.find('\0', position_);
    return end != std::string::npos && skip(static_cast<int64_t>(end + 1 - position_));
  }

  size_t position() const { return position_; }

private:
  const std::string content_;
  size_t position_ = 0;
};

bool isIndex(int64_t value, int64_t count)
{
  return value >= 0 && value < count;
}

using Counts = std::array<int32_t, COUNTS>;

constexpr char TOO_SHORT[] = "it is too short";

std::string problemOfCounts(const Counts& counts)
{
  for (const Count which : {CI_PHONES, PHONES, CI_SENONES, SENONES, TRANSITION_MATRICES, SEQUENCES})
  {
    if (counts[which] <= 0)
    {
      return "it has no phones or states";
    }
  }
  const bool fit = counts[STATES] >= 0 && counts[TREE_NODES] >= 0 && counts[CI_PHONES] <= counts[PHONES] &&
                   counts[CI_SENONES] <= counts[SENONES] && isIndex(counts[SILENCE], counts[CI_PHONES]);
  return fit ? "" : "its numbers of phones and states do not fit together";
}

/// Names of phones, padded to 4 bytes.
std::string problemOfNames(const Counts& counts, Bytes* bytes)
{
  const size_t begin = bytes->position();
  for (int32_t i = 0; i < counts[CI_PHONES]; ++i)
  {
    if (!bytes->skipText())
    {
      return TOO_SHORT;
    }
  }
  return bytes->skip(static_cast<int64_t>((4 - (bytes->position() - begin) % 4) % 4)) ? "" : TOO_SHORT;
}

std::string problemOfTree(const Counts& counts, Bytes* bytes)
{
  for (int32_t i = 0; i < counts[TREE_NODES]; ++i)
  {
    const std::optional<TreeNode> node = bytes->next<TreeNode>();
    if (!node)
    {
      return TOO_SHORT;
    }
    const int64_t target = node->first_child_or_phone;
    const bool good = node->children > 0 ? target >= 0 && target + node->children <= counts[TREE_NODES]
                                         : target >= -1 && target < counts[PHONES];
    if (!good)
    {
      return "its tree of phones points outside of it";
    }
  }
  return "";
}

std::string problemOfPhones(const Counts& counts, Bytes* bytes)
{
  for (int32_t i = 0; i < counts[PHONES]; ++i)
  {
    const std::optional<PhoneEntry> phone = bytes->next<PhoneEntry>();
    if (!phone)
    {
      return TOO_SHORT;
    }
    if (!isIndex(phone->sequence, counts[SEQUENCES]) || !isIndex(phone->transition_matrix, counts[TRANSITION_MATRICES]))
    {
      return "phone " + std::to_string(i) + " has states that do not exist";
    }
  }
  return "";
}

std::string problemOfSequences(const Counts& counts, Bytes* bytes)
{
  const std::optional<int32_t> states = bytes->next<int32_t>();
  if (!states || *states < int64_t{counts[SEQUENCES]} * counts[STATES])
  {
    return TOO_SHORT;
  }
  for (int32_t i = 0; i < *states; ++i)
  {
    const std::optional<uint16_t> senone = bytes->next<uint16_t>();
    if (!senone)
    {
      return TOO_SHORT;
    }
    if (*senone >= counts[SENONES])
    {
      return "a sequence has a state that does not exist";
    }
  }
  return "";
}

}  // namespace

std::string problemOfModelDefinition(const std::string& path)
{
  std::ifstream file(path, std::ios::binary);
  Bytes bytes(std::string{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()});
  const std::optional<std::array<char, 4>> kind = bytes.next<std::array<char, 4>>();
  if (!kind || std::memcmp(kind->data(), BINARY, kind->size()) != 0)
  {
    return "";
  }
  const std::optional<int32_t> version = bytes.next<int32_t>();
  const std::optional<int32_t> description = bytes.next<int32_t>();
  if (!version || !description || !bytes.skip(*description))
  {
    return TOO_SHORT;
  }
  const std::optional<Counts> counts = bytes.next<Counts>();
  if (!counts)
  {
    return TOO_SHORT;
  }
  std::string problem = problemOfCounts(*counts);
  for (const auto part : {problemOfNames, problemOfTree, problemOfPhones, problemOfSequences})
  {
    problem = problem.empty() ? part(*counts, &bytes) : problem;
  }
  return problem;
}

}  // namespace pi_speech
