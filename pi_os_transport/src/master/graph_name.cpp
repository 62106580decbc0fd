#include "master/graph_name.h"

#include <algorithm>

namespace pi_os_transport
{
namespace
{

bool startsWith(std::string_view text, char what)
{
  return !text.empty() && text[0] == what;
}

}  // namespace

std::vector<std::string_view> nameParts(std::string_view name)
{
  std::vector<std::string_view> parts;
  while (!name.empty())
  {
    const size_t slash = std::min(name.find('/'), name.size());
    if (slash != 0)
    {
      parts.push_back(name.substr(0, slash));
    }
    name.remove_prefix(std::min(slash + 1, name.size()));
  }
  return parts;
}

std::string canonicalName(std::string_view name)
{
  std::string result = startsWith(name, '/') ? "/" : "";
  for (const std::string_view part : nameParts(name))
  {
    if (!result.empty() && result.back() != '/')
    {
      result += '/';
    }
    result += part;
  }
  return result;
}

std::string namespaceOf(std::string_view name)
{
  if (!name.empty() && name.back() == '/')
  {
    name.remove_suffix(1);
  }
  const size_t slash = name.rfind('/');
  return slash == std::string_view::npos ? "/" : std::string(name.substr(0, slash + 1));
}

std::string joinName(std::string_view space, std::string_view name)
{
  if (startsWith(name, '/') || startsWith(name, '~') || space.empty())
  {
    return std::string(name);
  }
  std::string result(space);
  if (result.back() != '/' && result != "~")
  {
    result += '/';
  }
  return result += name;
}

std::string resolveName(std::string_view name, std::string_view node)
{
  if (name.empty())
  {
    return namespaceOf(node);
  }
  if (startsWith(name, '/'))
  {
    return canonicalName(name);
  }
  if (startsWith(name, '~'))
  {
    return canonicalName(std::string(node) + "/" + std::string(name.substr(1)));
  }
  return namespaceOf(node) + canonicalName(name);
}

}  // namespace pi_os_transport
