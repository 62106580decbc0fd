#include "wire/lane.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace pi_os_transport
{
namespace
{

using std::chrono::microseconds;

/// The window of BULK shrinks if it adds more delay than this to the round trip.
constexpr microseconds TARGET_DELAY{1000};
/// It grows if it adds less.
constexpr microseconds SHORT_DELAY{750};
/// The shortest round trip is measured again after this time: the route may have changed.
constexpr std::chrono::seconds BASE_AGE{5};

constexpr uint32_t MIN_FRAGMENT = 8 << 10;
constexpr uint32_t MAX_FRAGMENT = 128 << 10;
constexpr uint32_t EXPRESS_FRAGMENT = 16 << 10;
constexpr uint64_t FRAGMENTS_PER_WINDOW = 3;
/// Acknowledgements requested per window: enough that the sender never waits for one.
constexpr uint64_t REQUESTS_PER_WINDOW = 3;
/// Frames of EXPRESS after which an acknowledgement is requested: a publisher keeps at most 256 messages until then.
constexpr uint64_t FRAMES_PER_REQUEST = 64;

}  // namespace

void Lane::reset()
{
  connection_ = 0;
  connected_ = false;
  unacked_.clear();
  unacked_bytes_ = 0;
  acked_frames_ = 0;
  since_request_ = 0;
  frames_since_request_ = 0;
  uncounted_payload_.reset();
  window_ = INITIAL_WINDOW;
  limited_ = false;
  probing_ = false;
  single_ = false;
  more_ = false;
  round_min_ = microseconds::max();
  network_base_ = microseconds::max();
}

bool Lane::ready() const
{
  const uint64_t window = traffic_ == Traffic::EXPRESS ? EXPRESS_WINDOW : (probing_ ? 1 : window_);
  return connected_ && unacked_bytes_ < window && transport_->writable(connection_);
}

uint32_t Lane::fragmentBytes() const
{
  if (traffic_ == Traffic::EXPRESS)
  {
    return EXPRESS_FRAGMENT;
  }
  return static_cast<uint32_t>(std::clamp<uint64_t>(window_ / FRAGMENTS_PER_WINDOW, MIN_FRAGMENT, MAX_FRAGMENT));
}

bool Lane::send(const FrameHeader& header, const iovec* payload, size_t pieces, std::shared_ptr<const void> keep,
                Acknowledged acknowledged, bool more)
{
  uint64_t bytes = FrameHeader::BYTES;
  for (size_t piece = 0; piece < pieces; ++piece)
  {
    bytes += payload[piece].iov_len;
  }
  FrameHeader labelled = header;
  labelled.lane = static_cast<uint32_t>(traffic_);
  const bool request = traffic_ == Traffic::BULK
                           ? probing_ || since_request_ + bytes >= window_ / REQUESTS_PER_WINDOW
                           : isCounted(header.type) && ++frames_since_request_ >= FRAMES_PER_REQUEST;
  labelled.lane |= request ? ACK_NOW : 0;
  if (!connected_ || !transport_->send(connection_, labelled, payload, pieces, more))
  {
    return false;
  }
  sent_bytes_ += bytes;
  if (isCounted(header.type))
  {
    unacked_.push_back(Unacked{now_(), bytes, std::move(keep), std::move(acknowledged)});
    single_ = unacked_bytes_ == 0 || (single_ && more_);
    more_ = more;
    unacked_bytes_ += bytes;
    since_request_ = request ? 0 : since_request_ + bytes;
    frames_since_request_ = request ? 0 : frames_since_request_;
    limited_ = limited_ || unacked_bytes_ >= window_;
  }
  else
  {
    uncounted_payload_ = std::move(keep);
  }
  return true;
}

bool Lane::onAck(uint64_t frames)
{
  if (frames < acked_frames_ || frames - acked_frames_ > unacked_.size())
  {
    return false;
  }
  if (frames == acked_frames_)
  {
    return true;
  }
  const SteadyTime now = now_();
  microseconds newest{0};
  while (acked_frames_ != frames)
  {
    const Unacked done = std::move(unacked_.front());
    unacked_.pop_front();
    ++acked_frames_;
    unacked_bytes_ -= done.bytes;
    newest = std::chrono::duration_cast<microseconds>(now - done.sent_at);
    if (done.acknowledged)
    {
      done.acknowledged();
    }
  }
  adapt(now, newest);
  return true;
}

void Lane::adapt(SteadyTime now, microseconds sample)
{
  rtt_ = rtt_.count() == 0 ? sample : (rtt_ * 7 + sample) / 8;
  if (traffic_ != Traffic::BULK)
  {
    return;
  }
  if (probing_ && unacked_bytes_ == 0 && single_)
  {
    probing_ = false;
    base_rtt_ = sample;
    base_until_ = now + BASE_AGE;
  }
  else if (!probing_ && now >= base_until_)
  {
    // Our own frames may have kept the link full since the last measurement.
    probing_ = true;
    single_ = false;
  }
  base_rtt_ = std::min(base_rtt_, sample);
  round_min_ = std::min(round_min_, sample);
  if (now < round_end_)
  {
    return;
  }
  // Once per round trip, by its shortest sample: longer ones may include the time that a process waited for a core.
  const microseconds delay = round_min_ - base_rtt_;
  const std::optional<microseconds> network = transport_->roundTrip(connection_);
  network_base_ = std::min(network_base_, network.value_or(microseconds::max()));
  if (delay > TARGET_DELAY)
  {
    // A smaller window does not help against bridges that wait for a core.
    const microseconds queues = network ? std::min(delay, *network - network_base_) : delay;
    const double factor =
        std::clamp(static_cast<double>(TARGET_DELAY.count()) / static_cast<double>(queues.count() + 1), 0.25, 1.0);
    window_ = std::max(MIN_WINDOW, static_cast<uint64_t>(static_cast<double>(window_) * factor));
  }
  else if (limited_ && delay < SHORT_DELAY)
  {
    window_ = std::min(MAX_WINDOW, window_ + window_ / 2);
  }
  limited_ = unacked_bytes_ >= window_;
  round_min_ = microseconds::max();
  round_end_ = now + sample;
}

}  // namespace pi_os_transport
