#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace pi_os_transport
{

/// `text` with "?" for every byte that is not part of a UTF-8 character allowed in XML.
std::string allowedText(std::string_view text);

/// Reads the subset of XML that XML-RPC uses, tag by tag: elements, text, character references, CDATA, comments. The
/// text must outlive this object. All functions throw RpcDecodeError.
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

  /// Skips white space, comments and processing instructions, and reads the next tag.
  Tag nextTag();
  /// The same for a start tag of that name. @return true if the element is empty and has no end tag
  bool start(std::string_view name) { return expect(name, false); }
  void end(std::string_view name) { expect(name, true); }
  /// Text up to the next tag, with references resolved. @throws if it is not UTF-8 or not allowed in XML
  std::string text();
  /// Checks that only white space and comments follow.
  void finish();
  [[noreturn]] void fail(const std::string& what) const;

private:
  bool expect(std::string_view name, bool is_end);
  bool looksAt(std::string_view what) const { return xml_.compare(at_, what.size(), what) == 0; }
  void skipPast(std::string_view what);
  void skipMisc();
  void appendReference(std::string* out);
  void appendCharacters(std::string* out, std::string_view characters);

  std::string_view xml_;
  size_t at_ = 0;
};

}  // namespace pi_os_transport
