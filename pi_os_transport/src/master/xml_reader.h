#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace pi_os_transport
{

/// `text` with "?" for every byte that is not part of a character that XML allows, in UTF-8.
std::string allowedText(std::string_view text);

/// Reads the part of XML that XML-RPC uses, tag by tag: elements, text, character references, CDATA, comments.
/// The text must outlive it. All functions throw RpcDecodeError.
class XmlReader
{
public:
  struct Tag
  {
    std::string_view name;
    bool is_end = false;    ///< </name>
    bool is_empty = false;  ///< <name/>
  };

  explicit XmlReader(std::string_view xml) : xml_(xml) {}

  /// Skips white space, comments and processing instructions up to the next tag and reads it.
  Tag nextTag();
  /// Skips the same and reads a start tag of that name. @return whether it was an empty element, which has no end tag.
  bool start(std::string_view name);
  void end(std::string_view name);
  /// Text up to the next tag, with references resolved. @throws if it is not UTF-8 or holds what XML does not allow
  std::string text();
  /// Nothing but white space and comments may follow.
  void finish();
  [[noreturn]] void fail(const std::string& what) const;

private:
  bool looksAt(std::string_view what) const { return xml_.compare(at_, what.size(), what) == 0; }
  void skipPast(std::string_view what);
  void skipMisc();
  void appendReference(std::string* out);
  void appendCharacters(std::string* out, std::string_view characters);

  std::string_view xml_;
  size_t at_ = 0;
};

}  // namespace pi_os_transport
