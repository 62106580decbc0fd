#include "drives/sequence_writer.h"

#include "drives/vehicle_path.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

using namespace pi_simulation;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;
namespace fs = std::filesystem;

namespace
{

constexpr int64_t START_NS = 1700000000000000000LL;

/// Two seconds of a drive, in small pictures.
struct Scenario
{
  Scenario()
    : trajectory(pi_slam::SplineTrajectory::fit(makePoses()))
    , calibration(pi_slam::StereoCalibration::makeForwardPair(64, 48))
  {
    world = SyntheticWorld::build(SyntheticWorldOptions(), makePoses());
    calibration.left.model.distortion = pi_slam::Distortion::RADTAN;
    calibration.left.model.coefficients = {-0.1, 0.01, 1e-4, -2e-4};
  }

  static std::vector<pi_slam::StampedPose> makePoses()
  {
    VehiclePathOptions path;
    path.duration_s = 2.0;
    path.start_standstill_s = 0.5;
    return makeVehiclePath(path);
  }

  SequenceOptions options(const TemporaryFolder& folder) const
  {
    SequenceOptions options;
    options.folder = (fs::path(folder.path()) / "out").string();
    return options;
  }

  SequenceReport write(const SequenceOptions& options) const
  {
    return writeSequence(world, trajectory, calibration, options, [](size_t, size_t) { return true; });
  }

  pi_slam::SplineTrajectory trajectory;
  std::shared_ptr<const SyntheticWorld> world;
  pi_slam::StereoCalibration calibration;
};

const Scenario& scenario()
{
  static const Scenario instance;
  return instance;
}

/// Lines that are no comment.
std::vector<std::string> dataLines(const fs::path& file)
{
  std::ifstream stream(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);)
  {
    if (!line.empty() && line.front() != '#')
    {
      lines.push_back(line);
    }
  }
  return lines;
}

std::string textOf(const fs::path& file)
{
  std::ifstream stream(file, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(stream), {});
}

std::vector<int64_t> stampsOf(const fs::path& csv)
{
  std::vector<int64_t> stamps;
  for (const std::string& line : dataLines(csv))
  {
    stamps.push_back(std::stoll(line));
  }
  return stamps;
}

}  // namespace

TEST(SequenceWriter, WritesTheLayoutOfEuroc)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  options.depth = options.obstacles = true;
  const SequenceReport report = scenario().write(options);
  EXPECT_TRUE(report.complete);
  EXPECT_EQ(report.pairs, 41u);  // 20 Hz, both ends
  EXPECT_EQ(report.imu_samples, 401u);
  const fs::path mav = fs::path(folder.path()) / "out" / "mav0";
  for (const char* camera : {"cam0", "cam1"})
  {
    const auto lines = dataLines(mav / camera / "data.csv");
    ASSERT_EQ(lines.size(), 41u);
    EXPECT_EQ(lines[1], "1700000000050000000,1700000000050000000.png");
    for (const std::string& line : lines)
    {
      const cv::Mat picture =
          cv::imread((mav / camera / "data" / line.substr(line.find(',') + 1)).string(), cv::IMREAD_UNCHANGED);
      ASSERT_EQ(picture.size(), cv::Size(64, 48));
      ASSERT_EQ(picture.type(), CV_8UC1);
    }
  }
  EXPECT_EQ(textOf(mav / "imu0" / "data.csv").front(), '#');
  const auto truth = dataLines(mav / "state_groundtruth_estimate0" / "data.csv");
  ASSERT_EQ(truth.size(), 401u);
  EXPECT_EQ(std::count(truth[0].begin(), truth[0].end(), ','), 16);
  EXPECT_EQ(dataLines(fs::path(folder.path()) / "out" / "groundtruth_tum.txt").size(), 401u);
  const cv::Mat depth =
      cv::imread((fs::path(folder.path()) / "out/truth/depth/1700000000000000000.png").string(), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(depth.type(), CV_16UC1);
  cv::FileStorage json((fs::path(folder.path()) / "out/truth/obstacles.json").string(), cv::FileStorage::READ);
  EXPECT_EQ(json["frames"].size(), 41u);
}

