#pragma once

#include <map>
#include <mutex>
#include <string>
#include <vector>

#include <pi_runtime/codelet.h>

namespace pi_runtime
{

/// A codelet that can be found by name, and what people need to know to call it.
struct RegisteredCodelet
{
  CodeletPtr codelet;
  std::string description;  ///< one line
  std::string arguments;    ///< index, direction, type and meaning of each argument; meaning of the range
};

/// The codelets that a process offers by name, to itself and through its ROS services. Thread safe.
class CodeletRegistry
{
public:
  /// An empty one, for tests.
  CodeletRegistry() = default;
  CodeletRegistry(const CodeletRegistry&) = delete;
  CodeletRegistry& operator=(const CodeletRegistry&) = delete;

  /// The one of the process. The built-in kernels are in it from the beginning.
  static CodeletRegistry& instance();

  /// Adds an entry under its codelet's name. Adding the same codelet again replaces its texts.
  /// @throws std::invalid_argument  there is no codelet or no description, or another codelet has the name.
  void add(RegisteredCodelet entry);
  /// Takes an entry out; who has the codelet keeps it. @return false if there is none of this name.
  bool remove(const std::string& name);

  /// @return null if there is none of this name.
  CodeletPtr find(const std::string& name) const;
  /// All, by name.
  std::vector<RegisteredCodelet> list() const;

private:
  mutable std::mutex mutex_;
  std::map<std::string, RegisteredCodelet> entries_;
};

}  // namespace pi_runtime
