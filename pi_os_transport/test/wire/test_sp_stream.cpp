#include "pi_os_transport/sp_stream.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <array>
#include <string>
#include <vector>

#include "shm/file_descriptor.h"

namespace pi_os_transport
{
namespace
{

using End = SpReader::End;
using Bytes = std::vector<uint8_t>;

/// Two connected sockets.
struct Line
{
  Line()
  {
    int ends[2] = {-1, -1};
    EXPECT_EQ(0, socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends));
    here = FileDescriptor(ends[0]);
    there = FileDescriptor(ends[1]);
  }
  void write(const Bytes& bytes) const
  {
    EXPECT_EQ(static_cast<ssize_t>(bytes.size()), send(there.get(), bytes.data(), bytes.size(), 0));
  }
  FileDescriptor here;
  FileDescriptor there;
};

Bytes lengthOf(uint64_t length)
{
  Bytes bytes(SP_LENGTH_BYTES);
  storeBigEndian(bytes.data(), length);
  return bytes;
}

/// Collects messages, in places of a given size.
struct Collector : SpReader::Sink
{
  bool onLength(uint64_t length) override
  {
    message.clear();
    return length <= most_bytes;
  }
  iovec place(size_t missing) override
  {
    const size_t received = message.size();
    message.resize(received + std::min(missing, place_bytes));
    return {message.data() + received, message.size() - received};
  }
  bool onMessage() override
  {
    messages.push_back(message);
    return messages.size() != refused_message;
  }

  size_t most_bytes = 1000000;
  size_t place_bytes = 1000000;
  size_t refused_message = 0;
  Bytes message;
  std::vector<Bytes> messages;
};

SpReader::Result receive(const Line& line, SpReader* reader, Collector* sink, size_t budget = 1000000)
{
  std::array<uint8_t, 256> scratch;
  return reader->receive(SpSocket{line.here.get()}, scratch.data(), scratch.size(), budget, sink);
}

const Bytes REQ_HEADER{0, 'S', 'P', 0, 0, 48, 0, 0};

}  // namespace

TEST(SpStream, NumbersBeginWithTheHighestByte)
{
  std::array<uint8_t, 4> bytes;
  storeBigEndian<uint32_t>(bytes.data(), 0x01020384U);
  EXPECT_EQ((std::array<uint8_t, 4>{1, 2, 3, 0x84}), bytes);
  EXPECT_EQ(0x01020384U, loadBigEndian<uint32_t>(bytes.data()));
}

TEST(SpStream, TheHeaderIsThatOfNanomsg)
{
  const Line line;
  EXPECT_EQ(0, sendSpHeader(SpSocket{line.there.get()}, SpType::REQ));
  Bytes sent(REQ_HEADER.size());
  EXPECT_EQ(8, recv(line.here.get(), sent.data(), sent.size(), MSG_DONTWAIT));
  EXPECT_EQ(REQ_HEADER, sent);
}

TEST(SpStream, MessagesOfAnySizeArriveInPlacesOfAnySize)
{
  for (const size_t place_bytes : {size_t{1}, size_t{7}, size_t{1000000}})
  {
    const Line line;
    Collector sink;
    sink.place_bytes = place_bytes;
    SpReader reader(SpType::REQ, SP_LENGTH_BYTES);
    line.write(REQ_HEADER);
    std::vector<Bytes> expected;
    for (const size_t size : {size_t{0}, size_t{1}, size_t{255}, size_t{16384}, size_t{0}, size_t{40000}, size_t{3}})
    {
      expected.emplace_back(size, static_cast<uint8_t>(size + 1));
      line.write(lengthOf(size));
      line.write(expected.back());
    }
    EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
    EXPECT_EQ(expected, sink.messages);
    EXPECT_TRUE(reader.betweenMessages());
  }
}