TEST(SequenceWriter, CalibrationAndTruthReadBackAsWritten)
{
  const TemporaryFolder folder;
  scenario().write(scenario().options(folder));
  const std::string mav = (fs::path(folder.path()) / "out" / "mav0").string();
  const pi_slam::StereoCalibration read =
      pi_slam::StereoCalibration::loadEuroc(mav + "/cam0/sensor.yaml", mav + "/cam1/sensor.yaml");
  const pi_slam::StereoCalibration& written = scenario().calibration;
  EXPECT_EQ(read.left.model.coefficients, written.left.model.coefficients);
  EXPECT_EQ(read.left.model.fx, written.left.model.fx);
  EXPECT_EQ(read.left.model.cx, written.left.model.cx);
  EXPECT_LT((read.right.T_body_camera.matrix() - written.right.T_body_camera.matrix()).norm(), 1e-12);
  const auto tum = pi_slam::readTrajectory((fs::path(folder.path()) / "out" / "groundtruth_tum.txt").string());
  const auto csv = pi_slam::readTrajectory(mav + "/state_groundtruth_estimate0/data.csv");
  ASSERT_EQ(tum.size(), csv.size());
  for (size_t i = 0; i < tum.size(); ++i)
  {
    EXPECT_EQ(tum[i].stamp_ns, csv[i].stamp_ns);
    const Eigen::Isometry3d truth = scenario().trajectory.at(tum[i].stamp_ns).T_world_body;
    EXPECT_LT((tum[i].T_world_body.matrix() - truth.matrix()).norm(), 1e-8);
    EXPECT_LT((csv[i].T_world_body.matrix() - truth.matrix()).norm(), 1e-8);
  }
  EXPECT_EQ(pi_slam::readImuLog(mav + "/imu0/data.csv").lines.size(), 401u);
}

TEST(SequenceWriter, ContentDoesNotDependOnThreads)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  options.obstacles = true;
  options.renderer.threads = 1;
  scenario().write(options);
  options.folder = (fs::path(folder.path()) / "other").string();
  options.renderer.threads = 3;
  scenario().write(options);
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(folder.path()) / "out"))
  {
    if (entry.is_regular_file())
    {
      const fs::path other =
          fs::path(folder.path()) / "other" / fs::relative(entry.path(), fs::path(folder.path()) / "out");
      EXPECT_EQ(textOf(entry.path()), textOf(other)) << other;
      ++files;
    }
  }
  EXPECT_EQ(files, 82 + 2 + 2 + 2 + 2 + 1 + 1);
}

TEST(SequenceWriter, PassesAnImuLogOnUnchangedAndTakesPicturesAtItsStamps)
{
  const TemporaryFolder folder;
  std::string log = "#timestamp [ns],as recorded\n";
  std::vector<std::string> lines;
  for (int i = -600; i < 500; ++i)
  {
    lines.push_back(std::to_string(START_NS + 1234567 + i * 5000000LL) + ",0.10,0.2,0.3,9.810,1e-3," +
                    std::to_string(i));
    log += lines.back() + "\r\n";
  }
  SequenceOptions options = scenario().options(folder);
  options.imu_log = folder.file("imu.csv", log);
  const SequenceReport report = scenario().write(options);
  const fs::path mav = fs::path(folder.path()) / "out" / "mav0";
  const auto kept = dataLines(mav / "imu0" / "data.csv");
  ASSERT_EQ(kept.size(), report.imu_samples);
  EXPECT_TRUE(std::equal(kept.begin(), kept.end(), lines.begin()));
  EXPECT_EQ(kept.size(), 600u + 400u);  // from 3 s before the first picture to the end of the trajectory
  const auto imu_stamps = stampsOf(mav / "imu0" / "data.csv");
  for (const int64_t stamp_ns : stampsOf(mav / "cam0" / "data.csv"))
  {
    EXPECT_TRUE(std::binary_search(imu_stamps.begin(), imu_stamps.end(), stamp_ns));
  }
  EXPECT_NE(textOf(mav / "imu0" / "sensor.yaml").find("rate_hz: 200\n"), std::string::npos);
}

