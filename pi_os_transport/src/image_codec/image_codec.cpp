#include "image_codec/image_codec.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

/// Arguments of posix_spawn(); freed by the destructor.
struct SpawnOptions
{
  SpawnOptions()
  {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
  }
  ~SpawnOptions()
  {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnOptions(const SpawnOptions&) = delete;
  SpawnOptions& operator=(const SpawnOptions&) = delete;

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
};

std::string describeEnd(int status)
{
  return WIFSIGNALED(status) ? "signal " + std::to_string(WTERMSIG(status))
                             : "exit status " + std::to_string(WEXITSTATUS(status));
}

}  // namespace

std::array<uint8_t, CodecHeader::BYTES> CodecHeader::encode() const
{
  std::array<uint8_t, BYTES> bytes{};
  storeLittleEndian<uint32_t>(&bytes[0], kind);
  storeLittleEndian<uint32_t>(&bytes[4], parameter);
  storeLittleEndian<uint64_t>(&bytes[8], id);
  storeLittleEndian<uint64_t>(&bytes[16], length);
  return bytes;
}

CodecHeader CodecHeader::decode(const uint8_t* bytes)
{
  CodecHeader header;
  header.kind = loadLittleEndian<uint32_t>(bytes);
  header.parameter = loadLittleEndian<uint32_t>(bytes + 4);
  header.id = loadLittleEndian<uint64_t>(bytes + 8);
  header.length = loadLittleEndian<uint64_t>(bytes + 16);
  return header;
}

ImageCodec::ImageCodec(EventLoop* loop, Options options) : loop_(loop), options_(std::move(options)) {}

ImageCodec::~ImageCodec()
{
  endWorker();
}

bool ImageCodec::encode(Compression compression, int quality, const uint8_t* data, size_t length, Callback done)
{
  return add(compression == Compression::JPEG ? CodecHeader::ENCODE_JPEG : CodecHeader::ENCODE_PNG,
             static_cast<uint32_t>(quality), data, length, std::move(done));
}

bool ImageCodec::decode(const uint8_t* data, size_t length, Callback done)
{
  return add(CodecHeader::DECODE, 0, data, length, std::move(done));
}

bool ImageCodec::add(uint32_t kind, uint32_t parameter, const uint8_t* data, size_t length, Callback done)
{
  if (requests_.size() >= options_.queue_limit || length > options_.max_bytes)
  {
    return false;
  }
  CodecHeader header;
  header.kind = kind;
  header.parameter = parameter;
  header.id = next_id_++;
  header.length = length;
  requests_.push_back({header, data, std::move(done)});
  if (!working_)
  {
    wakeLater();
  }
  return true;
}

void ImageCodec::wakeLater()
{
  if (!requests_.empty() && !wake_timer_.running())
  {
    wake_timer_.start(loop_, not_before_, [this] { begin(); });
  }
}

void ImageCodec::begin()
{
  if (working_ || requests_.empty())
  {
    return;
  }
  std::string error;
  if (worker_ < 0 && !startWorker(&error))
  {
    not_before_ = SteadyClock::now() + options_.pause;
    complete(Result::FAILED, {}, error);
    return;
  }
  working_ = true;
  request_header_ = requests_.front().header.encode();
  sent_ = received_ = 0;
  deadline_timer_.start(
      loop_, options_.timeout,
      [this]
      { abandonWorker("the image codec was not done within " + std::to_string(options_.timeout.count()) + " ms"); });
  loop_->change(socket_.get(), EPOLLIN | EPOLLOUT);
}

