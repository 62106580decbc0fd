#include "rosout/rotating_file.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_os_transport
{
namespace
{

class RotatingFileTest : public testing::Test
{
protected:
  void SetUp() override
  {
    std::string name = testing::TempDir() + "rotating_file_XXXXXX";
    ASSERT_NE(nullptr, mkdtemp(name.data()));
    folder = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder); }

  std::string contents(const std::string& name) const
  {
    std::ifstream file(folder / name);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  std::filesystem::path folder;
  std::vector<std::string> log;
  RotatingFile::Log logger = [this](const std::string& line) { log.push_back(line); };
};

TEST_F(RotatingFileTest, PutsFullFilesAside)
{
  RotatingFile::Limits limits;
  limits.bytes = 3;
  limits.backups = 2;
  RotatingFile file(folder / "a.log", logger, limits);
  for (const char* text : {"1111", "2222", "33", "3344", "55"})
  {
    file.write(text);
  }
  EXPECT_EQ("55", contents("a.log"));
  EXPECT_EQ("333344", contents("a.log.1"));
  EXPECT_EQ("2222", contents("a.log.2"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.log.3"));
  EXPECT_TRUE(log.empty());
}

TEST_F(RotatingFileTest, StartsEmpty)
{
  std::ofstream(folder / "a.log") << "old";
  RotatingFile file(folder / "a.log", logger, RotatingFile::Limits());
  file.write("new");
  EXPECT_EQ("new", contents("a.log"));
}

TEST_F(RotatingFileTest, SaysWhyItCannotBeOpened)
{
  try
  {
    const RotatingFile file(folder / "missing" / "a.log", logger, RotatingFile::Limits());
    FAIL() << "opened";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_NE(std::string::npos, std::string(error.what()).find("missing/a.log")) << error.what();
    EXPECT_NE(std::string::npos, std::string(error.what()).find("ROS_LOG_DIR")) << error.what();
  }
}

TEST_F(RotatingFileTest, CountsWhatAFullDiskLoses)
{
  RotatingFile file("/dev/full", logger, RotatingFile::Limits());
  file.write("a");
  file.write("b");
  EXPECT_EQ(2U, file.lost());
  ASSERT_EQ(1U, log.size());
  EXPECT_NE(std::string::npos, log[0].find("/dev/full"));
}

}  // namespace
}  // namespace pi_os_transport
