#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "codelet_runner.h"

namespace pi_runtime
{

/// The one runner of a test program.
inline CodeletRunner& runner()
{
  static CodeletRunner instance;
  return instance;
}

inline void runOn(bool native, const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range)
{
  native ? runner().native(codelet, arguments, range) : runner().opencl(codelet, arguments, range);
}

/// Expects that both implementations fail with a message that contains the reason.
inline void expectRefused(const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range,
                          const std::string& reason)
{
  for (const bool native : {true, false})
  {
    try
    {
      runOn(native, codelet, arguments, range);
      ADD_FAILURE() << "not refused: " << reason;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
    }
  }
}

}  // namespace pi_runtime
