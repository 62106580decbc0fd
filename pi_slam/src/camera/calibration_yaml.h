#pragma once

#include <pi_slam/stereo_calibration.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <string>

namespace pi_slam
{

/// A file of Kalibr or OpenCV. @throws CalibrationError if it is missing or no YAML.
inline YAML::Node loadCalibrationYaml(const std::string& file)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw CalibrationError(file + ": missing or not readable");
  }
  // OpenCV's "%YAML:1.0" is no directive that other parsers know.
  std::string text;
  for (std::string line; std::getline(stream, line);)
  {
    text += (line.rfind("%YAML", 0) == 0 ? "" : line) + "\n";
  }
  try
  {
    return YAML::Load(text);
  }
  catch (const YAML::Exception& exception)
  {
    throw CalibrationError(file + ": is not YAML: " + exception.what());
  }
}

}  // namespace pi_slam
