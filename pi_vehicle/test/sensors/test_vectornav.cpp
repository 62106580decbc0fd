#include "sensors/vectornav.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace pi_vehicle
{
namespace
{

using Kind = VectorNavLine::Kind;

/// Sent by a VN-200, with its checksum.
const std::string DEVICE_LINE =
    "$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,+00.002066,-00.008442,-00.044656,"
    "+20.7,+084.322*66";

VectorNavLine withChecksum(const std::string& text)
{
  const std::string command = vectorNavCommand(text);
  return parseVectorNav(command.substr(0, command.size() - 2));
}

std::vector<VectorNavLine> read(VectorNavReader* reader, const std::string& bytes)
{
  std::vector<VectorNavLine> lines;
  reader->onBytes(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size(),
                  [&](const VectorNavLine& line) { lines.push_back(line); });
  return lines;
}

TEST(VectorNav, ReadsALineOfTheDevice)
{
  const VectorNavLine line = parseVectorNav(DEVICE_LINE);
  ASSERT_EQ(Kind::MEASUREMENT, line.kind);
  EXPECT_EQ((std::array<double, 3>{-0.015, 0.019, 9.948}), line.measurement.acceleration);
  EXPECT_EQ((std::array<double, 3>{0.002066, -0.008442, -0.044656}), line.measurement.angular_velocity);
  EXPECT_EQ(110u, line.bytes);
}

TEST(VectorNav, RefusesWrongChecksums)
{
  std::string line = DEVICE_LINE;
  line[10] = '1';
  EXPECT_EQ(Kind::WRONG_CHECKSUM, parseVectorNav(line).kind);
  for (const char* wrong : {"$", "$VNIMU", "$VNIMU*", "$VNIMU*6", "$VNIMU*XX", "$VNIMU*066", "$*", "$VNIMU*-1"})
  {
    EXPECT_EQ(Kind::WRONG_CHECKSUM, parseVectorNav(wrong).kind) << wrong;
  }
}

TEST(VectorNav, RefusesFieldsThatAreTooFewTooManyOrNoNumbers)
{
  EXPECT_EQ(Kind::MEASUREMENT, withChecksum("VNIMU,1,2,3,4,5,6,7,8,9,10,11").kind);
  for (const char* text :
       {"VNIMU,", "VNIMU,1,2,3", "VNIMU,1,2,3,4,5,6,7,8,9,10", "VNIMU,1,2,3,4,5,6,7,8,9,10,11,12",
        "VNIMU,1,2,3,4,5,6,7,8,9,10,", "VNIMU,1,2,3,4,x,6,7,8,9,10,11", "VNIMU,1,2,3,,5,6,7,8,9,10,11",
        "VNIMU,1,2,3,4,5 ,6,7,8,9,10,11", "VNIMU,1,2,3,4,++5,6,7,8,9,10,11"})
  {
    EXPECT_EQ(Kind::TORN, withChecksum(text).kind) << text;
  }
}

TEST(VectorNav, CountsMeasurementsThatAreNoNumbers)
{
  EXPECT_EQ(Kind::NOT_FINITE, withChecksum("VNIMU,1,2,3,nan,5,6,7,8,9,10,11").kind);
  EXPECT_EQ(Kind::NOT_FINITE, withChecksum("VNIMU,1,2,3,4,5,6,7,8,-inf,10,11").kind);
  EXPECT_EQ(Kind::MEASUREMENT, withChecksum("VNIMU,nan,nan,nan,4,5,6,7,8,9,nan,nan").kind) << "no magnetometer";
}

TEST(VectorNav, WritesCommandsWithTheirChecksum)
{
  EXPECT_EQ("$VNRRG,18,+00.013,+00.354,-09.801*65\r\n", vectorNavCommand("VNRRG,18,+00.013,+00.354,-09.801"))
      << "of the manual";
  const VectorNavLine other = withChecksum("VNERR,12");
  EXPECT_EQ(Kind::OTHER, other.kind);
  EXPECT_EQ("VNERR,12", other.text);
}

TEST(VectorNavReader, PutsLinesTogetherFromPieces)
{
  VectorNavReader reader;
  const std::string bytes = DEVICE_LINE + "\r\n" + DEVICE_LINE + "\r\n";
  size_t measurements = 0;
  for (const char byte : bytes)
  {
    for (const VectorNavLine& line : read(&reader, std::string(1, byte)))
    {
      measurements += line.kind == Kind::MEASUREMENT ? 1 : 0;
    }
  }
  EXPECT_EQ(2u, measurements);
  EXPECT_EQ(0u, reader.garbageBytes());
}

TEST(VectorNavReader, GoesOnWithTheNextLineAfterATornOne)
{
  VectorNavReader reader;
  const std::vector<VectorNavLine> lines =
      read(&reader, "0.044656,+20.7,+084.322*66\r\n$VNIMU,-00.03" + DEVICE_LINE + "\r\n");
  ASSERT_EQ(2u, lines.size());
  EXPECT_EQ(Kind::TORN, lines[0].kind);
  EXPECT_EQ(Kind::MEASUREMENT, lines[1].kind);
  EXPECT_EQ(26u + 13u, reader.garbageBytes());
}

TEST(VectorNavReader, GarbageWithoutAnEndTakesNoMemory)
{
  VectorNavReader reader;
  size_t torn = 0;
  for (int i = 0; i < 1000; ++i)
  {
    torn += read(&reader, "$" + std::string(1000, 'U')).size();
  }
  EXPECT_EQ(1000u, torn) << "each is given up at its 257th byte";
  EXPECT_GT(reader.garbageBytes(), 990000u);
  EXPECT_EQ(Kind::MEASUREMENT, read(&reader, DEVICE_LINE + "\n").at(0).kind);
}

}  // namespace
}  // namespace pi_vehicle
