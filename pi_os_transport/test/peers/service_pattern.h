#pragma once

#include <sensor_msgs/SetCameraInfo.h>

#include <cstddef>
#include <cstdint>
#include <string>

inline double patternValue(uint32_t call, size_t index)
{
  return static_cast<double>((call * 2654435761u + static_cast<uint32_t>(index) * 40503u) % 1000003u);
}

/// Request of `bytes` bytes (rounded down to whole doubles) that asks for an answer of `answer` bytes.
inline void fillRequest(uint32_t call, size_t bytes, uint32_t answer, sensor_msgs::CameraInfo* request)
{
  request->width = call;
  request->height = answer;
  request->D.resize(bytes / sizeof(double));
  for (size_t i = 0; i < request->D.size(); ++i)
  {
    request->D[i] = patternValue(call, i);
  }
}

inline bool requestIntact(const sensor_msgs::CameraInfo& request)
{
  for (size_t i = 0; i < request.D.size(); ++i)
  {
    if (request.D[i] != patternValue(request.width, i))
    {
      return false;
    }
  }
  return true;
}

/// The answer to a call depends on the call, so that a late answer to another one is seen.
inline std::string answerText(uint32_t call, size_t request_values, size_t bytes)
{
  std::string text = std::to_string(call) + ":" + std::to_string(request_values) + ":";
  while (text.size() < bytes)
  {
    text.push_back(static_cast<char>('a' + (call + text.size()) % 26));
  }
  return text;
}
