#include "roscpp/options.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <map>

namespace pi_os_transport
{
namespace
{

struct Loaded
{
  Options options;
  std::vector<std::string> errors;
};

Loaded load(const std::map<std::string, std::string>& values)
{
  Loaded loaded;
  loaded.options.load(
      [&values](const std::string& name) -> std::optional<std::string>
      {
        const auto found = values.find(name);
        return found != values.end() ? std::optional<std::string>(found->second) : std::nullopt;
      },
      [](const std::string& name) { return "/pi_os/" + name; }, &loaded.errors);
  return loaded;
}

TEST(Options, CarryEverythingByDefault)
{
  EXPECT_TRUE(Options().carries("/camera/image_raw"));
}

TEST(Options, ExcludeWinsOverInclude)
{
  const Loaded loaded = load({{"include", "/camera/*, /imu*"}, {"exclude", "*/compressed"}});
  EXPECT_TRUE(loaded.errors.empty());
  EXPECT_TRUE(loaded.options.carries("/camera/left/image_raw"));
  EXPECT_TRUE(loaded.options.carries("/imu/data"));
  EXPECT_FALSE(loaded.options.carries("/camera/left/compressed"));
  EXPECT_FALSE(loaded.options.carries("/odometry"));
}

TEST(Options, DisabledCarriesNothing)
{
  EXPECT_FALSE(load({{"enable", "0"}}).options.carries("/any"));
  EXPECT_FALSE(load({{"enable", "False"}}).options.carries("/any"));
  EXPECT_TRUE(load({{"enable", "true"}}).options.carries("/any"));
}

TEST(Options, ReadsSwitches)
{
  EXPECT_TRUE(Options().skip_zero_fill);
  EXPECT_FALSE(load({{"skip_zero_fill", "0"}}).options.skip_zero_fill);
  const Loaded bad = load({{"skip_zero_fill", "2"}});
  EXPECT_TRUE(bad.options.skip_zero_fill);
  ASSERT_EQ(1U, bad.errors.size());
  EXPECT_EQ("/pi_os/skip_zero_fill = \"2\" is ignored: it must be 1, 0, true or false; 1 stays in force",
            bad.errors[0]);
}

TEST(Options, ReadsNumbers)
{
  const Loaded loaded = load({{"pool_limit_mb", "64"}, {"min_bytes", "1024"}});
  EXPECT_TRUE(loaded.errors.empty());
  EXPECT_EQ(64U, loaded.options.pool_limit_mb);
  EXPECT_EQ(1024U, loaded.options.min_bytes);
}

TEST(Options, BadValueKeepsTheFieldAndNamesItValueAndRange)
{
  for (const char* value : {"abc", "", "-1", "1.5", "0", "65537", "12 "})
  {
    const Loaded loaded = load({{"pool_limit_mb", value}});
    ASSERT_EQ(1U, loaded.errors.size()) << value;
    EXPECT_EQ("/pi_os/pool_limit_mb = \"" + std::string(value) +
                  "\" is ignored: it must be a whole number from 1 to 65536; 512 stays in force",
              loaded.errors[0]);
    EXPECT_EQ(512U, loaded.options.pool_limit_mb);
  }
  EXPECT_EQ(1U, load({{"enable", "maybe"}}).errors.size());
}

TEST(Options, ABridgeIsRequiredAlsoIfTheValueIsBad)
{
  EXPECT_FALSE(load({}).options.require_bridge);
  EXPECT_FALSE(load({{"require_bridge", "0"}}).options.require_bridge);
  EXPECT_TRUE(load({{"require_bridge", "true"}}).options.require_bridge);
  const Loaded loaded = load({{"require_bridge", "yes"}});
  EXPECT_TRUE(loaded.options.require_bridge);
  ASSERT_EQ(1U, loaded.errors.size());
  EXPECT_NE(std::string::npos, loaded.errors[0].find("1, 0, true or false; 1 stays in force"));
}

TEST(Options, EnvironmentUsesUpperCaseNames)
{
  setenv("PI_OS_POOL_LIMIT_MB", "7", 1);
  setenv("PI_OS_MIN_BYTES", "x", 1);
  Options options;
  std::vector<std::string> errors;
  options.loadEnvironment(&errors);
  unsetenv("PI_OS_POOL_LIMIT_MB");
  unsetenv("PI_OS_MIN_BYTES");
  EXPECT_EQ(7U, options.pool_limit_mb);
  ASSERT_EQ(1U, errors.size());
  EXPECT_EQ(0U, errors[0].find("PI_OS_MIN_BYTES = \"x\""));
}

}  // namespace
}  // namespace pi_os_transport
