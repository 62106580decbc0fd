#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "wire/wire_message.h"

using namespace pi_offload;
using pi_node::test_support::messageOf;

namespace
{

OffloadRequest someRequest()
{
  OffloadRequest request;
  request.type = OffloadRequest::Type::TASK;
  request.request = 0x123456789abcdef0U;
  request.vehicle = "car-7";
  request.kind = TaskKind::SPEECH;
  request.sent_ns = -5;
  request.remaining_s = 0.125;
  request.lease_rate_hz = {10.0, 0.25};
  request.speech_s = 0.75;
  request.encoding = Encoding::S16LE;
  request.width = 640;
  request.height = 480;
  request.options = "go\nstop";
  request.payload = {1, 2, 3, 255};
  return request;
}

OffloadReply someReply()
{
  OffloadReply reply;
  reply.status = OffloadReply::Status::FAILED;
  reply.type = OffloadRequest::Type::TASK;
  reply.request = 77;
  reply.kind = TaskKind::SPEECH;
  reply.queue_s = 0.5;
  reply.service_s = 0.25;
  NodeAdvertisement& node = reply.advertisement;
  node.of_kind[0] = {true, 0.01, 0.002, 0.003, 1.5, 10.0};
  node.of_kind[1] = {false, 0.1, 0.02, 0.03, 0.0, 0.0};
  node.capacity_gcycles = 12.5;
  node.draining = true;
  node.has_position = true;
  node.position = {-3.5, 4.5};
  node.range_m = std::numeric_limits<double>::infinity();
  reply.text = "stop";
  reply.objects = {{"person", 0.75F, 1.0F, 2.0F, 3.0F, 4.0F}, {"car", 0.5F, -1.0F, 0.0F, 9.5F, 8.0F}};
  reply.model = "ssd";
  reply.confidence = 0.875F;
  reply.accepted = true;
  return reply;
}

}  // namespace

TEST(WireMessage, RequestsComeBackAsTheyWere)
{
  const OffloadRequest request = someRequest();
  const auto bytes = encode(request);
  const OffloadRequest back = decodeRequest(bytes.data(), bytes.size());
  EXPECT_EQ(back.type, request.type);
  EXPECT_EQ(back.request, request.request);
  EXPECT_EQ(back.vehicle, request.vehicle);
  EXPECT_EQ(back.kind, request.kind);
  EXPECT_EQ(back.sent_ns, request.sent_ns);
  EXPECT_EQ(back.remaining_s, request.remaining_s);
  EXPECT_EQ(back.lease_rate_hz, request.lease_rate_hz);
  EXPECT_EQ(back.speech_s, request.speech_s);
  EXPECT_EQ(back.encoding, request.encoding);
  EXPECT_EQ(back.width, request.width);
  EXPECT_EQ(back.height, request.height);
  EXPECT_EQ(back.options, request.options);
  EXPECT_EQ(back.payload, request.payload);
}

TEST(WireMessage, RepliesComeBackAsTheyWere)
{
  const OffloadReply reply = someReply();
  const auto bytes = encode(reply);
  const OffloadReply back = decodeReply(bytes.data(), bytes.size());
  EXPECT_EQ(back.status, reply.status);
  EXPECT_EQ(back.type, reply.type);
  EXPECT_EQ(back.request, reply.request);
  EXPECT_EQ(back.kind, reply.kind);
  EXPECT_EQ(back.queue_s, reply.queue_s);
  EXPECT_EQ(back.service_s, reply.service_s);
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    const auto& a = back.advertisement.of_kind[kind];
    const auto& b = reply.advertisement.of_kind[kind];
    EXPECT_EQ(a.served, b.served);
    EXPECT_EQ(a.service_s, b.service_s);
    EXPECT_EQ(a.service_deviation_s, b.service_deviation_s);
    EXPECT_EQ(a.queue_s, b.queue_s);
    EXPECT_EQ(a.lease_until_s, b.lease_until_s);
    EXPECT_EQ(a.lease_rate_hz, b.lease_rate_hz);
  }
  EXPECT_EQ(back.advertisement.capacity_gcycles, 12.5);
  EXPECT_TRUE(back.advertisement.draining);
  EXPECT_TRUE(back.advertisement.has_position);
  EXPECT_EQ(back.advertisement.position.x, -3.5);
  EXPECT_EQ(back.advertisement.position.y, 4.5);
  EXPECT_EQ(back.advertisement.range_m, std::numeric_limits<double>::infinity());
  EXPECT_EQ(back.text, "stop");
  ASSERT_EQ(back.objects.size(), 2U);
  EXPECT_EQ(back.objects[0].label, "person");
  EXPECT_EQ(back.objects[1].label, "car");
  EXPECT_EQ(back.objects[1].score, 0.5F);
  EXPECT_EQ(back.objects[1].x1, -1.0F);
  EXPECT_EQ(back.objects[1].y2, 8.0F);
  EXPECT_EQ(back.model, "ssd");
  EXPECT_EQ(back.confidence, 0.875F);
  EXPECT_TRUE(back.accepted);
}

