#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace pi_os_transport
{

/// Largest message. ROS's own master has no limit; a robot description has some megabytes.
struct HttpLimits
{
  size_t head_bytes = 16 * 1024;         ///< first line and headers, also of chunks
  size_t body_bytes = 64 * 1024 * 1024;  ///< memory is allocated for received bytes, not for announced ones
};

// Own HTTP and XML-RPC: all of pi_core takes 3.2 MB (bar: 4 MB), and XmlRpc++ has no limits per client (ros_master.md).

/// Parses an HTTP/1.1 message as it is received. The body has a length, comes in chunks or, in an answer, extends to
/// the end of the connection.
class HttpReader
{
public:
  enum class Kind
  {
    REQUEST,
    RESPONSE,
  };
  enum class State
  {
    READING,
    DONE,
    FAILED,  ///< see status() and problem(); the connection is unusable
  };

  explicit HttpReader(Kind kind, const HttpLimits& limits = HttpLimits()) : kind_(kind), limits_(limits) {}

  /// @return number of bytes that belong to this message. A rest, only in state DONE, belongs to the next message.
  size_t feed(std::string_view bytes);
  /// The connection has ended, which completes some answers.
  void feedEnd();

  State state() const { return state_; }
  bool hasBegun() const { return head_size_ != 0; }
  bool hasHead() const { return step_ > Step::HEADERS; }
  const std::string& method() const { return method_; }
  const std::string& target() const { return target_; }
  /// The status of an answer; for a failed request the status to answer with.
  int status() const { return status_; }
  const std::string& problem() const { return problem_; }
  bool keepsAlive() const { return keeps_alive_; }
  /// The sender waits for "100 Continue" before it sends the body.
  bool expectsContinue() const { return expects_continue_; }
  const std::string& body() const { return body_; }
  /// Prepares for the next message.
  void reset() { *this = HttpReader(kind_, limits_); }

private:
  enum class Step
  {
    FIRST_LINE,
    HEADERS,
    BODY,
    BODY_TO_END,
    CHUNK_SIZE,
    CHUNK,
    CHUNK_END,
    TRAILER,
  };
  void takeLine(std::string_view line);
  void takeFirstLine(std::string_view line);
  void takeHeader(std::string_view line);
  void endHead();
  void takeChunkSize(std::string_view line);
  void appendBody(std::string_view bytes);
  void fail(int status, const std::string& problem);

  Kind kind_;
  HttpLimits limits_;
  State state_ = State::READING;
  Step step_ = Step::FIRST_LINE;
  std::string line_;
  size_t head_size_ = 0;
  std::string method_;
  std::string target_;
  int status_ = 0;
  bool keeps_alive_ = true;
  bool expects_continue_ = false;
  bool has_length_ = false;
  bool is_chunked_ = false;
  uint64_t left_ = 0;  ///< bytes of the body or of the chunk
  std::string body_;
  std::string problem_;
};

}  // namespace pi_os_transport
