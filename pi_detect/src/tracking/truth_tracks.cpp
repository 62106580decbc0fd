#include "tracking/mot_metrics.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>

namespace pi_detect
{
namespace
{

Box between(const Box& a, const Box& b, float part)
{
  return {a.x1 + part * (b.x1 - a.x1), a.y1 + part * (b.y1 - a.y1), a.x2 + part * (b.x2 - a.x2),
          a.y2 + part * (b.y2 - a.y2)};
}

/// Reads exactly "%d,%d,%f,%f,%f,%f".
bool parse(const std::string& line, int* frame, int64_t* id, Box* box)
{
  std::istringstream text(line);
  char comma[5] = {};
  text >> *frame >> comma[0] >> *id >> comma[1] >> box->x1 >> comma[2] >> box->y1 >> comma[3] >> box->x2 >> comma[4] >>
      box->y2;
  return text && (text >> std::ws).eof() &&
         std::all_of(std::begin(comma), std::end(comma), [](char c) { return c == ','; });
}

}  // namespace

TruthTracks TruthTracks::load(const std::string& path)
{
  std::ifstream file(path);
  if (!file)
  {
    throw std::runtime_error(path + ": cannot be read");
  }
  int first = 0;
  int last = -1;
  std::map<int64_t, std::map<int, Box>> key_frames;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number)
  {
    const std::string where = path + ":" + std::to_string(number) + ": ";
    if (line.rfind("# frames ", 0) == 0)
    {
      std::istringstream range(line.substr(9));
      if (!(range >> first >> last) || first < 0 || last < first)
      {
        throw std::runtime_error(where + "'" + line + "', must be '# frames FIRST LAST' with 0 <= FIRST <= LAST");
      }
      continue;
    }
    if (line.empty() || line[0] == '#')
    {
      continue;
    }
    int frame = 0;
    int64_t id = 0;
    Box box;
    if (!parse(line, &frame, &id, &box))
    {
      throw std::runtime_error(where + "'" + line + "', must be frame,id,x1,y1,x2,y2");
    }
    if (last < first)
    {
      throw std::runtime_error(where + "a box before the line '# frames FIRST LAST'");
    }
    if (frame < first || frame > last)
    {
      throw std::runtime_error(where + "frame " + std::to_string(frame) + ", must be in [" + std::to_string(first) +
                               ", " + std::to_string(last) + "]");
    }
    if (!(box.x1 < box.x2 && box.y1 < box.y2))
    {
      throw std::runtime_error(where + "'" + line + "', must have x1 < x2 and y1 < y2");
    }
    if (!key_frames[id].emplace(frame, box).second)
    {
      throw std::runtime_error(where + "id " + std::to_string(id) + " is twice in frame " + std::to_string(frame));
    }
  }
  if (last < first)
  {
    throw std::runtime_error(path + ": has no line '# frames FIRST LAST'");
  }

  TruthTracks truth;
  truth.first_frame = first;
  truth.pictures.resize(static_cast<size_t>(last - first + 1));
  for (const auto& [id, frames] : key_frames)
  {
    for (int frame = frames.begin()->first; frame <= frames.rbegin()->first; ++frame)
    {
      const auto after = frames.lower_bound(frame);
      const auto before = after->first == frame ? after : std::prev(after);
      const int span = after->first - before->first;
      const Box box = between(before->second, after->second,
                              span == 0 ? 0.0F : static_cast<float>(frame - before->first) / static_cast<float>(span));
      Picture& picture = truth.pictures[static_cast<size_t>(frame - first)];
      if (id == 0)
      {
        picture.ignored.push_back(box);
      }
      else
      {
        picture.boxes.push_back({id, box});
      }
    }
  }
  return truth;
}

}  // namespace pi_detect