bool ImageCodec::startWorker(std::string* error)
{
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
  {
    *error = std::string("no socket for the image codec: ") + std::strerror(errno);
    return false;
  }
  FileDescriptor ours(ends[0]);
  const FileDescriptor theirs(ends[1]);
  fcntl(ours.get(), F_SETFL, O_NONBLOCK);

  SpawnOptions spawn;
  posix_spawn_file_actions_adddup2(&spawn.actions, theirs.get(), CODEC_SOCKET);
  sigset_t signals;
  sigemptyset(&signals);
  posix_spawnattr_setsigmask(&spawn.attributes, &signals);
  sigfillset(&signals);
  posix_spawnattr_setsigdefault(&spawn.attributes, &signals);
  // Its own process group: Ctrl-C in the bridge's terminal must not end the worker before the bridge has drained.
  posix_spawnattr_setpgroup(&spawn.attributes, 0);
  posix_spawnattr_setflags(&spawn.attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  std::string program = options_.program;
  std::string max_bytes = std::to_string(options_.max_bytes);
  char* const arguments[] = {program.data(), max_bytes.data(), nullptr};
  pid_t child = -1;
  // Not fork(): the fork handlers would close the socket, and fork() copies page tables.
  const int failure = posix_spawn(&child, program.c_str(), &spawn.actions, &spawn.attributes, arguments, environ);
  if (failure != 0)
  {
    *error = "cannot start the image codec " + program + ": " + std::strerror(failure);
    return false;
  }
  worker_ = child;
  socket_ = std::move(ours);
  loop_->add(socket_.get(), EPOLLIN, [this](uint32_t events) { onReady(events); });
  return true;
}

void ImageCodec::endWorker()
{
  deadline_timer_.stop();
  working_ = false;
  if (worker_ < 0)
  {
    return;
  }
  loop_->remove(socket_.get());
  socket_.reset();
  // The process is killed, so this wait is short.
  kill(worker_, SIGKILL);
  while (waitpid(worker_, nullptr, 0) < 0 && errno == EINTR)
  {
  }
  worker_ = -1;
}

void ImageCodec::onReady(uint32_t events)
{
  if ((events & EPOLLIN) != 0 && !receive())
  {
    return;  // the worker was replaced, or the answer is complete
  }
  if ((events & EPOLLOUT) != 0 && working_ && !send())
  {
    return;
  }
  if ((events & (EPOLLHUP | EPOLLERR)) != 0 && (events & EPOLLIN) == 0)
  {
    abandonWorker("the image codec has ended");
  }
}

bool ImageCodec::send()
{
  const Request& request = requests_.front();
  const size_t total = CodecHeader::BYTES + request.header.length;
  while (sent_ < total)
  {
    const size_t header_sent = std::min(sent_, CodecHeader::BYTES);
    const size_t data_sent = sent_ - header_sent;
    iovec parts[2] = {{request_header_.data() + header_sent, CodecHeader::BYTES - header_sent},
                      {const_cast<uint8_t*>(request.data) + data_sent, request.header.length - data_sent}};
    msghdr message{};
    message.msg_iov = parts;
    message.msg_iovlen = 2;
    const ssize_t sent = sendmsg(socket_.get(), &message, MSG_NOSIGNAL);
    if (sent < 0)
    {
      if (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)
      {
        return true;
      }
      abandonWorker("the image codec has ended");
      return false;
    }
    sent_ += static_cast<size_t>(sent);
  }
  loop_->change(socket_.get(), EPOLLIN);
  return true;
}

bool ImageCodec::receive()
{
  for (;;)
  {
    const bool in_header = received_ < CodecHeader::BYTES;
    uint8_t* const target =
        in_header ? answer_header_.data() + received_ : answer_data_.data() + (received_ - CodecHeader::BYTES);
    const size_t wanted =
        in_header ? CodecHeader::BYTES - received_ : answer_data_.size() - (received_ - CodecHeader::BYTES);
    const ssize_t received = recv(socket_.get(), target, wanted, 0);
    if (received < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR))
    {
      return true;
    }
    if (received <= 0)
    {
      abandonWorker("the image codec has ended");
      return false;
    }
    received_ += static_cast<size_t>(received);
    if (received_ == CodecHeader::BYTES)
    {
      answer_ = CodecHeader::decode(answer_header_.data());
      const bool known = answer_.kind >= CodecHeader::CONVERTED && answer_.kind <= CodecHeader::BAD_DATA;
      const uint64_t limit = answer_.kind == CodecHeader::CONVERTED ? options_.max_bytes : MAX_CODEC_TEXT;
      if (!working_ || !known || answer_.id != requests_.front().header.id || answer_.length > limit ||
          sent_ < CodecHeader::BYTES + requests_.front().header.length)
      {
        abandonWorker("the image codec gave an answer that makes no sense");
        return false;
      }
      answer_data_.resize(answer_.length);
    }
    if (received_ >= CodecHeader::BYTES && received_ - CodecHeader::BYTES == answer_data_.size())
    {
      return finishAnswer();
    }
  }
}

/// @return false: the socket must not be used again in this round
bool ImageCodec::finishAnswer()
{
  working_ = false;
  received_ = 0;
  deadline_timer_.stop();
  std::vector<uint8_t> data = std::exchange(answer_data_, {});
  if (answer_.kind == CodecHeader::CONVERTED)
  {
    complete(Result::CONVERTED, std::move(data), "");
  }
  else
  {
    // The text is logged: remove control characters.
    std::string text(data.begin(), data.end());
    std::replace_if(
        text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c >= 0x7f; }, '?');
    complete(answer_.kind == CodecHeader::UNSUPPORTED ? Result::UNSUPPORTED : Result::BAD_DATA, {}, text);
  }
  return false;
}

void ImageCodec::abandonWorker(const std::string& detail)
{
  std::string cause = detail;
  int status = 0;
  if (worker_ > 0 && waitpid(worker_, &status, WNOHANG) == worker_)
  {
    worker_ = -1;
    loop_->remove(socket_.get());
    socket_.reset();
    cause += ", " + describeEnd(status);
  }
  const bool was_working = working_;
  endWorker();
  not_before_ = SteadyClock::now() + options_.pause;
  answer_data_ = {};
  received_ = 0;
  if (was_working)
  {
    complete(Result::FAILED, {}, cause);
  }
  else
  {
    wakeLater();
  }
}

void ImageCodec::complete(Result result, std::vector<uint8_t> message, const std::string& detail)
{
  Request request = std::move(requests_.front());
  requests_.pop_front();
  wakeLater();
  request.done(result, std::move(message), detail);
}

}  // namespace pi_os_transport
