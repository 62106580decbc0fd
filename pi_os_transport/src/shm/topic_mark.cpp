#include "shm/topic_mark.h"

#include <array>
#include <cstddef>
#include <cstring>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

uint64_t rotate(uint64_t value, int bits)
{
  return value << bits | value >> (64 - bits);
}

/// State and round of SipHash (Aumasson and Bernstein 2012, section 2).
struct SipState
{
  uint64_t v0, v1, v2, v3;

  void round()
  {
    v0 += v1;
    v2 += v3;
    v1 = rotate(v1, 13) ^ v0;
    v3 = rotate(v3, 16) ^ v2;
    v0 = rotate(v0, 32) + v3;
    v2 += v1;
    v3 = rotate(v3, 21) ^ v0;
    v1 = rotate(v1, 17) ^ v2;
    v2 = rotate(v2, 32);
  }
  void compress(uint64_t word)
  {
    v3 ^= word;
    round();
    round();
    v0 ^= word;
  }
};

}  // namespace

uint64_t topicMark(const Token& link, std::string_view topic)
{
  SipState state{link.low ^ 0x736f6d6570736575, link.high ^ 0x646f72616e646f6d, link.low ^ 0x6c7967656e657261,
                 link.high ^ 0x7465646279746573};
  const uint64_t length = topic.size();
  std::array<uint8_t, sizeof(uint64_t)> word{};
  for (; topic.size() >= word.size(); topic.remove_prefix(word.size()))
  {
    std::memcpy(word.data(), topic.data(), word.size());
    state.compress(loadLittleEndian<uint64_t>(word.data()));
  }
  word.fill(0);
  topic.copy(reinterpret_cast<char*>(word.data()), topic.size());
  state.compress(loadLittleEndian<uint64_t>(word.data()) | length << 56);
  state.v2 ^= 0xff;
  for (int turn = 0; turn < 4; ++turn)
  {
    state.round();
  }
  const uint64_t mark = state.v0 ^ state.v1 ^ state.v2 ^ state.v3;
  return mark != 0 ? mark : 1;
}

}  // namespace pi_os_transport
