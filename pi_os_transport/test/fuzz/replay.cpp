// Runs a fuzz target without a fuzzer: over its corpus, and over changed copies of it that are the same each time.

#include <dirent.h>
#include <errno.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <memory>
#include <random>

#include "fuzz_input.h"

namespace
{

using Bytes = std::vector<uint8_t>;

constexpr uint32_t CHANGED_COPIES = 1500;

std::string corpusFolder()
{
  const std::string program = program_invocation_short_name;
  const std::string prefix = "pi_os_transport_test_replay_";
  return std::string(PI_OS_CORPORA) + "/" + program.substr(std::min(program.size(), prefix.size()));
}

std::vector<Bytes> corpus()
{
  std::vector<std::string> names;
  if (DIR* folder = opendir(corpusFolder().c_str()))
  {
    while (const dirent* entry = readdir(folder))
    {
      if (entry->d_name[0] != '.')
      {
        names.push_back(entry->d_name);
      }
    }
    closedir(folder);
  }
  std::sort(names.begin(), names.end());
  std::vector<Bytes> inputs;
  for (const std::string& name : names)
  {
    std::ifstream file(corpusFolder() + "/" + name, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return inputs;
}

/// In a place of exactly its size: the address sanitizer sees what is read beyond it.
void run(const Bytes& input)
{
  const auto exact = std::make_unique<uint8_t[]>(input.size());
  std::copy(input.begin(), input.end(), exact.get());
  LLVMFuzzerTestOneInput(exact.get(), input.size());
}

TEST(Replay, CorpusHolds)
{
  const std::vector<Bytes> inputs = corpus();
  ASSERT_FALSE(inputs.empty()) << "nothing in " << corpusFolder();
  run(Bytes());
  for (const Bytes& input : inputs)
  {
    run(input);
  }
}

TEST(Replay, ChangedCopiesHold)
{
  const std::vector<Bytes> inputs = corpus();
  std::mt19937 random(1);
  for (uint32_t copy = 0; copy < CHANGED_COPIES; ++copy)
  {
    Bytes input = inputs.empty() ? Bytes(64) : inputs[random() % inputs.size()];
    for (uint32_t changes = 1 + random() % 8; changes > 0 && !input.empty(); --changes)
    {
      const size_t at = random() % input.size();
      switch (random() % 4)
      {
        case 0:
          input[at] = static_cast<uint8_t>(random());
          break;
        case 1:
          input[at] = static_cast<uint8_t>(random() % 2 == 0 ? 0 : 255);
          break;
        case 2:
          input.resize(at);
          break;
        default:
          input.insert(input.begin() + static_cast<std::ptrdiff_t>(at), static_cast<uint8_t>(random()));
          break;
      }
    }
    run(input);
  }
}

}  // namespace

int main(int argc, char** argv)
{
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
