#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/audio.h>

#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <sstream>

#include "server/executors.h"
#include "tiny_network.h"
#include "wire/raw_socket.h"

using namespace pi_offload;

namespace
{

using Bytes = std::vector<uint8_t>;

/// A dark picture of 64 x 48 with cell (2, 1) of 4 x 4 white, which is what the tiny network finds.
cv::Mat cellPicture(int type)
{
  cv::Mat picture(48, 64, type, cv::Scalar::all(0));
  picture(cv::Rect(32, 12, 16, 12)) = cv::Scalar::all(255);
  return picture;
}

Bytes bytesOf(const cv::Mat& picture)
{
  return Bytes(picture.datastart, picture.dataend);
}

Bytes jpegOf(const cv::Mat& picture)
{
  Bytes jpeg;
  cv::imencode(".jpg", picture, jpeg, {cv::IMWRITE_JPEG_QUALITY, 95});
  return jpeg;
}

OffloadRequest pictureRequest(Encoding encoding, uint32_t width, uint32_t height, Bytes payload)
{
  OffloadRequest request;
  request.type = OffloadRequest::Type::TASK;
  request.vehicle = "car";
  request.kind = TaskKind::DETECTION;
  request.encoding = encoding;
  request.width = width;
  request.height = height;
  request.payload = std::move(payload);
  return request;
}

std::string errorOf(const std::function<void()>& action)
{
  try
  {
    action();
  }
  catch (const std::exception& error)
  {
    return error.what();
  }
  return "";
}

class Detection : public testing::Test
{
protected:
  Detection()
  {
    options_.model = pi_detect::writeTinyNetwork(folder_.path());
    options_.detector.check_model = false;
    options_.detector.threads = 1;
  }
  pi_node::test_support::TemporaryFolder folder_;
  DetectionExecutorOptions options_;
};

pi_speech::CommandTable tableOf(const std::string& lines)
{
  return commandsOf(lines, 100);
}

std::string speechConfig(const std::string& name)
{
  return std::string(PI_SPEECH_CONFIG) + "/" + name;
}

SpeechExecutorOptions speechOptions()
{
  SpeechExecutorOptions options;
  options.recognizer.word_network = speechConfig("word_network.bin");
  options.recognizer.garbage_words = speechConfig("garbage_words.txt");
  options.recognizer.confidence = speechConfig("confidence.yaml");
  options.recognizer.sphinx.check_model = false;
  options.commands = pi_speech::CommandTable::load(speechConfig("commands.yaml"));
  return options;
}

OffloadRequest soundRequest(const pi_speech::Samples& samples, const std::string& commands = "")
{
  OffloadRequest request;
  request.type = OffloadRequest::Type::TASK;
  request.vehicle = "car";
  request.kind = TaskKind::SPEECH;
  request.encoding = Encoding::S16LE;
  request.options = commands;
  for (const int16_t sample : samples)
  {
    request.payload.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) & 0xffU));
    request.payload.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) >> 8U));
  }
  return request;
}

