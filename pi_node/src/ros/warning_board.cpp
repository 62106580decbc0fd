#include <pi_node/ros/warning_board.h>

#include <algorithm>
#include <cctype>
#include <utility>

namespace pi_node
{
namespace
{

constexpr size_t MAX_NOTES = 64;

std::string withoutNumbers(const std::string& text)
{
  std::string key;
  for (const char character : text)
  {
    if (!std::isdigit(static_cast<unsigned char>(character)) && character != '.' && character != '-' &&
        character != '+')
    {
      key += character;
    }
  }
  return key;
}

}  // namespace

WarningBoard::WarningBoard(double period_s, Log log) : period_(period_s), log_(std::move(log)) {}

void WarningBoard::add(const std::string& text, bool error)
{
  const Clock::time_point now = Clock::now();
  bool log = false;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (notes_.size() >= MAX_NOTES)
    {
      for (auto note = notes_.begin(); note != notes_.end();)
      {
        note = now - note->second.came_at > period_ ? notes_.erase(note) : std::next(note);
      }
    }
    const auto [note, is_new] = notes_.try_emplace(withoutNumbers(text));
    log = is_new || now - note->second.logged_at >= period_;
    note->second.entry = {text, error};
    note->second.came_at = now;
    if (log)
    {
      note->second.logged_at = now;
    }
  }
  if (log)
  {
    log_(error, text);
  }
}

std::vector<WarningBoard::Entry> WarningBoard::recent() const
{
  const Clock::time_point now = Clock::now();
  std::vector<Entry> entries;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [key, note] : notes_)
  {
    if (now - note.came_at <= period_)
    {
      entries.push_back(note.entry);
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.error && !b.error; });
  return entries;
}

}  // namespace pi_node
