#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>

/// One line from the judge: a verb, then key=value pairs.
class Command
{
public:
  explicit Command(const std::string& line)
  {
    std::istringstream in(line);
    in >> verb_;
    for (std::string token; in >> token;)
    {
      const size_t equal = token.find('=');
      if (equal == std::string::npos)
      {
        throw std::invalid_argument("argument \"" + token + "\" of " + verb_ + " is not key=value");
      }
      values_[token.substr(0, equal)] = token.substr(equal + 1);
    }
  }
  const std::string& verb() const { return verb_; }
  bool has(const std::string& key) const { return values_.count(key) != 0; }
  std::string text(const std::string& key) const
  {
    const auto it = values_.find(key);
    if (it == values_.end())
    {
      throw std::invalid_argument(verb_ + " needs " + key + "=");
    }
    return it->second;
  }
  std::string text(const std::string& key, const std::string& fallback) const
  {
    return has(key) ? text(key) : fallback;
  }
  double real(const std::string& key, double fallback) const { return has(key) ? std::stod(text(key)) : fallback; }
  long integer(const std::string& key, long fallback) const { return has(key) ? std::stol(text(key)) : fallback; }
  bool flag(const std::string& key) const { return integer(key, 0) != 0; }
  std::chrono::milliseconds timeout() const
  {
    return std::chrono::milliseconds(static_cast<int64_t>(1000 * real("timeout", 30)));
  }
  std::chrono::steady_clock::time_point deadline() const { return std::chrono::steady_clock::now() + timeout(); }

private:
  std::string verb_;
  std::map<std::string, std::string> values_;
};
