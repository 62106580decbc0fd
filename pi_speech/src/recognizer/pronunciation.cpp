#include "recognizer/pronunciation.h"
#include <fcntl.h>
#include <pi_node/unique_fd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <stdexcept>

#include "recognizer/words.h"

namespace pi_speech
{
namespace
{

/// Longer ones do not occur in a dictionary.
constexpr size_t MAX_LINE = 4096;
/// Bytes per line of the dictionary of CMU, at least.
constexpr size_t LEAST_LINE = 20;

bool isBlank(char c)
{
  return c == ' ' || c == '\t' || c == '\r';
}

bool isComment(const char* line, size_t size)
{
  return size >= 2 && ((line[0] == '#' && line[1] == '#') || (line[0] == ';' && line[1] == ';'));
}

/// The length of a line's word, without the number of its pronunciation.
size_t baseLength(const char* word, size_t size)
{
  if (size > 3 && word[size - 1] == ')')
  {
    const char* open = static_cast<const char*>(std::memchr(word + 1, '(', size - 1));
    return open != nullptr ? static_cast<size_t>(open - word) : size;
  }
  return size;
}

char lower(char c)
{
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// FNV-1a of a word in lower case.
uint32_t hashOf(const char* word, size_t size)
{
  uint32_t hash = 2166136261U;
  for (size_t i = 0; i < size; ++i)
  {
    hash = (hash ^ static_cast<unsigned char>(lower(word[i]))) * 16777619U;
  }
  return hash;
}

std::string lowerCase(std::string text)
{
  std::transform(text.begin(), text.end(), text.begin(), lower);
  return text;
}

std::string lineOf(const std::string& word, const Phones& phones)
{
  std::string line = word;
  for (const std::string& phone : phones)
  {
    line += " " + phone;
  }
  return line;
}

}  // namespace

/// Keeps where the line of a word is, and reads the line when it is wanted: 8 bytes per line.
struct Pronunciation::Impl
{
  Impl(const std::string& path_in, bool guess_words_in) : path(path_in), guess_words(guess_words_in)
  {
    file = pi_node::UniqueFd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat status = {};
    if (!file || fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode))
    {
      throw std::runtime_error(path + ": the dictionary cannot be read (" +
                               (file ? "it is no file" : std::strerror(errno)) +
                               "); install pocketsphinx-en-us, or give the path of a dictionary in the format of CMU");
    }
    index(static_cast<size_t>(status.st_size));
  }

  void index(size_t size)
  {
    if (size > UINT32_MAX)
    {
      throw std::runtime_error(path + ": larger than 4 GB, so it is no dictionary");
    }
    lines.reserve(size / LEAST_LINE);
    std::vector<char> block(1 << 16);
    size_t held = 0;      // bytes in the block
    uint32_t offset = 0;  // of the block in the file
    int number = 1;
    while (true)
    {
      const ssize_t got = pread(file.get(), block.data() + held, block.size() - held, offset + held);
      if (got < 0 && errno == EINTR)
      {
        continue;
      }
      if (got < 0)
      {
        throw std::runtime_error(path + ": the dictionary cannot be read: " + std::strerror(errno));
      }
      held += static_cast<size_t>(got);
      const char* line = block.data();
      const char* end = line + held;
      while (line < end)
      {
        const char* next = static_cast<const char*>(std::memchr(line, '\n', static_cast<size_t>(end - line)));
        if (next == nullptr && got > 0 && static_cast<size_t>(end - line) < MAX_LINE)
        {
          break;  // the rest of it is in the next block
        }
        const char* line_end = next != nullptr ? next : end;
        addLine(line, static_cast<size_t>(line_end - line), offset + static_cast<uint32_t>(line - block.data()),
                number);
        line = next != nullptr ? next + 1 : end;
        ++number;
      }
      const auto used = static_cast<size_t>(line - block.data());
      held -= used;
      offset += static_cast<uint32_t>(used);
      std::memmove(block.data(), line, held);
      if (got == 0)
      {
        break;
      }
    }
    if (lines.empty())
    {
      throw std::runtime_error(path + ": there are no words in it; give a dictionary in the format of CMU");
    }
    std::sort(lines.begin(), lines.end());
  }

