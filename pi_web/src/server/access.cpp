#include "server/access.h"

#include <fcntl.h>
#include <pi_node/unique_fd.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace pi_web
{
namespace
{

constexpr size_t MIN_TOKEN = 16;

bool equalInConstantTime(std::string_view left, std::string_view right)
{
  unsigned difference = left.size() == right.size() ? 0 : 1;
  for (size_t i = 0; i < left.size(); ++i)
  {
    difference |= static_cast<unsigned char>(left[i]) ^ static_cast<unsigned char>(i < right.size() ? right[i] : 0);
  }
  return difference == 0;
}

std::string lower(std::string_view text)
{
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 'a' - 'A') : c; });
  return result;
}

/// Without the port.
std::string nameOf(std::string_view host)
{
  const size_t colon = host.find_last_of(':');
  const bool has_port = colon != std::string_view::npos && host.find(']', colon) == std::string_view::npos;
  return lower(has_port ? host.substr(0, colon) : host);
}

bool isOurs(const AccessOptions& options, std::string_view host)
{
  const std::string name = nameOf(host);
  if (name == "localhost" ||
      (!name.empty() && (name[0] == '[' || std::all_of(name.begin(), name.end(),
                                                       [](char c) { return (c >= '0' && c <= '9') || c == '.'; }))))
  {
    return true;
  }
  char own[256] = {};
  gethostname(own, sizeof own - 1);
  const std::string own_name = lower(own);
  const auto& names = options.host_names;
  return name == own_name || name == own_name + ".local" || std::find(names.begin(), names.end(), name) != names.end();
}

int hexDigit(char c)
{
  return c >= '0' && c <= '9'   ? c - '0'
         : c >= 'a' && c <= 'f' ? c - 'a' + 10
         : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                : -1;
}

}  // namespace

std::string tokenOf(std::string_view target)
{
  size_t at = target.find('?');
  while (at != std::string_view::npos)
  {
    const std::string_view rest = target.substr(at + 1);
    const size_t end = rest.find('&');
    const std::string_view field = rest.substr(0, end);
    if (field.substr(0, 6) == "token=")
    {
      std::string token;
      for (size_t i = 6; i < field.size(); ++i)
      {
        const bool escaped =
            field[i] == '%' && i + 2 < field.size() && hexDigit(field[i + 1]) >= 0 && hexDigit(field[i + 2]) >= 0;
        token += escaped ? static_cast<char>(hexDigit(field[i + 1]) * 16 + hexDigit(field[i + 2])) : field[i];
        i += escaped ? 2 : 0;
      }
      return token;
    }
    at = end == std::string_view::npos ? end : at + 1 + end;
  }
  return "";
}

Access accessOf(const AccessOptions& options, std::string_view target, std::string_view host, std::string_view origin,
                bool certified)
{
  if (!isOurs(options, host))
  {
    return {"the host name is not one of this computer; add it to host_names, or use its address"};
  }
  const size_t scheme = origin.find("://");
  const bool from_web = origin == "null" || origin.substr(0, 4) == "http";  // others: programs, as file:// of desktops
  const auto& origins = options.web_origins;
  if (from_web && (scheme == std::string_view::npos || lower(origin.substr(scheme + 3)) != lower(host)) &&
      std::find(origins.begin(), origins.end(), lower(origin)) == origins.end())
  {
    return {"the page comes from elsewhere; add its origin to web_origins if you trust it"};
  }
  const std::string given = tokenOf(target);
  const bool right =
      (certified && given.empty()) || (!options.token.empty() && equalInConstantTime(given, options.token));
  if (!right && !given.empty())
  {
    return {"wrong token"};
  }
  if (!right && options.token_to_watch)
  {
    return {"this address needs ?token=..., which pi_edge open prints"};
  }
  return {"", right && options.allow_control};
}

std::string tokenOfFile(const std::string& path)
{
  std::ifstream file(path);
  std::string token;
  if (file >> token)
  {
    if (token.size() < MIN_TOKEN)
    {
      throw std::runtime_error(path + " holds a token of " + std::to_string(token.size()) + " characters, must be " +
                               std::to_string(MIN_TOKEN) + " or more; remove the file, and a new one is made");
    }
    return token;
  }
  unsigned char random[16];
  std::error_code ignored;  // told by open()
  std::filesystem::create_directories(std::filesystem::path(path).parent_path(), ignored);
  pi_node::UniqueFd made(open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR));
  if (!made || getrandom(random, sizeof random, 0) != static_cast<ssize_t>(sizeof random))
  {
    throw std::runtime_error("token_file " + path + ": " + std::strerror(errno) +
                             "; choose a path that this user may write, or remove an empty file");
  }
  for (const unsigned char byte : random)
  {
    token += "0123456789abcdef"[byte >> 4];
    token += "0123456789abcdef"[byte & 15];
  }
  if (write(made.get(), token.data(), token.size()) != static_cast<ssize_t>(token.size()) || !made.reset())
  {
    throw std::runtime_error("token_file " + path + ": " + std::strerror(errno));
  }
  return token;
}

}  // namespace pi_web