TEST(SequenceWriter, MakesTheFaultsThatAreAskedFor)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  options.faults.black.push_back({{0.2, 0.3}, SequenceFaults::Cameras::BOTH});
  options.faults.black.push_back({{0.5, 0.5}, SequenceFaults::Cameras::RIGHT});
  options.faults.dropped.push_back({0.7, 0.8});
  options.faults.late.push_back({1.0, 1.1});
  options.faults.imu_gaps.push_back({1.5, 1.75});
  scenario().write(options);
  const fs::path mav = fs::path(folder.path()) / "out" / "mav0";
  const auto brightest = [&](const char* camera, int64_t time_ms)
  {
    const fs::path file = mav / camera / "data" / (std::to_string(START_NS + time_ms * 1000000) + ".png");
    double value = -1.0;
    cv::minMaxLoc(cv::imread(file.string(), cv::IMREAD_UNCHANGED), nullptr, &value);
    return value;
  };
  EXPECT_GT(brightest("cam0", 150), 50.0);
  EXPECT_EQ(brightest("cam0", 200), 0.0);
  EXPECT_EQ(brightest("cam1", 300), 0.0);
  EXPECT_GT(brightest("cam0", 500), 50.0);
  EXPECT_EQ(brightest("cam1", 500), 0.0);

  std::vector<int64_t> expected;  // [ms]
  for (int64_t ms = 0; ms <= 2000; ms += 50)
  {
    // 1.0 to 1.1 s are stamped 1.2 to 1.3 s, so that those taken from 1.15 to 1.3 s are out of order.
    const bool dropped = (ms >= 700 && ms <= 800) || (ms > 1100 && ms <= 1300);
    if (!dropped)
    {
      expected.push_back(ms >= 1000 && ms <= 1100 ? ms + 200 : ms);
    }
  }
  std::vector<int64_t> found;
  for (const int64_t stamp_ns : stampsOf(mav / "cam1" / "data.csv"))
  {
    found.push_back((stamp_ns - START_NS) / 1000000);
  }
  EXPECT_EQ(found, expected);
  const auto imu = stampsOf(mav / "imu0" / "data.csv");
  EXPECT_EQ(imu.size(), 401u - 51u);
  EXPECT_EQ(dataLines(mav / "state_groundtruth_estimate0" / "data.csv").size(), 401u);  // truth has no gap
}

TEST(SequenceWriter, SwapsTheCamerasPictures)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  options.duration_s = 0.1;
  scenario().write(options);
  options.folder = (fs::path(folder.path()) / "swapped").string();
  options.faults.swapped_cameras = true;
  scenario().write(options);
  const std::string name = "data/" + std::to_string(START_NS) + ".png";
  EXPECT_EQ(textOf(fs::path(folder.path()) / "out/mav0/cam0" / name),
            textOf(fs::path(folder.path()) / "swapped/mav0/cam1" / name));
  EXPECT_EQ(textOf(fs::path(folder.path()) / "out/mav0/cam0/sensor.yaml"),
            textOf(fs::path(folder.path()) / "swapped/mav0/cam0/sensor.yaml"));
}

TEST(SequenceWriter, LeavesNothingBehindWhenStopped)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  const SequenceReport report = writeSequence(scenario().world, scenario().trajectory, scenario().calibration, options,
                                              [](size_t done, size_t) { return done < 3; });
  EXPECT_FALSE(report.complete);
  EXPECT_FALSE(fs::exists(fs::path(folder.path()) / "out" / "mav0"));
  EXPECT_FALSE(fs::exists(fs::path(folder.path()) / "out" / "groundtruth_tum.txt"));
}

TEST(SequenceWriter, KeepsARecordingUnlessAskedToReplaceIt)
{
  const TemporaryFolder folder;
  SequenceOptions options = scenario().options(folder);
  options.duration_s = 0.1;
  scenario().write(options);
  EXPECT_NE(messageOf<std::runtime_error>([&] { scenario().write(options); }).find("exists"), std::string::npos);
  options.overwrite = true;
  EXPECT_TRUE(scenario().write(options).complete);
}

TEST(SequenceWriter, RefusesBadInputByName)
{
  const TemporaryFolder folder;
  const auto complaint = [&](const std::function<void(SequenceOptions*)>& spoil)
  {
    SequenceOptions options = scenario().options(folder);
    spoil(&options);
    return messageOf<std::exception>([&] { scenario().write(options); });
  };
  EXPECT_EQ(complaint([](SequenceOptions* o) { o->frame_rate_hz = 0.0; }),
            "sequence: frame_rate_hz = 0.000000, must be in [0.1, 1000]");
  EXPECT_NE(complaint([](SequenceOptions* o) { o->start_s = 5.0; }).find("leaves nothing"), std::string::npos);
  EXPECT_NE(complaint([](SequenceOptions* o) { o->folder.clear(); }).find("folder is empty"), std::string::npos);
  EXPECT_NE(complaint(
                [](SequenceOptions* o) {
                  o->faults.late.push_back({3.0, 2.0});
                })
                .find("late to = 2.0"),
            std::string::npos);
  EXPECT_NE(complaint([&](SequenceOptions* o) { o->imu_log = folder.file("old.csv", "1000,1,2,3,4,5,6\n"); })
                .find("do both belong together"),
            std::string::npos);
  EXPECT_NE(complaint([](SequenceOptions* o) { o->folder = "/proc/nowhere"; }).find("/proc/nowhere"),
            std::string::npos);
  EXPECT_FALSE(fs::exists(fs::path(folder.path()) / "out"));
}