TEST_F(Detection, FindsTheSameInEveryEncoding)
{
  Executor run = detectionExecutor(options_)();
  cv::Mat rgb;
  cv::cvtColor(cellPicture(CV_8UC3), rgb, cv::COLOR_BGR2RGB);
  const std::map<std::string, OffloadRequest> requests = {
      {"bgr", pictureRequest(Encoding::BGR8, 64, 48, bytesOf(cellPicture(CV_8UC3)))},
      {"rgb", pictureRequest(Encoding::RGB8, 64, 48, bytesOf(rgb))},
      {"mono", pictureRequest(Encoding::MONO8, 64, 48, bytesOf(cellPicture(CV_8UC1)))},
      {"jpeg", pictureRequest(Encoding::JPEG, 0, 0, jpegOf(cellPicture(CV_8UC3)))},
      {"grey jpeg", pictureRequest(Encoding::JPEG, 0, 0, jpegOf(cellPicture(CV_8UC1)))},
  };
  for (const auto& request : requests)
  {
    double service_s = -1.0;
    const OffloadReply reply = run(request.second, &service_s);
    EXPECT_EQ(reply.status, OffloadReply::Status::OK);
    EXPECT_GE(service_s, 0.0);
    EXPECT_NE(reply.model, "");
    ASSERT_EQ(reply.objects.size(), 1U) << request.first;
    const DetectedObject& found = reply.objects[0];
    EXPECT_EQ(found.label, "bright") << request.first;
    EXPECT_GT(found.score, 0.9F) << request.first;
    EXPECT_NEAR(found.x1, 32.0F, 1.0F) << request.first;
    EXPECT_NEAR(found.y1, 12.0F, 1.0F) << request.first;
    EXPECT_NEAR(found.x2, 48.0F, 1.0F) << request.first;
    EXPECT_NEAR(found.y2, 24.0F, 1.0F) << request.first;
  }
}

TEST_F(Detection, SaysWhatIsWrongWithAPicture)
{
  Executor run = detectionExecutor(options_)();
  const auto error = [&](const OffloadRequest& request)
  {
    double service_s = -1.0;
    return errorOf([&] { run(request, &service_s); });
  };
  EXPECT_EQ(error(pictureRequest(Encoding::BGR8, 64, 48, Bytes(10))),
            "a picture of 64 x 48 takes 9216 bytes, there are 10");
  EXPECT_EQ(error(pictureRequest(Encoding::MONO8, 0, 48, {})),
            "a picture of 0 x 48, must be between 2 x 2 and 8192 x 8192");
  EXPECT_EQ(error(pictureRequest(Encoding::RGB8, 4000000000U, 4000000000U, Bytes(10))),
            "a picture of 4000000000 x 4000000000, must be between 2 x 2 and 8192 x 8192");
  EXPECT_EQ(error(pictureRequest(Encoding::S16LE, 64, 48, Bytes(10))), "encoding 5 is not one of a picture");
  EXPECT_EQ(error(pictureRequest(Encoding::JPEG, 0, 0, Bytes(10))), "no JPEG (10 bytes)");
  EXPECT_EQ(error(pictureRequest(Encoding::JPEG, 0, 0, {})), "no JPEG (0 bytes)");
  Bytes huge = jpegOf(cellPicture(CV_8UC3));
  for (size_t at = 0; at + 9 < huge.size(); ++at)
  {
    if (huge[at] == 0xff && huge[at + 1] == 0xc0)
    {
      huge[at + 5] = huge[at + 6] = huge[at + 7] = huge[at + 8] = 0xff;
      break;
    }
  }
  EXPECT_EQ(error(pictureRequest(Encoding::JPEG, 0, 0, huge)),
            "a picture of 65535 x 65535, must be between 2 x 2 and 8192 x 8192");
  // And it goes on.
  EXPECT_EQ(error(pictureRequest(Encoding::JPEG, 0, 0, jpegOf(cellPicture(CV_8UC3)))), "");
}

TEST_F(Detection, DamagedPicturesNeverEndIt)
{
  Executor run = detectionExecutor(options_)();
  const Bytes good = jpegOf(cellPicture(CV_8UC3));
  std::mt19937 random(8);
  int answered = 0;
  int failed = 0;
  for (int round = 0; round < 300; ++round)
  {
    Bytes bytes = good;
    for (unsigned changes = 1 + random() % 8; changes > 0; --changes)
    {
      bytes[2 + random() % (bytes.size() - 2)] = static_cast<uint8_t>(random());
    }
    bytes.resize(round % 3 == 0 ? random() % bytes.size() : bytes.size());
    double service_s = -1.0;
    const std::string error = errorOf([&] { run(pictureRequest(Encoding::JPEG, 0, 0, std::move(bytes)), &service_s); });
    (error.empty() ? answered : failed) += 1;
  }
  EXPECT_GT(answered, 10);
  EXPECT_GT(failed, 10);
}

