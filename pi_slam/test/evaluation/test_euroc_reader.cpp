#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include "evaluation/sequence_reader.h"

#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <vector>

#include "evaluation/read_all.h"

namespace
{

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;
namespace fs = std::filesystem;

constexpr int PAIRS = 6;

int64_t frameStamp(int frame)
{
  return START_NS + frame * FRAME_NS;
}

std::string cameraYaml(double y)
{
  return "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0, 0, 1, 0, -1, 0, 0, " +
         std::to_string(y) +
         ", 0, -1, 0, 0, 0, 0, 0, 1]\nrate_hz: 20\nresolution: [64, 48]\ncamera_model: pinhole\n"
         "intrinsics: [50, 50, 32, 24]\ndistortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n";
}

const char* const IMU_YAML =
    "sensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "rate_hz: 200\ngyroscope_noise_density: 1.5e-4\ngyroscope_random_walk: 1.0e-5\n"
    "accelerometer_noise_density: 2.5e-3\naccelerometer_random_walk: 3.5e-3\n";

/// A recording of six pairs of 64x48 px; each picture is plain, 10 + its number, the right one 100 more.
class Recording
{
public:
  Recording()
  {
    for (const char* name : {"mav0/cam0/data", "mav0/cam1/data", "mav0/imu0"})
    {
      fs::create_directories(folder_.path() + "/" + name);
    }
    for (int camera = 0; camera < 2; ++camera)
    {
      std::string csv = "#timestamp [ns],filename\r\n";
      for (int frame = 0; frame < PAIRS; ++frame)
      {
        const std::string stamp = std::to_string(frameStamp(frame));
        csv += stamp + "," + stamp + ".png\r\n";
        cv::imwrite(picture(camera, frame).string(), cv::Mat(48, 64, CV_8UC1, cv::Scalar(10 + frame + 100 * camera)));
      }
      const std::string name = "mav0/cam" + std::to_string(camera);
      write(name + "/data.csv", csv);
      write(name + "/sensor.yaml", cameraYaml(camera == 0 ? 0.05 : -0.05));
    }
    write("mav0/imu0/sensor.yaml", IMU_YAML);
    std::string csv = "#timestamp [ns],w_RS_S_x,w_RS_S_y,w_RS_S_z,a_RS_S_x,a_RS_S_y,a_RS_S_z\n";
    for (int i = -20; i <= 60; ++i)
    {
      csv += imuLine(START_NS + i * IMU_NS, i);
    }
    write("mav0/imu0/data.csv", csv);
  }

  static std::string imuLine(int64_t stamp_ns, int number)
  {
    return std::to_string(stamp_ns) + ",0.1,0.2,0.3,0.4,0.5," + std::to_string(number) + ".25\n";
  }

  void write(const std::string& name, const std::string& text) const { folder_.file(name, text); }
  void remove(const std::string& name) const { fs::remove_all(folder_.path() + "/" + name); }
  fs::path picture(int camera, int frame) const
  {
    return fs::path(folder_.path()) / "mav0" / ("cam" + std::to_string(camera)) / "data" /
           (std::to_string(frameStamp(frame)) + ".png");
  }
  std::string path() const { return folder_.path(); }