  void addLine(const char* line, size_t size, uint32_t offset, int number)
  {
    if (isComment(line, size))
    {
      return;
    }
    const char* const end = line + size;
    const char* word = std::find_if_not(line, end, isBlank);
    const char* word_end = std::find_if(word, end, isBlank);
    if (word == end)
    {
      return;
    }
    if (size >= MAX_LINE || std::find_if_not(word_end, end, isBlank) == end)
    {
      const std::string text(word, std::min<size_t>(word_end - word, 40));
      throw std::runtime_error(path + ":" + std::to_string(number) + ": \"" + text +
                               "\" has no phones; write \"word  P H O N E S\", or remove the line");
    }
    lines.push_back(Line{hashOf(word, baseLength(word, static_cast<size_t>(word_end - word))), offset});
  }

  /// All pronunciations of a word in lower case.
  std::vector<Phones> variantsOf(const std::string& wanted) const
  {
    std::vector<Phones> variants;
    const uint32_t hash = hashOf(wanted.data(), wanted.size());
    for (auto line = std::lower_bound(lines.begin(), lines.end(), Line{hash, 0});
         line != lines.end() && line->hash == hash; ++line)
    {
      const std::vector<std::string> parts = splitWords(readLine(line->offset));
      if (parts.size() > 1 && lowerCase(parts[0].substr(0, baseLength(parts[0].data(), parts[0].size()))) == wanted)
      {
        variants.emplace_back(parts.begin() + 1, parts.end());
      }
    }
    return variants;
  }

  std::string readLine(uint32_t offset) const
  {
    std::array<char, MAX_LINE> block{};
    const ssize_t got = pread(file.get(), block.data(), block.size(), offset);
    const char* end = std::find(block.data(), block.data() + std::max<ssize_t>(got, 0), '\n');
    return {block.data(), static_cast<size_t>(end - block.data())};
  }

  struct Line
  {
    uint32_t hash;    ///< of the word
    uint32_t offset;  ///< in the file
    bool operator<(const Line& other) const { return hash != other.hash ? hash < other.hash : offset < other.offset; }
  };

  const std::string path;
  const bool guess_words;
  pi_node::UniqueFd file;
  std::vector<Line> lines;
  std::unique_ptr<Impl> additions;
  std::map<std::string, Entry> known;
};

Pronunciation::Pronunciation(const std::string& path, bool guess_words, const std::string& additions)
  : impl_(std::make_unique<Impl>(path, guess_words))
{
  if (!additions.empty())
  {
    impl_->additions = std::make_unique<Impl>(additions, false);
  }
}

Pronunciation::~Pronunciation() = default;

Pronunciation::Entry Pronunciation::find(const std::string& word)
{
  const std::string wanted = lowerCase(word);
  const auto known = impl_->known.find(wanted);
  if (known != impl_->known.end())
  {
    return known->second;
  }
  Entry entry;
  entry.variants = impl_->variantsOf(wanted);
  if (impl_->additions != nullptr)
  {
    for (Phones& variant : impl_->additions->variantsOf(wanted))
    {
      if (std::find(entry.variants.begin(), entry.variants.end(), variant) == entry.variants.end())
      {
        entry.variants.push_back(std::move(variant));
      }
    }
  }
  if (entry.variants.empty())
  {
    const std::string lacking = "\"" + word + "\" is not in the dictionary " + impl_->path;
    if (!impl_->guess_words)
    {
      throw std::runtime_error(lacking + "; add it there, or switch guess_words on");
    }
    try
    {
      entry.variants.push_back(guessPhones(wanted));
    }
    catch (const std::runtime_error& error)
    {
      throw std::runtime_error(lacking + ", and " + error.what() + ", or add the word to the dictionary");
    }
    entry.guessed = true;
    if (entry.variants.front().empty())
    {
      throw std::runtime_error(lacking + ", and the rules give no phones for it; add it there, or choose another word");
    }
  }
  impl_->known.emplace(wanted, entry);
  return entry;
}

std::string Pronunciation::dictionaryOf(const std::vector<std::string>& words)
{
  std::string text;
  for (const std::string& word : words)
  {
    const Entry entry = find(word);
    for (size_t i = 0; i < entry.variants.size(); ++i)
    {
      text += lineOf(word + (i == 0 ? "" : "(" + std::to_string(i + 1) + ")"), entry.variants[i]) + "\n";
    }
  }
  return text;
}

std::vector<std::string> Pronunciation::guesses() const
{
  std::vector<std::string> lines;
  for (const auto& [word, entry] : impl_->known)
  {
    if (entry.guessed)
    {
      lines.push_back(lineOf(word, entry.variants.front()));
    }
  }
  return lines;
}

}  // namespace pi_speech