TEST(WireMessage, LayoutStaysAsItIs)
{
  const auto request = encode(someRequest());
  ASSERT_EQ(request.size(), 74U + 5U + 7U + 4U);
  EXPECT_EQ(std::string(request.begin(), request.begin() + 4), "PIRQ");
  EXPECT_EQ(request[4], WIRE_VERSION);
  EXPECT_EQ(request[6], 2);      // TASK
  EXPECT_EQ(request[7], 1);      // SPEECH
  EXPECT_EQ(request[8], 0xf0);   // lowest byte first
  EXPECT_EQ(request[16], 0xfb);  // sent_ns
  EXPECT_EQ(request[54], 0xe8);  // speech_s
  EXPECT_EQ(request[56], 5);     // S16LE
  EXPECT_EQ(request[57], 5);     // letters of the vehicle
  EXPECT_EQ(request[58], 640 % 256);
  EXPECT_EQ(request[74], 'c');
  const auto reply = encode(someReply());
  ASSERT_EQ(reply.size(), 168U + 2U * 24U + 4U + 3U + (4U + 3U) + (4U + 6U));
  EXPECT_EQ(reply[164], 2);  // labels: car, person
  EXPECT_EQ(reply[168], 1);  // the first object is a person
  EXPECT_EQ(std::string(reply.begin(), reply.begin() + 4), "PIRP");
  EXPECT_EQ(reply[6], 2);
  EXPECT_EQ(reply[8], 77);
  EXPECT_EQ(reply[18], 7);  // draining, position, first kind served
}

TEST(WireMessage, NamesWhatIsWrong)
{
  const auto good = encode(someRequest());
  const auto decodeChanged = [&](size_t at, std::initializer_list<uint8_t> values)
  {
    auto bytes = good;
    std::copy(values.begin(), values.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
    return messageOf<WireError>([&] { decodeRequest(bytes.data(), bytes.size()); });
  };
  EXPECT_EQ(decodeChanged(0, {'X'}), "request: no message of this kind (90 bytes)");
  EXPECT_EQ(decodeChanged(4, {9}), "request: version 9, this is version 2");
  EXPECT_EQ(decodeChanged(6, {4}), "request: 'type' = 4, must be in [1, 3]");
  EXPECT_EQ(decodeChanged(7, {2}), "request: 'kind' = 2, must be at most 1");
  EXPECT_EQ(decodeChanged(56, {6}), "request: 'encoding' = 6, must be at most 5");
  EXPECT_EQ(decodeChanged(70, {255, 255, 255, 1}), "request: 'payload' takes 33554431 bytes, 4 are left");
  EXPECT_EQ(decodeChanged(70, {255, 255, 255, 255}),
            "request: 'payload length' = 4294967295, must be at most 33554432");
  EXPECT_EQ(decodeChanged(70, {3}), "request: 1 bytes behind its end");
  EXPECT_NE(decodeChanged(74, {'\n'}).find("'vehicle' has a character of code 10"), std::string::npos);
  EXPECT_NE(decodeChanged(30, {0xf8, 0x7f}).find("'remaining_s' = nan"), std::string::npos);
  EXPECT_NE(decodeChanged(38, {0xf0, 0xbf}).find("'lease_rate_hz'"), std::string::npos);
  EXPECT_NE(decodeChanged(54, {0xe8, 0xbf}).find("'speech_s' = -0.75"), std::string::npos);
  EXPECT_EQ(messageOf<WireError>([&] { decodeRequest(nullptr, 0); }), "request: no message of this kind (0 bytes)");
  const auto reply = encode(someReply());
  EXPECT_EQ(messageOf<WireError>([&] { decodeRequest(reply.data(), reply.size()); }),
            "request: no message of this kind (" + std::to_string(reply.size()) + " bytes)");
  EXPECT_NE(messageOf<WireError>([&] { decodeReply(good.data(), good.size()); }), "");
}

TEST(WireMessage, RefusesToSendWhatCannotBeReceived)
{
  const auto encodeChanged = [](const std::function<void(OffloadRequest&)>& change)
  {
    OffloadRequest request = someRequest();
    change(request);
    return messageOf<std::invalid_argument>([&] { encode(request); });
  };
  EXPECT_EQ(encodeChanged([](OffloadRequest&) {}), "");
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.vehicle = ""; }).find("request/vehicle"), std::string::npos);
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.vehicle.assign(65, 'a'); }), "");
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.vehicle = "a b"; }), "");
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.remaining_s = INFINITY; }).find("remaining_s"), std::string::npos);
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.lease_rate_hz[1] = -1.0; }).find("lease_rate_hz"),
            std::string::npos);
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.speech_s = NAN; }).find("speech_s"), std::string::npos);
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.payload.resize(MAX_PAYLOAD + 1); }).find("payload"),
            std::string::npos);
  EXPECT_NE(encodeChanged([](OffloadRequest& r) { r.options.resize(100000); }).find("options"), std::string::npos);
  OffloadReply reply = someReply();
  reply.queue_s = NAN;
  EXPECT_NE(messageOf<std::invalid_argument>([&] { encode(reply); }).find("queue_s"), std::string::npos);
  reply = someReply();
  reply.text.assign(10000, 'x');  // the text of an error is cut, never a reason to fail
  const auto bytes = encode(reply);
  EXPECT_EQ(decodeReply(bytes.data(), bytes.size()).text.size(), 4096U);
}

