#include "sphinx/sphinx_log.h"

#include <sphinxbase/err.h>
#include <unistd.h>

#include <array>
#include <cstdarg>
#include <cstdio>
#include <mutex>

namespace pi_speech
{
namespace
{

constexpr size_t MAX_MESSAGE = 200;
constexpr size_t MAX_LENGTH = 400;

std::string& errorsOfThread()
{
  thread_local std::string errors;
  return errors;
}

/// 'ERROR: "acmod.c", line 83: Folder ...' without what stands before the message, in one line.
std::string message(std::string text)
{
  const size_t place = text.find("\", line ");
  const size_t end = place == std::string::npos ? place : text.find(": ", place);
  if (end != std::string::npos)
  {
    text.erase(0, end + 2);
  }
  for (char& c : text)
  {
    c = c == '\n' ? ' ' : c < ' ' || c > '~' ? '?' : c;  // a damaged file is quoted as it is
  }
  while (!text.empty() && text.back() == ' ')
  {
    text.pop_back();
  }
  return text;
}

void keep(void* /*user_data*/, err_lvl_t level, const char* format, ...)
{
  if (level < ERR_ERROR)
  {
    return;
  }
  std::array<char, 1200> block{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(block.data(), block.size(), format, arguments);
  va_end(arguments);
  const std::string text = message(block.data()).substr(0, MAX_MESSAGE);
  std::string& errors = errorsOfThread();
  if (!text.empty() && errors.find(text) == std::string::npos && errors.size() < MAX_LENGTH)
  {
    errors += (errors.empty() ? "" : "; ") + text;
  }
  if (level == ERR_FATAL)
  {
    const std::string last_words = errors + "\n";
    if (write(STDERR_FILENO, last_words.data(), last_words.size()) < 0)
    {
      return;  // nobody listens, and the process ends
    }
  }
}

}  // namespace

void quietSphinx()
{
  static std::once_flag once;
  std::call_once(once,
                 []
                 {
                   err_set_logfp(nullptr);
                   err_set_callback(&keep, nullptr);
                 });
}

void clearSphinxErrors()
{
  errorsOfThread().clear();
}

std::string sphinxErrors()
{
  return errorsOfThread();
}

}  // namespace pi_speech