TEST_F(Detection, SaysWhatIsWrongWithItsOptions)
{
  options_.max_side = 1;
  EXPECT_EQ(errorOf([&] { detectionExecutor(options_); }), "detection/max_side = 1, must be in [2, 65535]");
  options_.model = "";
  EXPECT_NE(errorOf([&] { detectionExecutor(options_); }).find("detection/model"), std::string::npos);
  options_ = DetectionExecutorOptions();
  options_.model = folder_.path() + "/none.yaml";
  EXPECT_NE(errorOf([&] { detectionExecutor(options_); }).find("none.yaml"), std::string::npos);
}

TEST_F(Detection, AServerDetectsForAVehicle)
{
  EdgeServerOptions server_options;
  server_options.replier.host = "127.0.0.1";
  server_options.admission.workers = 2;
  EdgeServer server(server_options, {detectionExecutor(options_), nullptr});
  SpRequester::Options requester_options;
  requester_options.address = "127.0.0.1:" + std::to_string(server.port());
  Inbox<bool> links;
  Inbox<OffloadReply> replies;
  SpRequester::Callbacks callbacks;
  callbacks.link = [&](bool up, const std::string&) { links.put(up); };
  callbacks.reply = [&](uint32_t, const Bytes& body, int64_t) { replies.put(decodeReply(body.data(), body.size())); };
  SpRequester requester(requester_options, callbacks);
  ASSERT_TRUE(links.take());
  OffloadRequest request = pictureRequest(Encoding::JPEG, 0, 0, jpegOf(cellPicture(CV_8UC3)));
  request.remaining_s = 60.0;
  ASSERT_TRUE(requester.send(1, encode(request)));
  const OffloadReply reply = replies.take();
  EXPECT_EQ(reply.status, OffloadReply::Status::OK) << reply.text;
  ASSERT_EQ(reply.objects.size(), 1U);
  EXPECT_EQ(reply.objects[0].label, "bright");
  request.payload.resize(100);
  ASSERT_TRUE(requester.send(2, encode(request)));
  EXPECT_EQ(replies.take().status, OffloadReply::Status::FAILED);
}

TEST(JpegSize, IsReadFromTheHeader)
{
  for (const cv::Size& size : {cv::Size(64, 48), cv::Size(1, 1), cv::Size(1920, 1080)})
  {
    for (const int progressive : {0, 1})
    {
      Bytes jpeg;
      cv::imencode(".jpg", cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3)), jpeg,
                   {cv::IMWRITE_JPEG_PROGRESSIVE, progressive});
      EXPECT_EQ(jpegSize(jpeg).width, static_cast<uint32_t>(size.width));
      EXPECT_EQ(jpegSize(jpeg).height, static_cast<uint32_t>(size.height));
    }
  }
  const Bytes good = jpegOf(cellPicture(CV_8UC3));
  std::mt19937 random(3);
  for (int round = 0; round < 5000; ++round)
  {
    Bytes bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(random() % good.size()));
    for (unsigned changes = random() % 10; changes > 0 && !bytes.empty(); --changes)
    {
      bytes[random() % bytes.size()] = static_cast<uint8_t>(random());
    }
    bytes.shrink_to_fit();
    errorOf([&] { jpegSize(bytes); });  // the sanitizer sees what it reads
  }
  EXPECT_NE(errorOf([] { jpegSize({0xff, 0xd8, 0xff, 0xda, 0, 2}); }), "");
}

TEST(Commands, AreReadFromTheLinesOfARequest)
{
  const pi_speech::CommandTable table = tableOf(" Go \r\n\nturn left\nstop");
  ASSERT_EQ(table.commands.size(), 3U);
  EXPECT_EQ(table.commands[0].text, "go");
  EXPECT_EQ(table.commands[1].text, "turn left");
  EXPECT_EQ(table.commands[2].text, "stop");
  EXPECT_NE(errorOf([] { commandsOf("", 5); }), "");
  EXPECT_NE(errorOf([] { commandsOf("go\ngo", 5); }), "");
  EXPECT_NE(errorOf([] { commandsOf("go;rm", 5); }), "");
  EXPECT_EQ(errorOf([] { commandsOf("a\nb\nc", 2); }), "more than 2 commands");
}