  /// Both cameras list the same frames, in this order.
  void list(int camera, const std::vector<int64_t>& stamps_ns) const
  {
    std::string csv = "#timestamp [ns],filename\n";
    for (const int64_t stamp_ns : stamps_ns)
    {
      csv += std::to_string(stamp_ns) + "," +
             picture(camera, static_cast<int>((stamp_ns - START_NS) / FRAME_NS)).filename().string() + "\n";
    }
    write("mav0/cam" + std::to_string(camera) + "/data.csv", csv);
  }

private:
  TemporaryFolder folder_;
};

int greyOf(const cv::Mat& picture)
{
  return picture.empty() ? -1 : picture.at<uint8_t>(20, 20);
}

std::string openError(const Recording& recording, const SequenceReaderOptions& options = {})
{
  return messageOf<std::exception>([&] { openEuroc(recording.path(), options); });
}

TEST(EurocReader, HandsOutSamplesAndPairsInOrderOfTime)
{
  const Recording recording;
  const auto source = openEuroc(recording.path());
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), static_cast<size_t>(PAIRS));
  EXPECT_EQ(content.samples.size(), 81u);
  EXPECT_TRUE(std::is_sorted(content.order_ns.begin(), content.order_ns.end()));
  for (int frame = 0; frame < PAIRS; ++frame)
  {
    const StereoPair& pair = content.pairs[static_cast<size_t>(frame)];
    EXPECT_EQ(pair.stamp_ns, frameStamp(frame));
    EXPECT_EQ(greyOf(pair.left), 10 + frame);
    EXPECT_EQ(greyOf(pair.right), 110 + frame);
    EXPECT_EQ(pair.left.type(), CV_8UC1);
  }
  EXPECT_TRUE(content.samples[0].w.isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
  EXPECT_DOUBLE_EQ(content.samples[25].f.z(), 5.25);
  EXPECT_FALSE(source->defects().any());
  EXPECT_FALSE(source->next());
}

TEST(EurocReader, HandsOutTheSampleOfAPairsStampFirst)
{
  const Recording recording;
  const auto source = openEuroc(recording.path());
  bool sample_seen = false;
  while (std::optional<SequenceItem> item = source->next())
  {
    const ImuSample* sample = std::get_if<ImuSample>(&*item);
    sample_seen = sample_seen || (sample != nullptr && sample->stamp_ns == START_NS);
    if (sample == nullptr)
    {
      break;
    }
  }
  EXPECT_TRUE(sample_seen);
}

TEST(EurocReader, DescribesTheRecording)
{
  const Recording recording;
  recording.write("groundtruth_tum.txt", "");
  const auto source = openEuroc(recording.path() + "/mav0");
  const SequenceDescription& description = source->description();
  EXPECT_EQ(description.name, fs::path(recording.path()).filename().string());
  EXPECT_EQ(description.pairs, static_cast<size_t>(PAIRS));
  EXPECT_EQ(description.first_ns, START_NS);
  ASSERT_TRUE(description.calibration);
  EXPECT_EQ(description.calibration->left.model.width, 64);
  EXPECT_NEAR(description.calibration->right.T_body_camera.translation().y(), -0.05, 1e-9);
  ASSERT_TRUE(description.imu);
  EXPECT_DOUBLE_EQ(description.imu->gyro_noise_density, 1.5e-4);
  EXPECT_TRUE(fs::equivalent(description.ground_truth, recording.path() + "/groundtruth_tum.txt"));
}

TEST(EurocReader, FindsTheGroundTruthOfTheOriginalLayout)
{
  const Recording recording;
  EXPECT_EQ(openEuroc(recording.path())->description().ground_truth, "");
  fs::create_directories(recording.path() + "/mav0/state_groundtruth_estimate0");
  recording.write("mav0/state_groundtruth_estimate0/data.csv", "");
  EXPECT_NE(openEuroc(recording.path())->description().ground_truth.find("estimate0/data.csv"), std::string::npos);
}

TEST(EurocReader, DoesWithoutCalibration)
{
  const Recording recording;
  recording.remove("mav0/cam1/sensor.yaml");
  recording.remove("mav0/imu0/sensor.yaml");
  const auto source = openEuroc(recording.path());
  EXPECT_FALSE(source->description().calibration);
  EXPECT_FALSE(source->description().imu);
}

TEST(EurocReader, NamesAFileThatIsMissing)
{
  EXPECT_NE(messageOf<RecordingError>([] { openEuroc("/nowhere/at/all"); }).find("/nowhere/at/all: is no folder"),
            std::string::npos);
  for (const char* name : {"mav0/cam0/data.csv", "mav0/cam1/data.csv", "mav0/imu0/data.csv"})
  {
    const Recording recording;
    recording.remove(name);
    EXPECT_NE(openError(recording).find(std::string(name) + ": missing"), std::string::npos) << openError(recording);
  }
}

