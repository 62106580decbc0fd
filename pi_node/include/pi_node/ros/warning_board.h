#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace pi_node
{

/// Warnings that may come with every message: each is logged at most once per period, and can be read for a while by
/// the diagnostics. Texts that differ in their numbers only are the same warning. Thread safe.
class WarningBoard
{
public:
  using Log = std::function<void(bool error, const std::string& text)>;
  /// @param period_s  between two log lines of one warning, and how long it can be read after it came last [s].
  /// @param log       writes a line, on the thread of whoever warns.
  WarningBoard(double period_s, Log log);

  void warn(const std::string& text) { add(text, false); }
  void error(const std::string& text) { add(text, true); }

  struct Entry
  {
    std::string text;  ///< as it came last
    bool error = false;
  };
  /// Those of the last period, errors first.
  std::vector<Entry> recent() const;

private:
  using Clock = std::chrono::steady_clock;
  struct Note
  {
    Entry entry;
    Clock::time_point came_at;
    Clock::time_point logged_at;
  };
  void add(const std::string& text, bool error);

  const std::chrono::duration<double> period_;
  const Log log_;
  mutable std::mutex mutex_;
  std::map<std::string, Note> notes_;  ///< by their text without numbers
};

}  // namespace pi_node
