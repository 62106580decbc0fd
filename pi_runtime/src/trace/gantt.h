#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include <pi_runtime/trace.h>

namespace pi_runtime
{

struct GanttOptions
{
  double from_s = 0;                                      ///< start of the picture after the first task's start [s]
  double to_s = std::numeric_limits<double>::infinity();  ///< its end [s]; infinity: the end of the last task
  int width = 1600;                                       ///< of the picture [px], in [600, 20000]

  /// @throws std::invalid_argument, naming field, value and bound.
  void validate() const;
};

struct GanttImage
{
  int width = 0;
  int height = 0;
  std::vector<uint8_t> bgr;  ///< rows from top to bottom, three bytes per pixel: blue, green, red
};

/// Part of the time [from_ns, to_ns) in which each unit, by number, ran or transferred something, in [0, 1].
/// @param units  number of units, at least; records may name more.
std::vector<double> unitUtilisation(const std::vector<TaskTrace>& records, size_t units, int64_t from_ns,
                                    int64_t to_ns);

/// Draws when which unit ran what: a row per unit, a colour per codelet, the transfer in front of a run hatched, the
/// time by which a deadline was missed as a red strip under the bar, and the utilisation at the right. Where tasks are
/// narrower than a pixel, its shade says how much of its time the unit was busy. Tasks that never ran are only counted.
/// @param units  names by unit number; letters other than ASCII are drawn as "?".
/// @throws std::invalid_argument if the options are invalid, or the picture would have no duration.
GanttImage drawGantt(const std::vector<TaskTrace>& records, const std::vector<std::string>& units,
                     const GanttOptions& options = GanttOptions());

/// Draws it into a file. @param path  ends in ".png".
/// @throws as drawGantt(); std::runtime_error, naming the file, if it cannot be written.
void writeGantt(const std::string& path, const std::vector<TaskTrace>& records, const std::vector<std::string>& units,
                const GanttOptions& options = GanttOptions());

}  // namespace pi_runtime
