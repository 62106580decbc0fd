#include <dlfcn.h>
#include <espeak-ng/speak_lib.h>
#include "recognizer/pronunciation.h"

#include <clocale>
#include <cstring>
#include <map>
#include <mutex>
#include <stdexcept>

namespace pi_speech
{
namespace
{

constexpr char LIBRARY[] = "libespeak-ng.so.1";
constexpr char VOICE[] = "en-us";
/// Between two phones of espeak-ng's text.
constexpr char SEPARATOR = '|';

/// espeak-ng's names of phones, without stress, as phones of the CMU dictionary.
const std::map<std::string, Phones>& phoneTable()
{
  static const std::map<std::string, Phones> table = {
      // consonants
      {"p", {"P"}},
      {"b", {"B"}},
      {"t", {"T"}},
      {"t#", {"T"}},
      {"t2", {"T"}},
      {"?", {"T"}},
      {"d", {"D"}},
      {"k", {"K"}},
      {"x", {"K"}},
      {"g", {"G"}},
      {"tS", {"CH"}},
      {"dZ", {"JH"}},
      {"f", {"F"}},
      {"v", {"V"}},
      {"T", {"TH"}},
      {"D", {"DH"}},
      {"s", {"S"}},
      {"z", {"Z"}},
      {"S", {"SH"}},
      {"Z", {"ZH"}},
      {"h", {"HH"}},
      {"m", {"M"}},
      {"n", {"N"}},
      {"n-", {"AH", "N"}},
      {"N", {"NG"}},
      {"l", {"L"}},
      {"l#", {"L"}},
      {"r", {"R"}},
      {"r-", {"R"}},
      {"w", {"W"}},
      {"j", {"Y"}},
      // vowels
      {"i", {"IY"}},
      {"i:", {"IY"}},
      {"I", {"IH"}},
      {"I2", {"IH"}},
      {"I#", {"IH"}},
      {"E", {"EH"}},
      {"a", {"AE"}},
      {"aa", {"AE"}},
      {"0", {"AA"}},
      {"A:", {"AA"}},
      {"A~", {"AA", "N"}},
      {"O", {"AO"}},
      {"O2", {"AO"}},
      {"O:", {"AO"}},
      {"V", {"AH"}},
      {"@", {"AH"}},
      {"@-", {"AH"}},
      {"a#", {"AH"}},
      {"@L", {"AH", "L"}},
      {"U", {"UH"}},
      {"u", {"UW"}},
      {"u:", {"UW"}},
      {"eI", {"EY"}},
      {"aI", {"AY"}},
      {"OI", {"OY"}},
      {"oU", {"OW"}},
      {"aU", {"AW"}},
      {"aI@", {"AY", "AH"}},
      {"i@", {"IY", "AH"}},
      // vowels with r
      {"3", {"ER"}},
      {"3:", {"ER"}},
      {"A@", {"AA", "R"}},
      {"e@", {"EH", "R"}},
      {"i@3", {"IH", "R"}},
      {"o@", {"AO", "R"}},
      {"O@", {"AO", "R"}},
      {"U@", {"UH", "R"}},
      {"aI3", {"AY", "ER"}},
      {"aU@", {"AW", "ER"}},
  };
  return table;
}

/// espeak-ng, loaded when the first word is guessed: it brings thirty more libraries, for sound, into the process.
class Espeak
{
public:
  Espeak()
  {
    void* library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr)
    {
      throw std::runtime_error("it cannot be pronounced by rules, as " + std::string(LIBRARY) +
                               " cannot be loaded; install libespeak-ng1");
    }
    const auto initialize = symbol<decltype(&espeak_Initialize)>(library, "espeak_Initialize");
    const auto set_voice = symbol<decltype(&espeak_SetVoiceByName)>(library, "espeak_SetVoiceByName");
    text_to_phonemes_ = symbol<decltype(&espeak_TextToPhonemes)>(library, "espeak_TextToPhonemes");
    // It sets the locale of the process, which is not its own.
    const char* locale = setlocale(LC_CTYPE, nullptr);
    const std::string locale_before = locale != nullptr ? locale : "C";
    const int rate = initialize(AUDIO_OUTPUT_SYNCHRONOUS, 0, nullptr, espeakINITIALIZE_DONT_EXIT);
    setlocale(LC_CTYPE, locale_before.c_str());
    if (rate <= 0)
    {
      throw std::runtime_error(
          "it cannot be pronounced by rules, as espeak-ng does not find its data; install espeak-ng-data");
    }
    if (set_voice(VOICE) != EE_OK)
    {
      throw std::runtime_error("it cannot be pronounced by rules, as espeak-ng has no voice " + std::string(VOICE) +
                               "; install espeak-ng-data whole");
    }
  }

