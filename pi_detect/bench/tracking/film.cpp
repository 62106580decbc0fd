#include "tracking/film.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/videoio.hpp>
#include <stdexcept>

namespace pi_detect
{
namespace
{

constexpr float LEAST_INSIDE = 0.5F;  // of a box, to count as seen

/// Place after a way on a line of a length, turning back at its ends.
int turningBack(double way, int length)
{
  if (length == 0)
  {
    return 0;
  }
  const double period = 2.0 * length;
  const double phase = way - period * std::floor(way / period);
  return static_cast<int>(std::lround(phase <= length ? phase : period - phase));
}

}  // namespace

Film Film::load(const std::string& path, const std::string& truth, double frame_rate, const Window& window)
{
  Film film;
  film.truth = TruthTracks::load(truth);
  cv::VideoCapture video(path);
  film.frame_rate = frame_rate > 0.0 ? frame_rate : video.get(cv::CAP_PROP_FPS);
  if (!(film.frame_rate > 0.0))
  {
    throw std::runtime_error(path + ": has no frame rate, give --frame-rate");
  }
  const size_t wanted = film.truth.pictures.size();
  cv::Mat picture;
  for (int frame = 0; film.pictures.size() < wanted && video.read(picture); ++frame)
  {
    if (frame < film.truth.first_frame)
    {
      continue;
    }
    const int width = window.width == 0 ? picture.cols : window.width;
    const int room = picture.cols - width;
    if (room < 0 || window.start < 0 || window.start > room)
    {
      throw std::invalid_argument("the window reaches beyond the picture, which is " + std::to_string(picture.cols) +
                                  " px wide");
    }
    const double seconds = static_cast<double>(film.pictures.size()) / film.frame_rate;
    film.left.push_back(turningBack(window.start + window.speed * seconds, room));
    film.pictures.push_back(picture(cv::Rect(film.left.back(), 0, width, picture.rows)).clone());
  }
  if (film.pictures.size() != wanted)
  {
    throw std::runtime_error(path + ": cannot be read up to frame " +
                             std::to_string(film.truth.first_frame + static_cast<int>(wanted) - 1));
  }
  if (window.width != 0)
  {
    film.truth = throughWindow(film.truth, film.left, window.width);
  }
  return film;
}

PictureMotion Film::motion(size_t from, size_t to) const
{
  const Eigen::Vector2d shift(left[from] - left[to], 0.0);
  return [shift](const Eigen::Vector2d& point) -> Eigen::Vector2d { return point + shift; };
}

TruthTracks throughWindow(const TruthTracks& truth, const std::vector<int>& left, int width)
{
  TruthTracks seen;
  seen.first_frame = truth.first_frame;
  int64_t last_id = 0;
  std::map<int64_t, std::pair<size_t, int64_t>> shown;  // by id in the picture: number of the last picture, id here
  for (size_t i = 0; i < truth.pictures.size(); ++i)
  {
    const auto inside = [&left, width, i](Box box)
    {
      const auto edge = static_cast<float>(left[i]);
      box.x1 = std::clamp(box.x1 - edge, 0.0F, static_cast<float>(width));
      box.x2 = std::clamp(box.x2 - edge, 0.0F, static_cast<float>(width));
      return box;
    };
    TruthTracks::Picture picture;
    for (const Box& box : truth.pictures[i].ignored)
    {
      picture.ignored.push_back(inside(box));
    }
    for (const IdentifiedBox& object : truth.pictures[i].boxes)
    {
      const Box box = inside(object.box);
      if (box.area() < LEAST_INSIDE * object.box.area())
      {
        picture.ignored.push_back(box);
        continue;
      }
      const auto known = shown.find(object.id);
      const bool goes_on = known != shown.end() && known->second.first + 1 == i;
      const int64_t id = goes_on ? known->second.second : ++last_id;
      shown[object.id] = {i, id};
      picture.boxes.push_back({id, box});
    }
    seen.pictures.push_back(picture);
  }
  return seen;
}

}  // namespace pi_detect
