#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "kernels/codelet_runner.h"

namespace pi_runtime
{

inline void runOn(bool native, const CodeletPtr& codelet, const std::vector<Argument>& arguments, uint64_t range)
{
  native ? CodeletRunner::shared().native(codelet, arguments, range)
         : CodeletRunner::shared().opencl(codelet, arguments, range);
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