TEST(WireMessage, LabelsAreBoundedAndThere)
{
  OffloadReply reply = someReply();
  reply.objects[0].label.assign(257, 'x');
  EXPECT_NE(messageOf<std::invalid_argument>([&] { encode(reply); }).find("label"), std::string::npos);
  reply.objects.resize(1025, reply.objects[1]);
  for (size_t i = 0; i < reply.objects.size(); ++i)
  {
    reply.objects[i].label = std::to_string(i);
  }
  EXPECT_NE(messageOf<std::invalid_argument>([&] { encode(reply); }).find("1024 classes"), std::string::npos);
  auto bytes = encode(someReply());
  bytes[168] = 2;
  EXPECT_EQ(messageOf<WireError>([&] { decodeReply(bytes.data(), bytes.size()); }), "reply: 'label' = 2, there are 2");
  bytes[168] = 0;  // both objects are cars, nothing is a person
  EXPECT_EQ(messageOf<WireError>([&] { decodeReply(bytes.data(), bytes.size()); }),
            "reply: labels must be in the order of their letters, each of an object");
}

TEST(WireMessage, EveryShorterMessageIsAnError)
{
  const auto request = encode(someRequest());
  const auto reply = encode(someReply());
  for (size_t size = 0; size < request.size(); ++size)
  {
    // A copy of its own, so that reading beyond the end is seen by the sanitizer.
    const std::vector<uint8_t> shorter(request.begin(), request.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THROW(decodeRequest(shorter.data(), shorter.size()), WireError) << size;
  }
  for (size_t size = 0; size < reply.size(); ++size)
  {
    const std::vector<uint8_t> shorter(reply.begin(), reply.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THROW(decodeReply(shorter.data(), shorter.size()), WireError) << size;
  }
}

TEST(WireMessage, RandomBytesAreDecodedOrRefused)
{
  std::mt19937 random(5);
  const auto request = encode(someRequest());
  const auto reply = encode(someReply());
  int decoded = 0;
  int refused = 0;
  const auto attempt = [&](const std::function<void()>& decode)
  {
    try
    {
      decode();
      ++decoded;
    }
    catch (const WireError& error)
    {
      EXPECT_STRNE(error.what(), "");
      ++refused;
    }
  };
  for (int round = 0; round < 40000; ++round)
  {
    for (const bool of_request : {true, false})
    {
      std::vector<uint8_t> bytes = of_request ? request : reply;
      if (round % 4 == 0)
      {
        bytes.resize(random() % 300);
        std::generate(bytes.begin() + static_cast<std::ptrdiff_t>(std::min<size_t>(6, bytes.size())), bytes.end(),
                      [&] { return static_cast<uint8_t>(random()); });
      }
      for (unsigned changes = random() % 4; changes > 0 && !bytes.empty(); --changes)
      {
        bytes[random() % bytes.size()] = static_cast<uint8_t>(random());
      }
      bytes.shrink_to_fit();
      if (of_request)
      {
        attempt(
            [&]
            {
              // What was understood can be sent on.
              const OffloadRequest back = decodeRequest(bytes.data(), bytes.size());
              EXPECT_EQ(encode(back).size(), bytes.size());
            });
      }
      else
      {
        attempt(
            [&]
            {
              const OffloadReply back = decodeReply(bytes.data(), bytes.size());
              EXPECT_EQ(encode(back), bytes);
            });
      }
    }
  }
  EXPECT_GT(decoded, 10000);
  EXPECT_GT(refused, 10000);
}
