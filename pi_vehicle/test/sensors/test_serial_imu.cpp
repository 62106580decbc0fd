// The reader of the IMU through a pseudo-terminal. Waits for events; no time is judged.

#include "sensors/serial_imu.h"

#include "fake_vectornav.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>

#include <condition_variable>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

class SerialImuTest : public testing::Test
{
protected:
  void start()
  {
    options_.port = link_;
    options_.reconnect_pause_s = 0.05;
    SerialImuEvents events;
    events.measurement = [this](const ImuMeasurement& measurement, int64_t stamp_ns)
    {
      EXPECT_GT(stamp_ns, last_ns_);
      EXPECT_EQ(9.81, measurement.acceleration[2]);
      EXPECT_EQ(-0.002, measurement.angular_velocity[1]);
      note([&] { last_ns_ = stamp_ns, ++measured_; });
    };
    events.well = [this](const std::string& path) { note([&] { log_.push_back("well " + path); }); };
    events.problem = [this](const std::string& problem) { note([&] { log_.push_back(problem); }); };
    imu_ = std::make_unique<SerialImu>(options_, events);
  }
  void note(const std::function<void()>& change)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    change();
    changed_.notify_all();
  }
  bool until(const std::function<bool()>& condition)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(30), condition);
  }
  bool untilLogged(const std::string& part)
  {
    return until([&] { return !log_.empty() && log_.back().find(part) != std::string::npos; });
  }
  bool untilMeasured()
  {
    return until([this, target = measured_ + 20] { return measured_ >= target; });
  }
  /// Of a counter, which grows with the measurements that come meanwhile.
  bool untilState(const std::function<bool(const SerialImuState&)>& condition)
  {
    return until([&] { return condition(imu_->state()); });
  }
  std::string text() const
  {
    std::string all;
    for (const std::string& line : log_)
    {
      all += line + "\n";
    }
    return all;
  }

  const TemporaryFolder folder_;
  const std::string link_ = folder_.path() + "/imu";
  FakeVectorNav device_{link_};
  SerialImuOptions options_;
  std::mutex mutex_;
  std::condition_variable changed_;
  size_t measured_ = 0;
  int64_t last_ns_ = 0;
  std::vector<std::string> log_;
  std::unique_ptr<SerialImu> imu_;
};

TEST_F(SerialImuTest, ConfiguresTheDeviceAndReadsIt)
{
  start();
  ASSERT_TRUE(untilMeasured()) << text();
  ASSERT_TRUE(untilState([](const SerialImuState& state) { return state.configured; }));
  EXPECT_EQ((std::vector<std::string>{"VNWRG,06,19", "VNWRG,07,200"}), device_.commands());
  EXPECT_EQ((std::vector<std::string>{"well " + link_}), log_);
}

TEST_F(SerialImuTest, SaysNothingToADeviceThatIsConfigured)
{
  options_.configure = false;
  start();
  ASSERT_TRUE(untilMeasured()) << text();
  EXPECT_TRUE(device_.commands().empty());
}

TEST_F(SerialImuTest, RepeatsACommandThatIsNotAnswered)
{
  device_.answer("");
  start();
  ASSERT_TRUE(until([this] { return device_.commands().size() >= 2; }));
  EXPECT_EQ("VNWRG,06,19", device_.commands()[1]);
  device_.answer("echo");
  EXPECT_TRUE(untilState([](const SerialImuState& state) { return state.configured; }));
}

TEST_F(SerialImuTest, OpensTheLineAgainWithOneLineInTheLog)
{
  start();
  ASSERT_TRUE(untilMeasured());
  device_.unplug();
  ASSERT_TRUE(untilLogged("serial port " + link_ + " is gone; is the IMU unplugged?")) << text();
  EXPECT_EQ("", imu_->state().path);
  device_.plugIn();
  ASSERT_TRUE(untilMeasured());
  EXPECT_EQ(3u, log_.size()) << text();
  EXPECT_EQ(2u, imu_->state().opened);
}

TEST_F(SerialImuTest, ALineThatIsNotThereIsNamed)
{
  device_.unplug();
  start();
  ASSERT_TRUE(untilLogged("serial port " + link_ + " is not there; is the IMU plugged in and switched on?")) << text();
  device_.plugIn();
  EXPECT_TRUE(untilMeasured());
}

TEST_F(SerialImuTest, CountsWhatIsBrokenAndGoesOn)
{
  start();
  ASSERT_TRUE(untilMeasured());
  std::string wrong = FakeVectorNav::measurement();
  wrong[20] = wrong[20] == '0' ? '1' : '0';
  device_.send(wrong + FakeVectorNav::measurement().substr(0, 40) +
               vectorNavCommand("VNIMU,1,2,3,nan,5,6,7,8,9,10,11") + "\xff\x00garbage");
  ASSERT_TRUE(untilState(
      [](const SerialImuState& state)
      { return state.wrong_checksums == 1 && state.torn == 1 && state.not_finite == 1 && state.garbage_bytes > 40; }));
  EXPECT_TRUE(untilMeasured());
  EXPECT_EQ(1u, log_.size()) << text();
}

TEST_F(SerialImuTest, AWrongBaudRateIsGuessedFromGarbage)
{
  device_.measure("\x80\xf8$\x80\x78\xf8\n");
  device_.answer("");
  start();
  EXPECT_TRUE(untilLogged("only garbage comes; set baud_rate = 230400 to that of the device")) << text();
}

TEST_F(SerialImuTest, OtherMeasurementsAreNamed)
{
  options_.configure = false;
  device_.measure(vectorNavCommand("VNYPR,+010.071,+000.278,-002.026"));
  start();
  EXPECT_TRUE(untilLogged("it sends $VNYPR, not $VNIMU; set configure: true")) << text();
}

TEST_F(SerialImuTest, ARefusalIsNamed)
{
  device_.measure("");
  device_.answer("VNERR,12");
  start();
  EXPECT_TRUE(untilLogged("refuses VNWRG,06,19 with error 12; give a lower rate or a higher baud_rate")) << text();
}

TEST_F(SerialImuTest, SilenceIsNamed)
{
  start();
  ASSERT_TRUE(untilMeasured());
  device_.measure("");
  ASSERT_TRUE(untilLogged("nothing comes any more; is it switched on?")) << text();
  device_.measure(FakeVectorNav::measurement());
  ASSERT_TRUE(untilLogged("well")) << text();
  EXPECT_TRUE(untilMeasured());
}

TEST(SerialImuOptions, NameFieldValueAndBound)
{
  const auto refusal = [](double rate, uint32_t baud_rate, bool configure)
  {
    SerialImuOptions options;
    options.rate = rate;
    options.baud_rate = baud_rate;
    options.configure = configure;
    return messageOf<std::invalid_argument>([&] { options.validate(); });
  };
  EXPECT_EQ("", refusal(200.0, 230400, true));
  EXPECT_EQ("rate = 200, must be at most 104: the line carries no more at baud_rate = 115200",
            refusal(200.0, 115200, true));
  EXPECT_EQ("rate = 150, must be 1, 2, 4, 5, 10, 20, 25, 40, 50, 100 or 200 with configure: true",
            refusal(150.0, 230400, true));
  EXPECT_EQ("", refusal(150.0, 230400, false));
  EXPECT_EQ("rate = 0, must be in [1, 1000]", refusal(0.0, 230400, false));
  EXPECT_EQ(0u, refusal(100.0, 1234, true).find("baud_rate = 1234, must be one of 9600"));
}

}  // namespace
}  // namespace pi_vehicle
