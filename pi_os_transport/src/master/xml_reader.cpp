#include "master/xml_reader.h"

#include <algorithm>
#include <charconv>
#include <cstdint>

#include "master/rpc_decoder.h"

namespace pi_os_transport
{
namespace
{

constexpr std::string_view SPACE = " \t\r\n";

bool isAllowed(uint32_t code)
{
  return code == '\t' || code == '\n' || code == '\r' || (code >= 0x20 && code < 0xD800) ||
         (code >= 0xE000 && code < 0xFFFE) || (code >= 0x10000 && code < 0x110000);
}

/// @return size of the UTF-8 character at the start of `text`; 0 if it is invalid or not allowed in XML.
size_t characterSize(std::string_view text)
{
  const auto first = static_cast<uint8_t>(text[0]);
  if (first < 0x80)
  {
    return isAllowed(first) ? 1 : 0;
  }
  const size_t size = first >> 5 == 0x6 ? 2 : first >> 4 == 0xE ? 3 : first >> 3 == 0x1E ? 4 : 0;
  if (size == 0 || text.size() < size)
  {
    return 0;
  }
  uint32_t code = first & (0xFFU >> (size + 1));
  for (size_t index = 1; index < size; ++index)
  {
    const auto byte = static_cast<uint8_t>(text[index]);
    if (byte >> 6 != 0x2)
    {
      return 0;
    }
    code = code << 6 | (byte & 0x3F);
  }
  constexpr uint32_t SMALLEST[] = {0, 0, 0x80, 0x800, 0x10000};  // by size: overlong forms are refused
  return code >= SMALLEST[size] && isAllowed(code) ? size : 0;
}

void appendUtf8(std::string* out, uint32_t code)
{
  if (code < 0x80)
  {
    out->push_back(static_cast<char>(code));
    return;
  }
  const int size = code < 0x800 ? 2 : code < 0x10000 ? 3 : 4;
  out->push_back(static_cast<char>((0xF00 >> size) | (code >> (6 * (size - 1)))));
  for (int index = size - 2; index >= 0; --index)
  {
    out->push_back(static_cast<char>(0x80 | ((code >> (6 * index)) & 0x3F)));
  }
}

}  // namespace

std::string allowedText(std::string_view text)
{
  std::string out;
  while (!text.empty())
  {
    const size_t size = characterSize(text);
    out += size != 0 ? text.substr(0, size) : "?";
    text.remove_prefix(std::max<size_t>(size, 1));
  }
  return out;
}

void XmlReader::fail(const std::string& what) const
{
  throw RpcDecodeError("not XML-RPC: " + what + " at byte " + std::to_string(at_));
}

void XmlReader::skipPast(std::string_view what)
{
  const size_t found = xml_.find(what, at_);
  if (found == std::string_view::npos)
  {
    fail("no \"" + std::string(what) + "\"");
  }
  at_ = found + what.size();
}

void XmlReader::skipMisc()
{
  while (true)
  {
    at_ = std::min(xml_.find_first_not_of(SPACE, at_), xml_.size());
    if (looksAt("<?"))
    {
      skipPast("?>");
    }
    else if (looksAt("<!--"))
    {
      skipPast("-->");
    }
    else
    {
      return;
    }
  }
}

XmlReader::Tag XmlReader::nextTag()
{
  skipMisc();
  if (!looksAt("<"))
  {
    fail(at_ == xml_.size() ? "the text ends too early" : "text where a tag is expected");
  }
  if (looksAt("<!"))
  {
    fail("a declaration, which is not accepted");
  }
  Tag tag;
  size_t start = at_ + 1;
  if (start < xml_.size() && xml_[start] == '/')
  {
    tag.is_end = true;
    ++start;
  }
  const size_t close = xml_.find_first_of("<>", start);
  if (close == std::string_view::npos || xml_[close] == '<')
  {
    fail("a tag without an end");
  }
  std::string_view inside = xml_.substr(start, close - start);
  if (!tag.is_end && !inside.empty() && inside.back() == '/')
  {
    tag.is_empty = true;
    inside.remove_suffix(1);
  }
  tag.name = inside.substr(0, inside.find_first_of(SPACE));  // attributes are ignored
  at_ = close + 1;
  return tag;
}

bool XmlReader::expect(std::string_view name, bool is_end)
{
  const Tag tag = nextTag();
  if (tag.is_end != is_end || tag.name != name)
  {
    fail("<" + std::string(tag.is_end ? "/" : "") + std::string(tag.name.substr(0, 40)) + "> in place of <" +
         (is_end ? "/" : "") + std::string(name) + ">");
  }
  return tag.is_empty;
}

void XmlReader::appendCharacters(std::string* out, std::string_view characters)
{
  size_t index = 0;
  while (index < characters.size())
  {
    const size_t size = characterSize(characters.substr(index));
    if (size == 0)
    {
      at_ += index;
      fail("bytes that are no UTF-8, or a control character");
    }
    if (characters[index] == '\r')
    {
      out->push_back('\n');
      index += characters.compare(index, 2, "\r\n") == 0 ? 2 : 1;
      continue;
    }
    out->append(characters, index, size);
    index += size;
  }
  at_ += characters.size();
}

void XmlReader::appendReference(std::string* out)
{
  const size_t close = xml_.find(';', at_);
  if (close == std::string_view::npos || close - at_ > 12)
  {
    fail("\"&\" without \";\"");
  }
  const std::string_view name = xml_.substr(at_ + 1, close - at_ - 1);
  constexpr std::string_view NAMES[] = {"lt", "gt", "amp", "quot", "apos"};
  constexpr std::string_view CHARACTERS = "<>&\"'";
  for (size_t index = 0; index < CHARACTERS.size(); ++index)
  {
    if (name == NAMES[index])
    {
      out->push_back(CHARACTERS[index]);
      at_ = close + 1;
      return;
    }
  }
  uint32_t code = 0;
  const bool is_hex = name.compare(0, 2, "#x") == 0;
  const char* const first = name.data() + (is_hex ? 2 : 1);
  const char* const last = name.data() + name.size();
  if (name.empty() || name[0] != '#' || first >= last ||
      std::from_chars(first, last, code, is_hex ? 16 : 10).ptr != last || !isAllowed(code))
  {
    fail("the reference \"&" + std::string(name) + ";\"");
  }
  appendUtf8(out, code);
  at_ = close + 1;
}

std::string XmlReader::text()
{
  std::string out;
  while (at_ < xml_.size())
  {
    const size_t stop = std::min(xml_.find_first_of("<&", at_), xml_.size());
    appendCharacters(&out, xml_.substr(at_, stop - at_));
    if (looksAt("&"))
    {
      appendReference(&out);
    }
    else if (looksAt("<![CDATA["))
    {
      const size_t start = at_ + 9;
      const size_t close = xml_.find("]]>", start);
      if (close == std::string_view::npos)
      {
        fail("CDATA without an end");
      }
      at_ = start;
      appendCharacters(&out, xml_.substr(start, close - start));
      at_ = close + 3;
    }
    else if (looksAt("<!--"))
    {
      skipPast("-->");
    }
    else
    {
      break;
    }
  }
  return out;
}

void XmlReader::finish()
{
  skipMisc();
  if (at_ != xml_.size())
  {
    fail("something after the end");
  }
}

}  // namespace pi_os_transport