TEST(Speech, SaysWhatIsWrongWithSound)
{
  SpeechExecutorOptions options = speechOptions();
  options.max_sound_s = 0.0;
  EXPECT_EQ(errorOf([&] { speechExecutor(options); }), "speech/max_sound_s = 0, must be in [0.1, 300]");
  options.max_sound_s = 2.0;
  Executor run = speechExecutor(options)();
  const auto error = [&](const OffloadRequest& request)
  {
    double service_s = -1.0;
    return errorOf([&] { run(request, &service_s); });
  };
  OffloadRequest request = soundRequest(pi_speech::Samples(1600));
  request.encoding = Encoding::JPEG;
  EXPECT_EQ(error(request), "encoding 4 is not one of sound");
  EXPECT_NE(error(soundRequest({})).find("sound of 0 bytes"), std::string::npos);
  EXPECT_NE(error(soundRequest(pi_speech::Samples(16000 * 3))).find("sound of 96000 bytes"), std::string::npos);
  request = soundRequest(pi_speech::Samples(1600));
  request.payload.pop_back();
  EXPECT_NE(error(request).find("sound of 3199 bytes"), std::string::npos);
  EXPECT_NE(error(soundRequest(pi_speech::Samples(1600), "go\ngo")), "");
  // Silence and noise are no commands, and no faults.
  double service_s = -1.0;
  OffloadReply reply = run(soundRequest(pi_speech::Samples(16000)), &service_s);
  EXPECT_FALSE(reply.accepted);
  EXPECT_EQ(reply.text, "");
  EXPECT_GE(service_s, 0.0);
  std::mt19937 random(1);
  pi_speech::Samples noise(16000);
  for (int16_t& sample : noise)
  {
    sample = static_cast<int16_t>(random());
  }
  reply = run(soundRequest(noise), &service_s);
  EXPECT_FALSE(reply.accepted);
}

/// Recordings of the word; empty: PI_EDGE_DATA is not set.
std::vector<std::string> clipsOf(const std::string& word)
{
  std::vector<std::string> clips;
  const char* data = std::getenv("PI_EDGE_DATA");
  if (data == nullptr)
  {
    return clips;
  }
  const std::string folder = std::string(data) + "/speech/";
  std::ifstream list(folder + "commands.tsv");
  for (std::string line; std::getline(list, line);)
  {
    std::istringstream columns(line);
    std::string path;
    std::string said;
    columns >> path >> said;
    if (said == word)
    {
      clips.push_back(folder + path);
    }
  }
  if (clips.empty())
  {
    throw std::runtime_error(folder + "commands.tsv has no recording of " + word);
  }
  return clips;
}

TEST(Speech, RecognisesTheNodesCommandsAndThoseOfARequest)
{
  if (clipsOf("stop").empty())
  {
    GTEST_SKIP() << "needs the recordings: PI_EDGE_DATA is not set";
  }
  SpeechExecutorOptions options = speechOptions();
  options.recognizer.mode = pi_speech::RecognitionMode::CLOSED;
  Executor run = speechExecutor(options)();
  int right = 0;
  int all = 0;
  for (const std::string word : {"stop", "left", "yes"})
  {
    const std::vector<std::string> clips = clipsOf(word);
    for (size_t clip = 0; clip < std::min<size_t>(5, clips.size()); ++clip)
    {
      double service_s = -1.0;
      const OffloadReply reply = run(soundRequest(pi_speech::readAudioFile(clips[clip])), &service_s);
      EXPECT_GT(service_s, 0.0);
      right += reply.text == word ? 1 : 0;
      ++all;
    }
  }
  EXPECT_GE(right, all * 7 / 10);
  // Other commands: what is not among them is never the answer.
  double service_s = -1.0;
  const OffloadReply reply =
      run(soundRequest(pi_speech::readAudioFile(clipsOf("left").front()), "Left\nright"), &service_s);
  EXPECT_TRUE(reply.text.empty() || reply.text == "left" || reply.text == "right") << reply.text;
}

