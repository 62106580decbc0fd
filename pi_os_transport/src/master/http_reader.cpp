#include "master/http_reader.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <system_error>

#include "text_parsing.h"

namespace pi_os_transport
{
namespace
{

constexpr int BAD_REQUEST = 400;
constexpr int LENGTH_REQUIRED = 411;
constexpr int TOO_LARGE = 413;
constexpr int HEAD_TOO_LARGE = 431;
constexpr std::string_view BLANKS = " \t";

std::string lower(std::string_view text)
{
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::tolower(letter)); });
  return result;
}

bool parse(std::string_view text, int base, uint64_t* number)
{
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *number, base);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

void HttpReader::fail(int status, const std::string& problem)
{
  state_ = State::FAILED;
  status_ = status;
  problem_ = problem;
  keeps_alive_ = false;
  body_ = std::string();
}

size_t HttpReader::feed(std::string_view bytes)
{
  const size_t size = bytes.size();
  while (state_ == State::READING && !bytes.empty())
  {
    if (step_ == Step::BODY || step_ == Step::CHUNK || step_ == Step::BODY_TO_END)
    {
      const size_t part =
          step_ == Step::BODY_TO_END ? bytes.size() : static_cast<size_t>(std::min<uint64_t>(left_, bytes.size()));
      appendBody(bytes.substr(0, part));
      bytes.remove_prefix(part);
      continue;
    }
    const size_t end = bytes.find('\n');
    const size_t part = end == std::string_view::npos ? bytes.size() : end + 1;
    head_size_ += part;
    if (head_size_ > limits_.head_bytes)
    {
      fail(HEAD_TOO_LARGE, "headers of more than " + std::to_string(limits_.head_bytes) + " bytes");
      break;
    }
    line_.append(bytes.substr(0, part));
    bytes.remove_prefix(part);
    if (end != std::string_view::npos)
    {
      line_.pop_back();
      if (!line_.empty() && line_.back() == '\r')
      {
        line_.pop_back();
      }
      const std::string line = std::move(line_);
      line_.clear();
      takeLine(line);
    }
  }
  return size - bytes.size();
}

void HttpReader::feedEnd()
{
  if (state_ == State::READING)
  {
    if (step_ == Step::BODY_TO_END)
    {
      state_ = State::DONE;
    }
    else
    {
      fail(BAD_REQUEST, "the connection ended in the middle of a message");
    }
  }
}

void HttpReader::takeLine(std::string_view line)
{
  switch (step_)
  {
    case Step::FIRST_LINE:
      if (!line.empty())  // some clients send an extra line end after a body
      {
        takeFirstLine(line);
      }
      else
      {
        head_size_ = 0;
      }
      break;
    case Step::HEADERS:
      line.empty() ? endHead() : takeHeader(line);
      break;
    case Step::CHUNK_SIZE:
      takeChunkSize(line);
      break;
    case Step::CHUNK_END:
      head_size_ = 0;
      step_ = Step::CHUNK_SIZE;
      if (!line.empty())
      {
        fail(BAD_REQUEST, "a chunk longer than announced");
      }
      break;
    case Step::TRAILER:
      if (line.empty())
      {
        state_ = State::DONE;
      }
      break;
    case Step::BODY:
    case Step::BODY_TO_END:
    case Step::CHUNK:
      break;  // not lines
  }
}

void HttpReader::takeFirstLine(std::string_view line)
{
  const size_t first = line.find(' ');
  const size_t second = first == std::string_view::npos ? first : line.find(' ', first + 1);
  std::string_view version;
  if (kind_ == Kind::REQUEST && second != std::string_view::npos)
  {
    method_ = line.substr(0, first);
    target_ = line.substr(first + 1, second - first - 1);
    version = line.substr(second + 1);
  }
  else if (kind_ == Kind::RESPONSE && first != std::string_view::npos)
  {
    version = line.substr(0, first);
    uint64_t status = 0;
    const std::string_view number = line.substr(first + 1, 3);
    if (number.size() != 3 || !parse(number, 10, &status))
    {
      version = "";
    }
    status_ = static_cast<int>(status);
  }
  if (version != "HTTP/1.1" && version != "HTTP/1.0")
  {
    fail(BAD_REQUEST, "the first line is not one of HTTP/1.1");
    return;
  }
  keeps_alive_ = version == "HTTP/1.1";
  step_ = Step::HEADERS;
}

