#include "image_codec/image_codec.h"

#include <gtest/gtest.h>
#include <ros/serialization.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <cerrno>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>

#include <opencv2/imgcodecs.hpp>

namespace pi_os_transport
{
namespace
{

using Compression = ImageCodec::Compression;
using Result = ImageCodec::Result;
using Bytes = std::vector<uint8_t>;

constexpr auto ROUND = std::chrono::milliseconds(50);
constexpr auto DEADLINE = std::chrono::seconds(30);  // reached only when something is broken

struct Outcome
{
  bool done = false;
  Result result = Result::FAILED;
  Bytes message;
  std::string detail;
};

template <typename Message>
Bytes serialize(const Message& message)
{
  Bytes data(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(data.data(), static_cast<uint32_t>(data.size()));
  ros::serialization::serialize(stream, message);
  return data;
}

template <typename Message>
Message deserialize(Bytes data)
{
  Message message;
  ros::serialization::IStream stream(data.data(), static_cast<uint32_t>(data.size()));
  ros::serialization::deserialize(stream, message);
  return message;
}

/// Smooth in every channel, and different in each, so that mixed-up channels show and JPEG loses little.
sensor_msgs::Image makeImage(const std::string& encoding, uint32_t channels, uint32_t bytes, uint32_t width = 64,
                             uint32_t height = 48, uint32_t padding = 0)
{
  sensor_msgs::Image image;
  image.header.seq = 4711;
  image.header.stamp = ros::Time(12, 345);
  image.header.frame_id = "camera_optical";
  image.encoding = encoding;
  image.width = width;
  image.height = height;
  image.step = width * channels * bytes + padding;
  image.data.resize(size_t{image.step} * height);
  for (uint32_t y = 0; y < height; ++y)
  {
    for (uint32_t x = 0; x < width; ++x)
    {
      for (uint32_t c = 0; c < channels; ++c)
      {
        const uint32_t value = c == 3 ? 255 : (40 + 50 * c + x + y) % 256;
        for (uint32_t byte = 0; byte < bytes; ++byte)
        {
          image.data[y * image.step + (x * channels + c) * bytes + byte] =
              static_cast<uint8_t>(byte == 0 ? value * 7 : value);
        }
        if (bytes == 1)
        {
          image.data[y * image.step + x * channels + c] = static_cast<uint8_t>(value);
        }
      }
    }
  }
  return image;
}

class ImageCodecTest : public ::testing::Test
{
protected:
  ImageCodecTest() { options_.program = PI_OS_IMAGE_CODEC; }
  ~ImageCodecTest() override
  {
    codec_.reset();
    if (!folder_.empty())
    {
      std::filesystem::remove_all(folder_);
    }
  }

  ImageCodec& codec()
  {
    if (!codec_)
    {
      codec_ = std::make_unique<ImageCodec>(&loop_, options_);
    }
    return *codec_;
  }

  ImageCodec::Callback into(std::shared_ptr<Outcome> outcome, std::shared_ptr<Bytes> owned)
  {
    return [outcome, owned](Result result, Bytes message, const std::string& detail)
    {
      EXPECT_FALSE(outcome->done) << "called twice";
      *outcome = {true, result, std::move(message), detail};
    };
  }

  std::shared_ptr<Outcome> beginEncode(const Bytes& image, Compression compression, int quality)
  {
    const auto outcome = std::make_shared<Outcome>();
    const auto owned = std::make_shared<Bytes>(image);
    return codec().encode(compression, quality, owned->data(), owned->size(), into(outcome, owned)) ? outcome : nullptr;
  }
  std::shared_ptr<Outcome> beginDecode(const Bytes& compressed)
  {
    const auto outcome = std::make_shared<Outcome>();
    const auto owned = std::make_shared<Bytes>(compressed);
    return codec().decode(owned->data(), owned->size(), into(outcome, owned)) ? outcome : nullptr;
  }

  Outcome await(const std::shared_ptr<Outcome>& outcome)
  {
    if (!outcome)
    {
      ADD_FAILURE() << "not queued";
      return {};
    }
    for (const SteadyTime end = SteadyClock::now() + DEADLINE; !outcome->done && SteadyClock::now() < end;)
    {
      loop_.runOnce(ROUND);
    }
    EXPECT_TRUE(outcome->done);
    return *outcome;
  }

  Outcome encode(const sensor_msgs::Image& image, Compression compression, int quality)
  {
    return await(beginEncode(serialize(image), compression, quality));
  }
  Outcome decode(const sensor_msgs::CompressedImage& compressed) { return await(beginDecode(serialize(compressed))); }

  void expectWorks()
  {
    const Outcome outcome = encode(makeImage("mono8", 1, 1), Compression::PNG, 3);
    EXPECT_EQ(Result::CONVERTED, outcome.result) << outcome.detail;
  }

  /// A worker of another kind.
  void useScript(const std::string& script)
  {
    char folder[] = "/tmp/pi_os_test_XXXXXX";
    ASSERT_NE(nullptr, mkdtemp(folder));
    folder_ = folder;
    options_.program = folder_ + "/worker";
    std::ofstream(options_.program) << "#!/bin/sh\n" + script + "\n";
    ASSERT_EQ(0, chmod(options_.program.c_str(), 0700));
  }

  EventLoop loop_;
  ImageCodec::Options options_;
  std::unique_ptr<ImageCodec> codec_;
  std::string folder_;
};

sensor_msgs::CompressedImage compressedImage(const std::string& format, const Bytes& data)
{
  sensor_msgs::CompressedImage message;
  message.format = format;
  message.data = data;
  return message;
}

struct Carried
{
  const char* encoding;
  uint32_t channels;
  uint32_t bytes;
  const char* as;
};

TEST_F(ImageCodecTest, PngRestoresEveryPixelAndTheHeader)
{
  for (const Carried& carried :
       {Carried{"mono8", 1, 1, "mono8"}, Carried{"8UC1", 1, 1, "mono8"}, Carried{"bgr8", 3, 1, "bgr8"},
        Carried{"rgb8", 3, 1, "bgr8"}, Carried{"8UC3", 3, 1, "bgr8"}, Carried{"mono16", 1, 2, "mono16"},
        Carried{"16UC1", 1, 2, "mono16"}, Carried{"bgr16", 3, 2, "bgr16"}, Carried{"rgb16", 3, 2, "bgr16"},
        Carried{"16UC3", 3, 2, "bgr16"}})
  {
    SCOPED_TRACE(carried.encoding);
    const sensor_msgs::Image image = makeImage(carried.encoding, carried.channels, carried.bytes);
    const Outcome encoded = encode(image, Compression::PNG, 3);
    ASSERT_EQ(Result::CONVERTED, encoded.result) << encoded.detail;
    const auto compressed = deserialize<sensor_msgs::CompressedImage>(encoded.message);
    EXPECT_EQ(carried.encoding + std::string("; png compressed ") + carried.as, compressed.format);
    EXPECT_EQ(image.header, compressed.header);
    EXPECT_LT(compressed.data.size(), image.data.size());
    const Outcome decoded = await(beginDecode(encoded.message));
    ASSERT_EQ(Result::CONVERTED, decoded.result) << decoded.detail;
    EXPECT_EQ(image, deserialize<sensor_msgs::Image>(decoded.message));
  }
}

TEST_F(ImageCodecTest, JpegRestoresSizeEncodingHeaderAndNearlyThePixels)
{
  for (const Carried& carried :
       {Carried{"mono8", 1, 1, "mono8"}, Carried{"8UC1", 1, 1, "mono8"}, Carried{"bgr8", 3, 1, "bgr8"},
        Carried{"rgb8", 3, 1, "bgr8"}, Carried{"8UC3", 3, 1, "bgr8"}, Carried{"bgra8", 4, 1, "bgr8"},
        Carried{"rgba8", 4, 1, "bgr8"}})
  {
    SCOPED_TRACE(carried.encoding);
    const sensor_msgs::Image image = makeImage(carried.encoding, carried.channels, 1);
    const Outcome encoded = encode(image, Compression::JPEG, 90);
    ASSERT_EQ(Result::CONVERTED, encoded.result) << encoded.detail;
    EXPECT_EQ(carried.encoding + std::string("; jpeg compressed ") + carried.as,
              deserialize<sensor_msgs::CompressedImage>(encoded.message).format);
    const Outcome decoded = await(beginDecode(encoded.message));
    ASSERT_EQ(Result::CONVERTED, decoded.result) << decoded.detail;
    auto restored = deserialize<sensor_msgs::Image>(decoded.message);
    ASSERT_EQ(image.data.size(), restored.data.size());
    double difference = 0.0;
    for (size_t index = 0; index < image.data.size(); ++index)
    {
      difference += std::abs(image.data[index] - restored.data[index]);
    }
    EXPECT_LT(difference / static_cast<double>(image.data.size()), 3.0);  // channels in wrong order: about 50
    restored.data = image.data;
    EXPECT_EQ(image, restored);
  }
}

TEST_F(ImageCodecTest, CompressedDataIsBgrAsThePluginHasIt)
{
  const sensor_msgs::Image image = makeImage("rgb8", 3, 1);
  const Outcome encoded = encode(image, Compression::PNG, 1);
  ASSERT_EQ(Result::CONVERTED, encoded.result);
  const cv::Mat pixels =
      cv::imdecode(deserialize<sensor_msgs::CompressedImage>(encoded.message).data, cv::IMREAD_UNCHANGED);
  ASSERT_EQ(CV_8UC3, pixels.type());
  EXPECT_EQ(image.data[0], pixels.at<cv::Vec3b>(0, 0)[2]);
  EXPECT_EQ(image.data[2], pixels.at<cv::Vec3b>(0, 0)[0]);
}

TEST_F(ImageCodecTest, QualityChangesTheSize)
{
  const sensor_msgs::Image image = makeImage("bgr8", 3, 1, 320, 240);
  EXPECT_LT(encode(image, Compression::JPEG, 10).message.size(), encode(image, Compression::JPEG, 95).message.size());
}

TEST_F(ImageCodecTest, PaddedRowsComeBackWithoutPadding)
{
  const Outcome encoded = encode(makeImage("bgr8", 3, 1, 31, 17, 3), Compression::PNG, 3);
  ASSERT_EQ(Result::CONVERTED, encoded.result) << encoded.detail;
  const Outcome decoded = await(beginDecode(encoded.message));
  EXPECT_EQ(makeImage("bgr8", 3, 1, 31, 17), deserialize<sensor_msgs::Image>(decoded.message));
}

TEST_F(ImageCodecTest, SaysWhichImagesItCannotCarry)
{
  for (const Carried& carried :
       {Carried{"bayer_rggb8", 1, 1, ""}, Carried{"32FC1", 1, 4, ""}, Carried{"yuv422", 2, 1, ""},
        Carried{"8SC1", 1, 1, ""}, Carried{"16SC1", 1, 2, ""}, Carried{"64FC3", 3, 8, ""}, Carried{"rgba16", 4, 2, ""},
        Carried{"", 1, 1, ""}, Carried{"nonsense", 1, 1, ""}})
  {
    const sensor_msgs::Image image = makeImage(carried.encoding, carried.channels, carried.bytes);
    for (const Compression compression : {Compression::JPEG, Compression::PNG})
    {
      const Outcome outcome = encode(image, compression, 5);
      EXPECT_EQ(Result::UNSUPPORTED, outcome.result) << carried.encoding;
      EXPECT_NE(std::string::npos, outcome.detail.find("\"" + image.encoding + "\"")) << outcome.detail;
      EXPECT_TRUE(outcome.message.empty());
    }
  }
  EXPECT_EQ(Result::UNSUPPORTED, encode(makeImage("mono16", 1, 2), Compression::JPEG, 80).result);
  EXPECT_EQ(Result::UNSUPPORTED, encode(makeImage("rgba8", 4, 1), Compression::PNG, 3).result);
  EXPECT_EQ(Result::UNSUPPORTED, encode(makeImage("mono8", 1, 1, 70000, 1), Compression::JPEG, 80).result);
  sensor_msgs::Image swapped = makeImage("mono16", 1, 2);
  swapped.is_bigendian = 1;
  EXPECT_EQ(Result::UNSUPPORTED, encode(swapped, Compression::PNG, 3).result);
}

TEST_F(ImageCodecTest, InconsistentImagesAreNotRead)
{
  sensor_msgs::Image image = makeImage("mono8", 1, 1);
  const auto refused = [&](const char* what)
  { EXPECT_EQ(Result::UNSUPPORTED, encode(image, Compression::PNG, 3).result) << what; };
  image.data.pop_back();
  refused("data too short");
  image = makeImage("mono8", 1, 1);
  image.step = 1;
  refused("step too short");
  image = makeImage("mono8", 1, 1);
  image.height = 0xffffffff;
  refused("height beyond the data");
  image = makeImage("mono8", 1, 1);
  image.width = image.step = 0xffffffff;
  refused("width beyond the data");
  image = sensor_msgs::Image();
  image.encoding = "mono8";
  refused("no pixels");
  Bytes cut = serialize(makeImage("mono8", 1, 1));
  cut.resize(cut.size() / 2);
  EXPECT_EQ(Result::BAD_DATA, await(beginEncode(cut, Compression::PNG, 3)).result);
  EXPECT_EQ(Result::BAD_DATA, await(beginEncode({}, Compression::PNG, 3)).result);
  expectWorks();
}

TEST_F(ImageCodecTest, DamagedDataIsBadDataAndHurtsNobody)
{
  std::mt19937 random(7);
  options_.queue_limit = 400;
  options_.pause = std::chrono::milliseconds(1);
  std::map<Result, int> results;
  for (const Compression compression : {Compression::JPEG, Compression::PNG})
  {
    const Bytes good = encode(makeImage("rgb8", 3, 1), compression, 9).message;
    ASSERT_FALSE(good.empty());
    std::vector<std::shared_ptr<Outcome>> outcomes;
    for (int round = 0; round < 150; ++round)
    {
      Bytes bad = good;
      for (uint32_t flips = 1 + random() % 8; flips > 0; --flips)
      {
        bad[random() % bad.size()] ^= static_cast<uint8_t>(1U << random() % 8);
      }
      outcomes.push_back(beginDecode(bad));
      bad = good;
      bad.resize(random() % bad.size());
      outcomes.push_back(beginDecode(bad));
    }
    for (const std::shared_ptr<Outcome>& outcome : outcomes)
    {
      ++results[await(outcome).result];
    }
  }
  EXPECT_GT(results[Result::BAD_DATA], 300);  // every truncation
  EXPECT_EQ(0, results[Result::UNSUPPORTED]);
  expectWorks();
}

TEST_F(ImageCodecTest, DecompressionBombsAreRefusedBeforeTheyGrow)
{
  options_.max_bytes = 1 << 20;
  Bytes png;
  cv::imencode(".png", cv::Mat::zeros(4000, 4000, CV_8UC1), png);
  ASSERT_LT(png.size(), 100000U);
  const Outcome large = decode(compressedImage("mono8; png compressed mono8", png));
  EXPECT_EQ(Result::BAD_DATA, large.result);
  EXPECT_NE(std::string::npos, large.detail.find("4000 x 4000")) << large.detail;

  Bytes jpeg;
  cv::imencode(".jpg", cv::Mat::zeros(64, 64, CV_8UC1), jpeg);
  for (size_t at = 2; at + 9 < jpeg.size(); ++at)
  {
    if (jpeg[at] == 0xff && jpeg[at + 1] == 0xc0)
    {
      std::fill_n(jpeg.begin() + static_cast<std::ptrdiff_t>(at) + 5, 4, uint8_t{0xfe});
      break;
    }
  }
  const Outcome announced = decode(compressedImage("mono8; jpeg compressed mono8", jpeg));
  EXPECT_EQ(Result::BAD_DATA, announced.result);
  EXPECT_NE(std::string::npos, announced.detail.find("65278 x 65278")) << announced.detail;
  // The pixels alone would fit; the message does not.
  cv::imencode(".png", cv::Mat::zeros(1024, 1024, CV_8UC1), png);
  EXPECT_EQ(Result::BAD_DATA, decode(compressedImage("mono8; png compressed mono8", png)).result);
  expectWorks();
}

TEST_F(ImageCodecTest, OnlyWhatTheFormatAnnouncesIsDecoded)
{
  Bytes png;
  cv::imencode(".png", cv::Mat::zeros(8, 8, CV_8UC1), png);
  EXPECT_EQ(Result::CONVERTED, decode(compressedImage("mono8; png compressed mono8", png)).result);
  for (const char* format :
       {"bgr8; png compressed bgr8", "mono16; png compressed mono16", "png", "", "; png", "32FC1; png compressed "})
  {
    EXPECT_EQ(Result::BAD_DATA, decode(compressedImage(format, png)).result) << format;
  }
  // Other formats that OpenCV would decode.
  for (const char* extension : {".bmp", ".tiff", ".webp", ".ppm"})
  {
    Bytes other;
    ASSERT_TRUE(cv::imencode(extension, cv::Mat::zeros(8, 8, CV_8UC3), other));
    EXPECT_EQ(Result::BAD_DATA, decode(compressedImage("bgr8; png compressed bgr8", other)).result) << extension;
  }
}

TEST_F(ImageCodecTest, WorkerThatIsKilledIsReplaced)
{
  expectWorks();
  const pid_t first = codec().worker();
  ASSERT_GT(first, 0);
  const auto struck = beginEncode(serialize(makeImage("bgr8", 3, 1)), Compression::PNG, 9);
  const auto behind = beginEncode(serialize(makeImage("bgr8", 3, 1)), Compression::PNG, 9);
  kill(first, SIGSTOP);  // so that the request is under way for sure
  loop_.runOnce(ROUND);
  kill(first, SIGKILL);
  const Outcome outcome = await(struck);
  EXPECT_EQ(Result::FAILED, outcome.result);
  EXPECT_NE(std::string::npos, outcome.detail.find("has ended")) << outcome.detail;
  EXPECT_EQ(Result::CONVERTED, await(behind).result);
  EXPECT_NE(first, codec().worker());
}

TEST_F(ImageCodecTest, WorkerThatDiesWhileIdleIsReplacedUnnoticed)
{
  expectWorks();
  const pid_t first = codec().worker();
  kill(first, SIGKILL);
  for (const SteadyTime end = SteadyClock::now() + DEADLINE; codec().worker() >= 0 && SteadyClock::now() < end;)
  {
    loop_.runOnce(ROUND);
  }
  EXPECT_EQ(-1, codec().worker());
  expectWorks();
}

TEST_F(ImageCodecTest, WorkerThatHangsIsKilledAndReplaced)
{
  options_.timeout = std::chrono::milliseconds(2000);  // a worker has to start in that time, on a busy computer too
  expectWorks();
  const pid_t first = codec().worker();
  kill(first, SIGSTOP);
  const SteadyTime begin = SteadyClock::now();
  const Outcome outcome = encode(makeImage("bgr8", 3, 1), Compression::PNG, 3);
  EXPECT_EQ(Result::FAILED, outcome.result);
  EXPECT_EQ("the image codec was not done within 2000 ms", outcome.detail);
  EXPECT_GE(SteadyClock::now() - begin, options_.timeout);
  EXPECT_EQ(-1, kill(first, 0));
  EXPECT_EQ(ESRCH, errno);
  expectWorks();
}

TEST_F(ImageCodecTest, HangingWorkerThatReadsNothingOfALargeRequestIsKilled)
{
  useScript("exec sleep 1000");
  options_.timeout = std::chrono::milliseconds(200);
  const Outcome outcome = encode(makeImage("bgr8", 3, 1, 2000, 1000), Compression::PNG, 3);
  EXPECT_EQ(Result::FAILED, outcome.result);
  EXPECT_EQ("the image codec was not done within 200 ms", outcome.detail);
}

TEST_F(ImageCodecTest, WorkerThatAlwaysDiesFailsEachRequestOnce)
{
  useScript("exit 3");
  options_.pause = std::chrono::milliseconds(1);
  std::vector<std::shared_ptr<Outcome>> outcomes;
  for (int round = 0; round < 5; ++round)
  {
    outcomes.push_back(beginEncode(serialize(makeImage("mono8", 1, 1)), Compression::PNG, 3));
  }
  for (const std::shared_ptr<Outcome>& outcome : outcomes)
  {
    EXPECT_EQ(Result::FAILED, await(outcome).result);
  }
  EXPECT_EQ(0U, codec().pending());
}

TEST_F(ImageCodecTest, WorkerThatTalksNonsenseIsReplaced)
{
  options_.pause = std::chrono::milliseconds(1);
  const std::string zeros = "\\000\\000\\000\\000";
  const std::string kind = "\\020\\000\\000\\000";  // CONVERTED
  const std::string first = "\\001\\000\\000\\000" + zeros;
  const sensor_msgs::Image image = makeImage("mono8", 1, 1);
  const std::string read_all =
      "head -c " + std::to_string(CodecHeader::BYTES + serialize(image).size()) + " <&3 >/dev/null; ";
  for (const std::string& answer : {
           std::string("printf 'garbage garbage garbage garbage' >&3; exec sleep 1000"),
           read_all + "printf '" + zeros + zeros + first + zeros + zeros + "' >&3; exec sleep 1000",  // unknown kind
           read_all + "printf '" + kind + zeros + zeros + zeros + zeros + zeros +
               "' >&3; exec sleep 1000",  // another id
           read_all + "printf '" + kind + zeros + first +
               "\\377\\377\\377\\377\\377\\377\\377\\377' >&3; exec sleep 1000",
       })
  {
    codec_.reset();
    useScript(answer);
    const Outcome outcome = encode(image, Compression::PNG, 3);
    EXPECT_EQ(Result::FAILED, outcome.result);
    EXPECT_EQ("the image codec gave an answer that makes no sense", outcome.detail) << answer;
    std::filesystem::remove_all(folder_);
  }
}

TEST_F(ImageCodecTest, MissingWorkerIsNamed)
{
  options_.program = "/nowhere/pi_os_image_codec";
  const Outcome outcome = encode(makeImage("mono8", 1, 1), Compression::PNG, 3);
  EXPECT_EQ(Result::FAILED, outcome.result);
  EXPECT_EQ("cannot start the image codec /nowhere/pi_os_image_codec: No such file or directory", outcome.detail);
}

TEST_F(ImageCodecTest, QueueAndSizeAreBounded)
{
  options_.queue_limit = 2;
  options_.max_bytes = 10000;
  const Bytes image = serialize(makeImage("mono8", 1, 1));
  const auto first = beginEncode(image, Compression::PNG, 3);
  const auto second = beginEncode(image, Compression::PNG, 3);
  EXPECT_EQ(nullptr, beginEncode(image, Compression::PNG, 3));
  EXPECT_EQ(Result::CONVERTED, await(first).result);
  EXPECT_EQ(Result::CONVERTED, await(second).result);
  EXPECT_EQ(nullptr, beginDecode(Bytes(10001)));
  EXPECT_NE(nullptr, beginDecode(Bytes(10000)));
}

TEST_F(ImageCodecTest, CallbackMayAskAgain)
{
  const auto image = std::make_shared<Bytes>(serialize(makeImage("mono8", 1, 1)));
  const auto last = std::make_shared<Outcome>();
  options_.queue_limit = 1;
  ASSERT_TRUE(codec().encode(Compression::PNG, 3, image->data(), image->size(),
                             [&](Result, Bytes message, const std::string&)
                             {
                               const auto owned = std::make_shared<Bytes>(std::move(message));
                               EXPECT_TRUE(codec().decode(owned->data(), owned->size(), into(last, owned)));
                             }));
  EXPECT_EQ(*image, await(last).message);
}

TEST_F(ImageCodecTest, EndsItsWorkerAndDropsWhatIsDue)
{
  expectWorks();
  const pid_t worker = codec().worker();
  const auto dropped = beginEncode(serialize(makeImage("mono8", 1, 1)), Compression::PNG, 3);
  codec_.reset();
  EXPECT_EQ(-1, kill(worker, 0));
  EXPECT_EQ(ESRCH, errno);
  loop_.runOnce(ROUND);
  EXPECT_FALSE(dropped->done);
}

}  // namespace
}  // namespace pi_os_transport
