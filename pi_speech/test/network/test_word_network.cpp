#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "network/word_network.h"

namespace pi_speech
{

using namespace pi_node::test_support;

namespace
{

namespace fs = std::filesystem;

const std::string GOLDEN_NETWORK = std::string(PI_SPEECH_TEST) + "/network/golden_network.bin";
const std::string GOLDEN_ANSWERS = std::string(PI_SPEECH_TEST) + "/network/golden_answers.txt";

std::string loadErrorOfNetwork(const std::string& path)
{
  try
  {
    WordNetwork::load(path);
    return "";
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
}

/// The sound of training/network/make_golden.
Samples goldenSound()
{
  Samples samples(16000);
  for (int64_t i = 0; i < 16000; ++i)
  {
    samples[static_cast<size_t>(i)] = static_cast<int16_t>((i * i % 997 - 498) * (1 + i / 800 % 20));
  }
  return samples;
}

class WordNetworkFile : public testing::Test
{
protected:
  void SetUp() override
  {
    std::ifstream stream(GOLDEN_NETWORK, std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
    ASSERT_GT(bytes_.size(), 1000U);
  }

  const TemporaryFolder folder_;
  std::string bytes_;
};

// The answers come from PyTorch and the Python front end that the network is trained with.
TEST(WordNetwork, AnswersAsInTraining)
{
  WordNetworkStream network(WordNetwork::load(GOLDEN_NETWORK));
  const Samples samples = goldenSound();
  FilterBank bank;
  std::ifstream answers(GOLDEN_ANSWERS);
  for (int repeat = 0; repeat < 2; ++repeat)
  {
    int steps = 0;
    for (size_t frame = 0; frame < framesOf(samples.size()); ++frame)
    {
      if (!network.add(bank.energies(samples.data() + frame * HOP_SAMPLES)))
      {
        continue;
      }
      ++steps;
      for (const float probability : network.probabilities())
      {
        float expected = -1.0F;
        ASSERT_TRUE(answers >> expected);
        EXPECT_NEAR(expected, probability, 1e-4) << "step " << steps;
      }
    }
    EXPECT_EQ(49, steps);
    answers.seekg(0);
    network.reset();
  }
}

TEST_F(WordNetworkFile, HasWordsAndSizes)
{
  const WordNetwork network = *WordNetwork::load(GOLDEN_NETWORK);

  EXPECT_EQ((std::vector<std::string>{"go", "stop"}), network.words);
  EXPECT_EQ(0, network.find("go"));
  EXPECT_EQ(-1, network.find("left"));
  EXPECT_EQ(6, network.channels());
  ASSERT_EQ(2U, network.layers.size());
  EXPECT_EQ(3, network.layers[1].dilation);
}

TEST_F(WordNetworkFile, IsAnErrorWhereverItIsTruncated)
{
  for (size_t size = 0; size < bytes_.size(); size += size < 100 ? 1 : 97)
  {
    const std::string path = folder_.file("short.bin", bytes_.substr(0, size));
    EXPECT_EQ(0U, loadErrorOfNetwork(path).find(path + ": ")) << size << " bytes: " << loadErrorOfNetwork(path);
  }
}

TEST_F(WordNetworkFile, IsAnErrorWhereverAByteIsAltered)
{
  for (size_t at = 0; at < bytes_.size(); at += at < 100 ? 1 : 31)
  {
    std::string altered = bytes_;
    altered[at] = static_cast<char>(altered[at] ^ 0x10);
    const std::string path = folder_.file("altered.bin", altered);
    EXPECT_EQ(0U, loadErrorOfNetwork(path).find(path + ": ")) << "byte " << at << ": " << loadErrorOfNetwork(path);
  }
}

TEST_F(WordNetworkFile, OfAnotherKindOrMissingIsNamed)
{
  const std::string text = folder_.file("text.bin", std::string(5000, 'a'));
  const std::string longer = folder_.file("long.bin", bytes_ + "x");
  const std::string missing = folder_.path() + "/missing.bin";

  EXPECT_EQ(0U, loadErrorOfNetwork(text).find(text + ": this is no file of a word network"))
      << loadErrorOfNetwork(text);
  EXPECT_EQ(0U, loadErrorOfNetwork(longer).find(longer + ": the word network is damaged"))
      << loadErrorOfNetwork(longer);
  EXPECT_EQ(0U, loadErrorOfNetwork(missing).find(missing + ": ")) << loadErrorOfNetwork(missing);
  EXPECT_NE(std::string::npos, loadErrorOfNetwork(missing).find("No such file")) << loadErrorOfNetwork(missing);
  EXPECT_EQ(0U, loadErrorOfNetwork(folder_.path()).find(folder_.path() + ": ")) << loadErrorOfNetwork(folder_.path());
}

}  // namespace
}  // namespace pi_speech