void HttpReader::takeHeader(std::string_view line)
{
  const size_t colon = line.find(':');
  if (colon == std::string_view::npos)
  {
    fail(BAD_REQUEST, "a header without a colon");
    return;
  }
  const std::string name = lower(trimmed(line.substr(0, colon), BLANKS));
  const std::string_view value = trimmed(line.substr(colon + 1), BLANKS);
  if (name == "content-length")
  {
    uint64_t length = 0;
    if (!parse(value, 10, &length) || (has_length_ && length != left_))
    {
      fail(BAD_REQUEST, "Content-Length is \"" + std::string(value.substr(0, 40)) + "\"");
      return;
    }
    has_length_ = true;
    left_ = length;
  }
  else if (name == "transfer-encoding")
  {
    is_chunked_ = lower(value) == "chunked";
    if (!is_chunked_ && lower(value) != "identity")
    {
      fail(BAD_REQUEST, "Transfer-Encoding is \"" + std::string(value.substr(0, 40)) + "\", which is not known here");
    }
  }
  else if (name == "content-encoding" && lower(value) != "identity")
  {
    fail(415, "Content-Encoding is \"" + std::string(value.substr(0, 40)) + "\", which is not known here");
  }
  else if (name == "connection")
  {
    keeps_alive_ = lower(value) == "keep-alive" || (keeps_alive_ && lower(value) != "close");
  }
  else if (name == "expect")
  {
    expects_continue_ = lower(value) == "100-continue";
  }
}

void HttpReader::endHead()
{
  if (kind_ == Kind::RESPONSE && status_ >= 100 && status_ < 200)
  {
    step_ = Step::FIRST_LINE;  // the final answer follows
    return;
  }
  if (is_chunked_)
  {
    head_size_ = 0;
    left_ = 0;
    step_ = Step::CHUNK_SIZE;
  }
  else if (has_length_)
  {
    step_ = Step::BODY;
    if (left_ > limits_.body_bytes)
    {
      fail(TOO_LARGE,
           "a body of " + std::to_string(left_) + " bytes, " + std::to_string(limits_.body_bytes) + " are allowed");
    }
    else if (left_ == 0)
    {
      state_ = State::DONE;
    }
  }
  else if (kind_ == Kind::RESPONSE)
  {
    keeps_alive_ = false;
    step_ = Step::BODY_TO_END;
  }
  else if (method_ == "POST")
  {
    fail(LENGTH_REQUIRED, "no Content-Length");
  }
  else
  {
    step_ = Step::BODY;
    state_ = State::DONE;
  }
}

void HttpReader::takeChunkSize(std::string_view line)
{
  if (!parse(trimmed(line.substr(0, line.find(';')), BLANKS), 16, &left_))
  {
    fail(BAD_REQUEST, "a chunk without a size");
    return;
  }
  step_ = left_ == 0 ? Step::TRAILER : Step::CHUNK;
}

void HttpReader::appendBody(std::string_view bytes)
{
  if (body_.size() + bytes.size() > limits_.body_bytes)
  {
    fail(TOO_LARGE, "a body of more than " + std::to_string(limits_.body_bytes) + " bytes");
    return;
  }
  body_.append(bytes);
  if (step_ == Step::BODY_TO_END)
  {
    return;
  }
  left_ -= bytes.size();
  if (left_ == 0 && step_ == Step::BODY)
  {
    state_ = State::DONE;
  }
  else if (left_ == 0)
  {
    step_ = Step::CHUNK_END;
  }
}

}  // namespace pi_os_transport