TEST(EurocReader, NamesALineThatCannotBeRead)
{
  const Recording recording;
  recording.write("mav0/cam1/data.csv", "#timestamp\n\nyesterday,a.png\n");
  EXPECT_NE(openError(recording).find("cam1/data.csv:3: \"yesterday\" is no time stamp"), std::string::npos);
  recording.write("mav0/cam1/data.csv", "-5,a.png\n");
  EXPECT_NE(openError(recording).find("is no time stamp"), std::string::npos);
  recording.list(1, {frameStamp(0)});
  for (const char* line : {"1400000000000000000,1,2,3,4,5\n", "1400000000000000000,1,2,x,4,5,6\n",
                           "1400000000000000000\n", "1400000000000000000,1,2,3,4,5,6abc\n"})
  {
    recording.write("mav0/imu0/data.csv", line);
    EXPECT_NE(openError(recording).find("imu0/data.csv:1: column"), std::string::npos) << line << openError(recording);
  }
}

TEST(EurocReader, RefusesARecordingWithoutContent)
{
  const Recording recording;
  recording.write("mav0/imu0/data.csv", "#nothing\n");
  EXPECT_NE(openError(recording).find("imu0/data.csv has no sample"), std::string::npos);
  recording.write("mav0/cam1/data.csv", "");
  EXPECT_NE(openError(recording).find("cam1/data.csv lists no picture"), std::string::npos);
}

TEST(EurocReader, RefusesAnImuOfAnotherTime)
{
  const Recording recording;
  recording.write("mav0/imu0/data.csv", Recording::imuLine(START_NS - 9 * FRAME_NS, 0));
  EXPECT_NE(openError(recording).find("do not overlap"), std::string::npos);
}

TEST(EurocReader, RefusesAnImuThatIsNotTheBody)
{
  const Recording recording;
  std::string yaml = IMU_YAML;
  yaml.replace(yaml.find("[1, 0, 0, 0"), 11, "[1, 0, 0, 1");
  recording.write("mav0/imu0/sensor.yaml", yaml);
  EXPECT_NE(openError(recording).find("T_BS is not the identity"), std::string::npos);
}

TEST(EurocReader, PutsUnsortedLinesInOrderAndCountsThem)
{
  const Recording recording;
  recording.list(
      0, {frameStamp(0), frameStamp(2), frameStamp(1), frameStamp(3), frameStamp(3), frameStamp(4), frameStamp(5)});
  const auto source = openEuroc(recording.path());
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), static_cast<size_t>(PAIRS));
  EXPECT_EQ(greyOf(content.pairs[1].left), 11);
  EXPECT_EQ(source->defects().unsorted, 1u);
  EXPECT_EQ(source->defects().repeated, 1u);
}

TEST(EurocReader, HandsOutAPairWithOnePictureMissing)
{
  const Recording recording;
  fs::remove(recording.picture(1, 2));                                                             // the file
  recording.list(0, {frameStamp(0), frameStamp(1), frameStamp(2), frameStamp(3), frameStamp(5)});  // the line of 4
  const auto source = openEuroc(recording.path());
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), static_cast<size_t>(PAIRS));
  EXPECT_EQ(greyOf(content.pairs[2].left), 12);
  EXPECT_TRUE(content.pairs[2].right.empty());
  EXPECT_TRUE(content.pairs[4].left.empty());
  EXPECT_EQ(content.pairs[4].stamp_ns, frameStamp(4));
  EXPECT_EQ(greyOf(content.pairs[4].right), 114);
  EXPECT_EQ(greyOf(content.pairs[5].left), 15);
  EXPECT_EQ(source->defects().single, 2u);
  EXPECT_EQ(source->defects().unreadable, 1u);
  EXPECT_EQ(source->defects().first, recording.picture(1, 2).string() + ": missing");
}

