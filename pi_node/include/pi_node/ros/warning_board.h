#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace pi_node
{

/// Logs each warning at most once per period, and keeps it for the diagnostics. Texts that differ only in their numbers
/// are the same warning. Thread safe.
class WarningBoard
{
public:
  using Log = std::function<void(bool error, const std::string& text)>;
  /// @param period_s  between two log lines of one warning; also the time that recent() returns it [s].
  /// @param log       writes a line, on the thread that warns.
  WarningBoard(double period_s, Log log);

  void warn(const std::string& text) { add(text, false); }
  void error(const std::string& text) { add(text, true); }

  struct Entry
  {
    std::string text;  ///< of the newest one
    bool error = false;
  };
  /// Warnings of the last period, errors first.
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

/// Adds "warning 1" and so on to a diagnostic_updater::DiagnosticStatusWrapper.
template <typename Status>
void addWarnings(const std::vector<WarningBoard::Entry>& warnings, Status* status)
{
  for (size_t i = 0; i < warnings.size(); ++i)
  {
    status->add("warning " + std::to_string(i + 1), warnings[i].text);
  }
}

}  // namespace pi_node
