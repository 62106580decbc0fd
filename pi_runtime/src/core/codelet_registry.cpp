#include "core/codelet_registry.h"

#include <stdexcept>
#include <utility>

#include "kernels/builtin_codelets.h"

namespace pi_runtime
{

CodeletRegistry& CodeletRegistry::instance()
{
  struct WithBuiltins
  {
    WithBuiltins() { kernels::registerBuiltinCodelets(registry); }
    CodeletRegistry registry;
  };
  static WithBuiltins process;
  return process.registry;
}

void CodeletRegistry::add(RegisteredCodelet entry)
{
  if (!entry.codelet)
  {
    throw std::invalid_argument("CodeletRegistry: the codelet is null");
  }
  const std::string name = entry.codelet->name;
  if (entry.description.empty())
  {
    throw std::invalid_argument("CodeletRegistry: codelet " + name + " needs a description");
  }
  std::lock_guard<std::mutex> lock(mutex_);
  const auto [found, added] = entries_.try_emplace(name);
  if (!added && found->second.codelet != entry.codelet)
  {
    throw std::invalid_argument("CodeletRegistry: another codelet is called " + name +
                                " already; give this one a name of its own, or remove() the other");
  }
  found->second = std::move(entry);
}

bool CodeletRegistry::remove(const std::string& name)
{
  std::lock_guard<std::mutex> lock(mutex_);
  return entries_.erase(name) > 0;
}

CodeletPtr CodeletRegistry::find(const std::string& name) const
{
  std::lock_guard<std::mutex> lock(mutex_);
  const auto found = entries_.find(name);
  return found != entries_.end() ? found->second.codelet : nullptr;
}

std::vector<RegisteredCodelet> CodeletRegistry::list() const
{
  std::vector<RegisteredCodelet> result;
  std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [name, entry] : entries_)
  {
    result.push_back(entry);
  }
  return result;
}

}  // namespace pi_runtime
