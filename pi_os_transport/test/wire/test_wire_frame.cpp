#include "wire/wire_frame.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace pi_os_transport
{
namespace
{

FrameHeader someHeader()
{
  FrameHeader header;
  header.type = FrameType::FRAGMENT;
  header.id = 0x01020304;
  header.session = 0x1112131415161718;
  header.count = 0x21222324;
  header.offset = 0x3132333435363738;
  return header;
}

Hello someHello()
{
  Hello hello;
  hello.instance = 0xa1a2a3a4a5a6a7a8;
  hello.secret = 0xb1b2b3b4b5b6b7b8;
  hello.echo = 0xc1c2c3c4c5c6c7c8;
  hello.port = 8814;
  hello.address = "192.168.17.4";
  hello.name = "robot \xcf\x80";
  return hello;
}

LinkOpen someLinkOpen()
{
  return {"socket token", "link token", "/camera/image_raw", "sensor_msgs/Image", "/camera", "/viewer"};
}

TEST(FrameHeader, HasTheseBytes)
{
  const std::array<uint8_t, FrameHeader::BYTES> expected{0x6f, 0x50, 0x01, 0x0d, 0x04, 0x03, 0x02, 0x01,  //
                                                         0x18, 0x17, 0x16, 0x15, 0x14, 0x13, 0x12, 0x11,  //
                                                         0x24, 0x23, 0x22, 0x21, 0x00, 0x00, 0x00, 0x00,  //
                                                         0x38, 0x37, 0x36, 0x35, 0x34, 0x33, 0x32, 0x31};
  EXPECT_EQ(expected, someHeader().encode());
}

TEST(FrameHeader, ComesBackFromItsBytes)
{
  for (int type = 1; type <= LAST_FRAME_TYPE; ++type)
  {
    FrameHeader sent = someHeader();
    sent.type = static_cast<FrameType>(type);
    FrameHeader header;
    ASSERT_TRUE(FrameHeader::decode(sent.encode().data(), &header)) << type;
    EXPECT_EQ(WIRE_VERSION, header.version);
    EXPECT_EQ(sent.type, header.type);
    EXPECT_EQ(sent.id, header.id);
    EXPECT_EQ(sent.session, header.session);
    EXPECT_EQ(sent.count, header.count);
    EXPECT_EQ(sent.offset, header.offset);
  }
}

TEST(FrameHeader, OfAnotherKindIsRefused)
{
  FrameHeader header;
  auto bytes = someHeader().encode();
  bytes[0] ^= 1;
  EXPECT_FALSE(FrameHeader::decode(bytes.data(), &header)) << "magic";
  bytes = someHeader().encode();
  bytes[3] = 0;
  EXPECT_FALSE(FrameHeader::decode(bytes.data(), &header)) << "type 0";
  bytes[3] = LAST_FRAME_TYPE + 1;
  EXPECT_FALSE(FrameHeader::decode(bytes.data(), &header)) << "unknown type";
}

TEST(FrameHeader, OfAnotherVersionTellsItsVersion)
{
  FrameHeader sent = someHeader();
  sent.version = WIRE_VERSION + 1;
  auto bytes = sent.encode();
  bytes[3] = 0xff;  // a type that only the other version knows
  FrameHeader header;
  ASSERT_TRUE(FrameHeader::decode(bytes.data(), &header));
  EXPECT_EQ(WIRE_VERSION + 1, header.version);
}

TEST(FrameHeader, ToleratesAnyBytes)
{
  std::mt19937 random(1);
  std::vector<uint8_t> bytes(FrameHeader::BYTES);  // on the heap, where reading too far is noticed
  for (int round = 0; round < 20000; ++round)
  {
    for (uint8_t& byte : bytes)
    {
      byte = static_cast<uint8_t>(random());
    }
    bytes[0] = 0x6f;
    bytes[1] = 0x50;
    bytes[2] = round % 2 == 0 ? WIRE_VERSION : bytes[2];
    FrameHeader header;
    if (FrameHeader::decode(bytes.data(), &header) && header.version == WIRE_VERSION)
    {
      ASSERT_GE(static_cast<int>(header.type), 1);
      ASSERT_LE(static_cast<int>(header.type), LAST_FRAME_TYPE);
    }
  }
}

TEST(LinkEntry, ComesBackFromItsBytes)
{
  PayloadWriter out;
  for (uint32_t number = 1; number <= 3; ++number)
  {
    LinkEntry{number, 0xfffffff0 + number, 7 * number}.append(&out);
  }
  ASSERT_EQ(3 * LinkEntry::BYTES, out.bytes().size());
  PayloadReader in(out.bytes().data(), out.bytes().size());
  for (uint32_t number = 1; number <= 3; ++number)
  {
    const LinkEntry entry = LinkEntry::read(&in);
    EXPECT_EQ(number, entry.link);
    EXPECT_EQ(0xfffffff0 + number, entry.sequence);
    EXPECT_EQ(7 * number, entry.after_tcp);
  }
  EXPECT_TRUE(in.ok());
  EXPECT_EQ(0U, in.restLength());
}

TEST(LinkEntry, CutShortIsNoticed)
{
  PayloadWriter out;
  LinkEntry{1, 2, 3}.append(&out);
  for (size_t length = 0; length < LinkEntry::BYTES; ++length)
  {
    const std::vector<uint8_t> cut(out.bytes().begin(), out.bytes().begin() + static_cast<std::ptrdiff_t>(length));
    PayloadReader in(cut.data(), cut.size());
    LinkEntry::read(&in);
    EXPECT_FALSE(in.ok()) << length;
  }
}

TEST(Hello, ComesBackFromItsBytes)
{
  const Hello sent = someHello();
  const std::vector<uint8_t> bytes = sent.encode();
  Hello hello;
  ASSERT_TRUE(Hello::decode(bytes.data(), bytes.size(), &hello));
  EXPECT_EQ(sent.instance, hello.instance);
  EXPECT_EQ(sent.secret, hello.secret);
  EXPECT_EQ(sent.echo, hello.echo);
  EXPECT_EQ(sent.port, hello.port);
  EXPECT_EQ(sent.address, hello.address);
  EXPECT_EQ(sent.name, hello.name);
}

TEST(Hello, WithoutInstanceOrSecretIsRefused)
{
  Hello without_instance = someHello();
  without_instance.instance = 0;
  Hello without_secret = someHello();
  without_secret.secret = 0;
  for (const Hello& sent : {without_instance, without_secret})
  {
    const std::vector<uint8_t> bytes = sent.encode();
    Hello hello;
    EXPECT_FALSE(Hello::decode(bytes.data(), bytes.size(), &hello));
  }
}

TEST(LinkOpen, ComesBackFromItsBytes)
{
  const LinkOpen sent = someLinkOpen();
  const std::vector<uint8_t> bytes = sent.encode();
  LinkOpen open;
  ASSERT_TRUE(LinkOpen::decode(bytes.data(), bytes.size(), &open));
  EXPECT_EQ(sent.socket_token, open.socket_token);
  EXPECT_EQ(sent.link_token, open.link_token);
  EXPECT_EQ(sent.topic, open.topic);
  EXPECT_EQ(sent.type, open.type);
  EXPECT_EQ(sent.publisher, open.publisher);
  EXPECT_EQ(sent.subscriber, open.subscriber);
}

template <typename Payload>
void expectOnlyTheWholePayloadDecodes(const Payload& sent)
{
  const std::vector<uint8_t> bytes = sent.encode();
  Payload payload;
  for (size_t length = 0; length < bytes.size(); ++length)
  {
    const std::vector<uint8_t> cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(length));
    EXPECT_FALSE(Payload::decode(cut.data(), cut.size(), &payload)) << length << " of " << bytes.size();
  }
  std::vector<uint8_t> longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(Payload::decode(longer.data(), longer.size(), &payload)) << "one byte more";
}

TEST(Hello, CutShortIsRefused)
{
  expectOnlyTheWholePayloadDecodes(someHello());
}

TEST(LinkOpen, CutShortIsRefused)
{
  expectOnlyTheWholePayloadDecodes(someLinkOpen());
}

TEST(Payloads, TolerateAnyBytes)
{
  std::mt19937 random(2);
  for (int round = 0; round < 20000; ++round)
  {
    std::vector<uint8_t> bytes(random() % 80);
    for (uint8_t& byte : bytes)
    {
      byte = static_cast<uint8_t>(random() % (round % 2 == 0 ? 256 : 8));  // small numbers: strings that fit
    }
    // What is accepted must be what was sent, to the last byte.
    Hello hello;
    if (Hello::decode(bytes.data(), bytes.size(), &hello))
    {
      EXPECT_EQ(bytes, hello.encode());
    }
    LinkOpen open;
    if (LinkOpen::decode(bytes.data(), bytes.size(), &open))
    {
      EXPECT_EQ(bytes, open.encode());
    }
  }
}

}  // namespace
}  // namespace pi_os_transport