TEST(EurocReader, SkipsAPairWithoutAnyPicture)
{
  const Recording recording;
  fs::remove(recording.picture(0, 3));
  fs::remove(recording.picture(1, 3));
  const auto source = openEuroc(recording.path());
  EXPECT_EQ(readAll(source.get()).pairs.size(), static_cast<size_t>(PAIRS - 1));
  EXPECT_EQ(source->defects().dropped, 1u);
  EXPECT_EQ(source->defects().unreadable, 2u);
}

TEST(EurocReader, TakesADamagedPictureForAMissingOne)
{
  const Recording recording;
  std::ofstream(recording.picture(0, 1), std::ios::trunc) << "this is no picture";
  cv::Mat noise(48, 64, CV_8UC1);
  cv::randu(noise, 0, 255);
  cv::imwrite(recording.picture(0, 4).string(), noise);
  fs::resize_file(recording.picture(0, 4), fs::file_size(recording.picture(0, 4)) / 2);
  const auto source = openEuroc(recording.path());
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), static_cast<size_t>(PAIRS));
  EXPECT_TRUE(content.pairs[1].left.empty());
  EXPECT_TRUE(content.pairs[4].left.empty());
  EXPECT_EQ(source->defects().unreadable, 2u);
  EXPECT_EQ(source->defects().single, 2u);
  EXPECT_NE(source->defects().first.find(": is damaged"), std::string::npos);
}

TEST(EurocReader, JoinsPicturesWhoseStampsNearlyAgree)
{
  const Recording recording;
  std::vector<int64_t> later;
  for (int frame = 0; frame < PAIRS; ++frame)
  {
    later.push_back(frameStamp(frame) + 1500000);
  }
  recording.list(1, later);
  const Content content = readAll(openEuroc(recording.path()).get());
  ASSERT_EQ(content.pairs.size(), static_cast<size_t>(PAIRS));
  EXPECT_EQ(content.pairs[3].stamp_ns, frameStamp(3));
  EXPECT_EQ(greyOf(content.pairs[3].right), 113);

  SequenceReaderOptions strict;
  strict.pair_tolerance_s = 0.001;
  EXPECT_NE(openError(recording, strict).find("no picture of cam0 is within 0.001"), std::string::npos);
}

TEST(EurocReader, ReadsColourAsGrey)
{
  const Recording recording;
  cv::imwrite(recording.picture(0, 0).string(), cv::Mat(48, 64, CV_8UC3, cv::Scalar(80, 80, 80)));
  const Content content = readAll(openEuroc(recording.path()).get());
  EXPECT_EQ(content.pairs[0].left.type(), CV_8UC1);
  EXPECT_EQ(greyOf(content.pairs[0].left), 80);
}

TEST(EurocReader, CutsThePartThatIsAskedFor)
{
  const Recording recording;
  SequenceReaderOptions options;
  options.start_s = 0.1;
  options.duration_s = 0.1;
  const auto source = openEuroc(recording.path(), options);
  const Content content = readAll(source.get());
  ASSERT_EQ(content.pairs.size(), 3u);
  EXPECT_EQ(source->description().pairs, 3u);
  EXPECT_EQ(source->description().first_ns, frameStamp(2));
  EXPECT_EQ(content.pairs.front().stamp_ns, frameStamp(2));
  EXPECT_EQ(content.samples.front().stamp_ns, START_NS - 20 * IMU_NS);  // within the margin
  options.start_s = 3.0;
  EXPECT_NE(openError(recording, options).find("has no picture from 3.0"), std::string::npos);
}

TEST(EurocReader, LeavesOutSamplesFarFromTheFirstPair)
{
  const Recording recording;
  std::string csv;
  for (int i = -400; i <= 400; ++i)  // 2 s before and after
  {
    csv += Recording::imuLine(START_NS + i * IMU_NS, i);
  }
  recording.write("mav0/imu0/data.csv", csv);
  const Content content = readAll(openEuroc(recording.path()).get());
  EXPECT_EQ(content.samples.front().stamp_ns, START_NS - 1000000000);
  EXPECT_EQ(content.samples.back().stamp_ns, frameStamp(PAIRS - 1) + 1000000000);
}

