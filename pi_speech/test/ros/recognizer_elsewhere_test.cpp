// Judge of recognizer_elsewhere.test.

#include "ros/recognizer_on_graph.h"

#include <gtest/gtest.h>
#include <pi_speech/RecognizeUtterance.h>
#include <ros/callback_queue.h>

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

namespace pi_speech
{
namespace
{

using Texts = std::vector<std::string>;
constexpr char LEFT[] = "left/1acc97de_nohash_0.flac";

/// The service, in a thread of its own.
class Elsewhere
{
public:
  using Answer = std::function<bool(const RecognizeUtterance::Request&, RecognizeUtterance::Response*)>;

  Elsewhere(const std::string& name, Answer answer) : answer_(std::move(answer)), spinner_(1, &queue_)
  {
    ros::NodeHandle node;
    node.setCallbackQueue(&queue_);
    server_ = node.advertiseService(name, &Elsewhere::serve, this);
    spinner_.start();
  }

  Texts commands()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return commands_;
  }
  size_t calls()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return calls_;
  }

private:
  bool serve(RecognizeUtterance::Request& request, RecognizeUtterance::Response& response)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ++calls_;
      commands_ = request.commands;
    }
    return answer_(request, &response);
  }

  Answer answer_;
  std::mutex mutex_;
  size_t calls_ = 0;
  Texts commands_;
  ros::CallbackQueue queue_;
  ros::ServiceServer server_;
  ros::AsyncSpinner spinner_;
};

/// What is loud enough to be an utterance, and no word.
Samples burst()
{
  Samples samples = quiet(0.5);
  Samples loud = quiet(0.5);
  for (int16_t& sample : loud)
  {
    sample = static_cast<int16_t>(200 * sample);
  }
  samples.insert(samples.end(), loud.begin(), loud.end());
  const Samples after = quiet(1.0);
  samples.insert(samples.end(), after.begin(), after.end());
  return samples;
}

TEST(RecognizerElsewhere, TakesTheAnswerOfTheService)
{
  Elsewhere elsewhere("/answered/edge",
                      [](const RecognizeUtterance::Request& request, RecognizeUtterance::Response* response)
                      {
                        response->handled = !request.samples.empty() && request.speech_s > 0.3;
                        response->text = "left";
                        response->accepted = true;
                        response->confidence = 0.75;
                        response->node = "edge1";
                        return true;
                      });
  RecognizerOnGraph recognizer("answered");
  recognizer.set("utterance_service", std::string("/answered/edge"));
  recognizer.set("utterance_deadline_s", 5.0);
  SourceOnGraph source("answered");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  source.send(burst());
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  EXPECT_EQ(Texts{"left"}, recognizer.heard());
  EXPECT_FLOAT_EQ(0.75F, recognizer.commands.messages().front()->confidence);
  const Texts commands = elsewhere.commands();
  EXPECT_NE(commands.end(), std::find(commands.begin(), commands.end(), "stop"));
}

TEST(RecognizerElsewhere, AnswerThatIsNoCommandIsRejected)
{
  Elsewhere elsewhere("/strange/edge",
                      [](const RecognizeUtterance::Request&, RecognizeUtterance::Response* response)
                      {
                        response->handled = true;
                        response->text = "explode";
                        response->accepted = true;
                        return true;
                      });
  RecognizerOnGraph recognizer("strange");
  recognizer.set("utterance_service", std::string("/strange/edge"));
  recognizer.set("utterance_deadline_s", 5.0);
  SourceOnGraph source("strange");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  source.send(burst());
  EXPECT_TRUE(recognizer.rejected.waitFor([](const VoiceCommand& command) { return command.text.empty(); }))
      << recognizer.text();
  EXPECT_EQ(Texts(), recognizer.heard());
}

TEST(RecognizerElsewhere, RecognisesItselfWhatTheServiceDoesNotHandleOrAnswer)
{
  if (clipPath("").empty())
  {
    GTEST_SKIP() << "needs the recordings: PI_EDGE_DATA is not set";
  }
  std::mutex mutex;
  std::condition_variable changed;
  bool over = false;
  Elsewhere elsewhere("/hanging/edge",
                      [&](const RecognizeUtterance::Request&, RecognizeUtterance::Response* response)
                      {
                        response->handled = false;
                        std::unique_lock<std::mutex> lock(mutex);
                        changed.wait(lock, [&over] { return over; });
                        return true;
                      });
  {
    RecognizerOnGraph recognizer("hanging");
    recognizer.set("utterance_service", std::string("/hanging/edge"));
    recognizer.set("utterance_deadline_s", 0.05);
    SourceOnGraph source("hanging");
    ASSERT_TRUE(recognizer.load());
    ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
    ASSERT_TRUE(source.waitForListener());
    source.send(spoken(LEFT));
    ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
    EXPECT_EQ(Texts{"left"}, recognizer.heard());
    EXPECT_EQ(1U, elsewhere.calls());  // it is not asked again before it has answered
    std::lock_guard<std::mutex> lock(mutex);
    over = true;
    changed.notify_all();
  }
  RecognizerOnGraph recognizer("alone");
  recognizer.set("utterance_service", std::string("/no/such/service"));
  SourceOnGraph source("alone");
  ASSERT_TRUE(recognizer.load());
  ASSERT_TRUE(recognizer.waitUntilReady()) << recognizer.text();
  ASSERT_TRUE(source.waitForListener());
  source.send(spoken(LEFT));
  ASSERT_TRUE(recognizer.waitForCommands(1)) << recognizer.text();
  EXPECT_EQ(Texts{"left"}, recognizer.heard());
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "recognizer_elsewhere_test");
}
