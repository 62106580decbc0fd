#pragma once

#include <pi_speech/command_table.h>

#include <string>

namespace pi_speech
{

constexpr char DICTIONARY[] = "/usr/share/pocketsphinx/model/en-us/cmudict-en-us.dict";

/// Of commands separated by commas.
inline CommandTable table(const std::string& list)
{
  return CommandTable::parse("commands: [" + list + "]", "table");
}

inline bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

}  // namespace pi_speech