TEST(EurocReader, RefusesOptionsOutOfRange)
{
  const Recording recording;
  for (const auto& [options, field] : {std::pair(SequenceReaderOptions{-1.0, 0.0, 0.002, 8}, "start_s"),
                                       std::pair(SequenceReaderOptions{0.0, std::nan(""), 0.002, 8}, "duration_s"),
                                       std::pair(SequenceReaderOptions{0.0, 0.0, 1.0, 8}, "pair_tolerance_s"),
                                       std::pair(SequenceReaderOptions{0.0, 0.0, 0.002, 0}, "read_ahead")})
  {
    EXPECT_NE(openError(recording, options).find(field), std::string::npos);
  }
}

TEST(SequenceReader, HandsOutTheSameAsItsSource)
{
  const Recording recording;
  const Content direct = readAll(openEuroc(recording.path()).get());
  for (const int read_ahead : {1, 3, 100})
  {
    SequenceReader reader(openEuroc(recording.path()), read_ahead);
    const Content ahead = readAll(&reader);
    EXPECT_EQ(ahead.order_ns, direct.order_ns);
    ASSERT_EQ(ahead.pairs.size(), direct.pairs.size());
    EXPECT_EQ(greyOf(ahead.pairs[4].right), 114);
    EXPECT_FALSE(reader.next());
    EXPECT_GT(reader.cpuSeconds(), 0.0);
  }
}

TEST(SequenceReader, EndsWithoutBeingReadToTheEnd)
{
  const Recording recording;
  SequenceReader reader(openEuroc(recording.path()), 1);
  EXPECT_TRUE(reader.next());
}

TEST(SequenceReader, PassesOnDefects)
{
  const Recording recording;
  fs::remove(recording.picture(1, 2));
  SequenceReader reader(openEuroc(recording.path()));
  readAll(&reader);
  EXPECT_EQ(reader.defects().single, 1u);
}

/// Two samples, then an error.
class FailingSource : public SequenceSource
{
public:
  std::optional<SequenceItem> next() override
  {
    if (++count_ > 2)
    {
      throw RecordingError("the disk is gone");
    }
    return ImuSample();
  }

private:
  int count_ = 0;
};

TEST(SequenceReader, ThrowsWhatTheSourceThrewInItsTurn)
{
  SequenceReader reader(std::make_unique<FailingSource>());
  EXPECT_TRUE(reader.next());
  EXPECT_TRUE(reader.next());
  EXPECT_EQ(messageOf<RecordingError>([&] { reader.next(); }), "the disk is gone");
  EXPECT_FALSE(reader.next());
}

TEST(SequenceReader, RefusesNoSourceAndNoRoom)
{
  EXPECT_THROW(SequenceReader(nullptr), std::invalid_argument);
  EXPECT_THROW(SequenceReader(std::make_unique<FailingSource>(), 0), std::invalid_argument);
}

TEST(EurocReader, ReadsARealRecording)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  if (data == nullptr || !fs::exists(fs::path(data) / "slam" / "mh01_first10s"))
  {
    GTEST_SKIP() << "PI_EDGE_DATA is not set to a folder with slam/mh01_first10s";
  }
  SequenceReaderOptions options;
  options.duration_s = 1.0;
  SequenceReader reader(openEuroc((fs::path(data) / "slam" / "mh01_first10s").string(), options));
  const Content content = readAll(&reader);
  EXPECT_EQ(content.pairs.size(), 21u);
  EXPECT_EQ(content.pairs[0].left.cols, 752);
  EXPECT_NEAR(static_cast<double>(content.samples.size()), 601.0, 1.0);  // a second before, one with and one after
  EXPECT_FALSE(reader.defects().any());
  EXPECT_FALSE(reader.description().ground_truth.empty());
}

}  // namespace