TEST(SpStream, AnUnfinishedMessageIsNoMessage)
{
  const Line line;
  Collector sink;
  SpReader reader(SpType::REQ, SP_LENGTH_BYTES);
  EXPECT_FALSE(reader.betweenMessages());
  line.write(REQ_HEADER);
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
  EXPECT_TRUE(reader.greeted() && reader.betweenMessages());
  line.write({0});
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
  EXPECT_FALSE(reader.betweenMessages());
  line.write({0, 0, 0, 0, 0, 0, 2, 'a'});
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
  EXPECT_TRUE(sink.messages.empty());
  line.write({'b'});
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
  EXPECT_EQ((std::vector<Bytes>{{'a', 'b'}}), sink.messages);
}

TEST(SpStream, TellsHowAConnectionEnds)
{
  const auto endAfter = [](const Bytes& bytes, Collector sink)
  {
    Line line;
    SpReader reader(SpType::REQ, SP_LENGTH_BYTES);
    line.write(bytes);
    line.there.reset();
    End end = End::NONE;
    while (end == End::NONE)
    {
      end = receive(line, &reader, &sink).end;
    }
    return end;
  };
  Bytes message = REQ_HEADER;
  message.insert(message.end(), {0, 0, 0, 0, 0, 0, 0, 2, 'a', 'b'});
  EXPECT_EQ(End::CLOSED, endAfter(message, Collector()));
  EXPECT_EQ(End::NO_PEER, endAfter({'G', 'E', 'T', ' '}, Collector()));
  EXPECT_EQ(End::NO_PEER, endAfter({0, 'S', 'P', 0, 0, 49, 0, 0}, Collector()));
  Collector narrow;
  narrow.most_bytes = 1;
  EXPECT_EQ(End::REFUSED, endAfter(message, narrow));
  Collector without_place;
  without_place.place_bytes = 0;
  EXPECT_EQ(End::REFUSED, endAfter(message, without_place));
  Collector unwilling;
  unwilling.refused_message = 1;
  EXPECT_EQ(End::REFUSED, endAfter(message, unwilling));
}

TEST(SpStream, ReadsNoMoreThanItsBudgetByMuch)
{
  const Line line;
  Collector sink;
  SpReader reader(SpType::REQ, SP_LENGTH_BYTES);
  line.write(REQ_HEADER);
  line.write(lengthOf(60000));
  line.write(Bytes(60000));
  sink.place_bytes = 1000;
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink, 5000).end);
  EXPECT_TRUE(sink.messages.empty());
  EXPECT_LT(sink.message.size(), 8000U);
  EXPECT_EQ(End::NONE, receive(line, &reader, &sink).end);
  EXPECT_EQ(1U, sink.messages.size());
}

TEST(SpStream, WhatTheSocketDoesNotTakeIsSentLater)
{
  const Line line;
  Collector sink;
  SpReader reader(SpType::REQ, SP_LENGTH_BYTES);
  line.write(REQ_HEADER);
  Bytes length = lengthOf(2000000);
  Bytes body(2000000);
  for (size_t byte = 0; byte < body.size(); ++byte)
  {
    body[byte] = static_cast<uint8_t>(byte * 2654435761U >> 24U);
  }
  const std::array<iovec, 3> pieces{
      {{length.data(), length.size()}, {body.data(), 5}, {body.data() + 5, body.size() - 5}}};
  SpWriter writer;
  EXPECT_EQ(0U, writer.unsentBytes());
  sink.most_bytes = body.size();
  ASSERT_EQ(0, writer.begin(SpSocket{line.there.get()}, pieces.data(), pieces.size()));
  EXPECT_FALSE(writer.idle());
  EXPECT_GT(writer.unsentBytes(), 0U);
  while (!writer.idle())
  {
    ASSERT_EQ(End::NONE, receive(line, &reader, &sink).end);
    ASSERT_EQ(0, writer.resume(SpSocket{line.there.get()}));
  }
  while (sink.messages.empty())
  {
    ASSERT_EQ(End::NONE, receive(line, &reader, &sink).end);
  }
  EXPECT_TRUE(sink.messages.front() == body);
}

TEST(SpStream, AWriterTellsThatNobodyReads)
{
  Line line;
  line.here.reset();
  Bytes length = lengthOf(0);
  const iovec piece{length.data(), length.size()};
  SpWriter writer;
  EXPECT_EQ(EPIPE, writer.begin(SpSocket{line.there.get()}, &piece, 1));
}

}  // namespace pi_os_transport