  /// Names of phones, with SEPARATOR between two and stress marks before them.
  std::string phones(const std::string& word) const
  {
    std::string text;
    const void* rest = word.c_str();
    while (rest != nullptr)
    {
      const char* part = text_to_phonemes_(&rest, espeakCHARS_UTF8, SEPARATOR << 8);
      if (part == nullptr)
      {
        break;
      }
      text += (text.empty() ? "" : " ") + std::string(part);
    }
    return text;
  }

private:
  template <typename Function>
  static Function symbol(void* library, const char* name)
  {
    void* address = dlsym(library, name);
    if (address == nullptr)
    {
      throw std::runtime_error("it cannot be pronounced by rules, as " + std::string(LIBRARY) + " has no " + name +
                               "; install Debian's libespeak-ng1");
    }
    return reinterpret_cast<Function>(address);
  }

  decltype(&espeak_TextToPhonemes) text_to_phonemes_ = nullptr;
};

/// The names in a text of espeak-ng, without stress, pauses and language switches.
std::vector<std::string> namesOf(const std::string& text)
{
  std::vector<std::string> names;
  std::string name;
  bool in_switch = false;  // "(fr)"
  for (const char c : text + SEPARATOR)
  {
    in_switch = in_switch ? c != ')' : c == '(';
    if (c == SEPARATOR || c == ' ')
    {
      if (!name.empty())
      {
        names.push_back(name);
      }
      name.clear();
    }
    else if (!in_switch && std::strchr("',%=_)", c) == nullptr)
    {
      name += c;
    }
  }
  return names;
}

bool isVowel(const std::string& phone)
{
  return std::strchr("AEIOU", phone[0]) != nullptr;
}

/// Consonants that do not exist in the table stand for nothing: espeak-ng has rare ones for foreign names.
Phones toCmu(const std::vector<std::string>& names)
{
  const std::map<std::string, Phones>& table = phoneTable();
  Phones phones;
  for (size_t i = 0; i < names.size(); ++i)
  {
    const std::string next = i + 1 < names.size() ? names[i + 1] : "";
    const bool r_follows = next == "r" || next == "r-";
    const bool r_stood = !phones.empty() && (phones.back() == "ER" || phones.back() == "R");
    if ((names[i] == "r" || names[i] == "r-") && r_stood)
    {
      continue;  // the vowel before has it already: "tinkering" is ER IH NG
    }
    if (names[i] == ";")
    {
      if (!phones.empty() && !isVowel(phones.back()))
      {
        phones.emplace_back("Y");  // "canyon"
      }
      else if (!phones.empty() && phones.back() == "IH")
      {
        phones.back() = "IY";  // "patio"
      }
    }
    else if (names[i] == "i@" && r_follows)
    {
      phones.emplace_back("IH");  // "material"
    }
    else if (names[i] == "aI3" && r_follows)
    {
      phones.emplace_back("AY");  // "admiring"
    }
    else if (names[i] == "a" && r_follows)
    {
      phones.emplace_back("EH");  // "carry"
    }
    else if (names[i] == "@-" && r_follows)
    {
      phones.emplace_back("ER");  // "cameraman"
    }
    else
    {
      const auto entry = table.find(names[i]);
      if (entry != table.end())
      {
        phones.insert(phones.end(), entry->second.begin(), entry->second.end());
      }
    }
  }
  return phones;
}

}  // namespace

Phones guessPhones(const std::string& word)
{
  static std::mutex mutex;
  const std::lock_guard<std::mutex> lock(mutex);
  static const Espeak espeak;
  return toCmu(namesOf(espeak.phones(word)));
}

}  // namespace pi_speech