struct Comparison
{
  size_t utterances = 0;
  size_t accepted = 0;
  int length_counts = 0;  ///< utterances for whose confidence the length of the speech makes a difference
};

/// Recognises the same utterances here and by an executor, as a vehicle and a node do.
Comparison compareHereAndThere(const SpeechExecutorOptions& options)
{
  pi_speech::CommandRecognizer vehicle(options.recognizer, options.commands);
  Executor node = speechExecutor(options)();
  // As the vehicle's end-pointer finds them: sound, and length of the speech in it.
  std::vector<pi_speech::Utterance> utterances;
  vehicle.setUtteranceSink([&](const pi_speech::Utterance& utterance, const pi_speech::Recognition&)
                           { utterances.push_back(utterance); });
  const auto ignore = [](const pi_speech::Recognition&) {};
  for (const std::string word : {"stop", "left", "yes"})
  {
    const std::vector<std::string> clips = clipsOf(word);
    for (size_t clip = 0; clip < std::min<size_t>(5, clips.size()); ++clip)
    {
      pi_speech::Samples samples = pi_speech::readAudioFile(clips[clip]);
      samples.insert(samples.begin(), pi_speech::SAMPLE_RATE_HZ / 2, 0);
      samples.insert(samples.end(), pi_speech::SAMPLE_RATE_HZ, 0);
      vehicle.reset();
      vehicle.process(samples.data(), samples.size(), ignore);
      vehicle.flush(ignore);
    }
  }
  Comparison compared;
  compared.utterances = utterances.size();
  for (const pi_speech::Utterance& utterance : utterances)
  {
    OffloadRequest request = soundRequest(utterance.samples);
    request.speech_s = static_cast<double>(utterance.speech_end - utterance.speech_begin) / pi_speech::SAMPLE_RATE_HZ;
    const pi_speech::Recognition here =
        vehicle.recognize(utterance.samples.data(), utterance.samples.size(), request.speech_s);
    const Bytes message = encode(request);
    double service_s = -1.0;
    const OffloadReply there = node(decodeRequest(message.data(), message.size()), &service_s);
    EXPECT_EQ(there.accepted, here.accepted);
    EXPECT_EQ(there.text, here.accepted ? here.text : "");
    EXPECT_EQ(there.confidence, static_cast<float>(here.confidence));
    compared.accepted += there.accepted ? 1 : 0;
    request.speech_s = 0.0;
    compared.length_counts += node(request, &service_s).confidence != there.confidence ? 1 : 0;
  }
  return compared;
}

TEST(Speech, AnUtteranceIsTheSameHereAndThere)
{
  if (clipsOf("stop").empty())
  {
    GTEST_SKIP() << "needs the recordings: PI_EDGE_DATA is not set";
  }
  SpeechExecutorOptions options = speechOptions();
  const Comparison by_network = compareHereAndThere(options);
  ASSERT_GE(by_network.utterances, 10U);
  EXPECT_GE(by_network.accepted, by_network.utterances / 2);
  options.recognizer.word_network.clear();
  for (pi_speech::Command& command : options.commands.commands)
  {
    command.threshold = 0.0;  // those of the table are the network's
  }
  const Comparison by_sphinx = compareHereAndThere(options);
  ASSERT_GE(by_sphinx.utterances, 10U);
  EXPECT_GT(by_sphinx.accepted, 0U);
  EXPECT_GT(by_sphinx.length_counts, 0) << "only PocketSphinx looks at the length of the speech";
}

}  // namespace
