#pragma once

#include <string>

namespace pi_node::test_support
{

/// what() of the exception that `action` throws, or "" if it throws none of this kind.
template <typename Exception, typename Action>
std::string messageOf(const Action& action)
{
  try
  {
    action();
  }
  catch (const Exception& exception)
  {
    return exception.what();
  }
  return "";
}

}  // namespace pi_node::test_support
