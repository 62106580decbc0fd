#include "obstacles/occupancy_grid.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_detect
{

namespace
{

constexpr float FREE = -0.4F;          // log odds of a cell in which nothing was seen
constexpr float OCCUPIED = 0.85F;      // of one in which something was, measured to within a cell
constexpr float MOST = 4.0F;           // either way, so that what changes is believed after some views
constexpr float LEAST_FREE = 0.8F;     // below it, negative, a cell counts as free at any distance
constexpr double SURE_M = 4.0;         // farther away, views miss what is small: their number makes free no surer
constexpr float KNOWN = 0.2F;          // from here on
constexpr double FADE_PERIOD_S = 1.0;  // in which every row fades once
constexpr double JUMP_M = 2.0;         // between two views: odometry began anew
constexpr double OUTSIDE_M = 0.3;      // by which what is left out may be larger than its outline

}  // namespace

void OccupancyGridOptions::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("cell_m", cell_m, 0.02, 1.0);
  check.range("size_m", size_m, 10.0 * cell_m, 2000.0 * cell_m);
  check.range("memory_s", memory_s, 1.0, 3600.0);
  check.range("max_sigma_m", max_sigma_m, 0.01, 10.0);
  check.range("rate_hz", rate_hz, 0.1, 100.0);
}

OccupancyGrid::OccupancyGrid(const OccupancyGridOptions& options)
  : options_((options.validate(), options))
  , side_(static_cast<int>(std::lround(options.size_m / options.cell_m)))
  , log_odds_(static_cast<size_t>(side_) * static_cast<size_t>(side_), 0.0F)
  , changed_(log_odds_.size(), 0)
{
}

void OccupancyGrid::clear()
{
  std::fill(log_odds_.begin(), log_odds_.end(), 0.0F);
  placed_ = false;
  stamp_ns_ = 0;
}

static int modulo(int value, int side)
{
  const int rest = value % side;
  return rest < 0 ? rest + side : rest;
}

float& OccupancyGrid::at(const Index& cell)
{
  return log_odds_[static_cast<size_t>(modulo(cell.y(), side_)) * static_cast<size_t>(side_) +
                   static_cast<size_t>(modulo(cell.x(), side_))];
}

OccupancyGrid::Index OccupancyGrid::indexOf(const Eigen::Vector2d& p_odom) const
{
  return (p_odom.array() / options_.cell_m).floor().cast<int>();
}

Eigen::Vector2d OccupancyGrid::origin() const
{
  return options_.cell_m * low_.cast<double>().matrix();
}

void OccupancyGrid::clearLines(int axis, int from, int to)
{
  for (int line = from; line < to; ++line)
  {
    for (int i = 0; i < side_; ++i)
    {
      const Index cell = axis == 0 ? Index(line, i) : Index(i, line);
      at(cell) = 0.0F;
    }
  }
}

void OccupancyGrid::moveTo(const Index& middle)
{
  const Index low = middle - side_ / 2;
  if (!placed_ || (low - low_).abs().maxCoeff() >= side_)
  {
    std::fill(log_odds_.begin(), log_odds_.end(), 0.0F);
  }
  else
  {
    for (const int axis : {0, 1})
    {
      clearLines(axis, low_(axis) + side_, low(axis) + side_);  // one of the two is empty
      clearLines(axis, low(axis), low_(axis));
    }
  }
  low_ = low;
  placed_ = true;
}

void OccupancyGrid::fade(int64_t stamp_ns)
{
  const double passed_s = std::clamp(pi_node::seconds(stamp_ns - stamp_ns_), 0.0, FADE_PERIOD_S);
  const int rows = static_cast<int>(std::ceil(passed_s / FADE_PERIOD_S * side_));
  const auto factor = static_cast<float>(std::exp(-FADE_PERIOD_S / options_.memory_s));
  for (int i = 0; i < rows; ++i)
  {
    fade_row_ = (fade_row_ + 1) % side_;
    float* row = &log_odds_[static_cast<size_t>(fade_row_) * static_cast<size_t>(side_)];
    std::for_each(row, row + side_, [factor](float& cell) { cell *= factor; });
  }
}

void OccupancyGrid::change(const Index& cell, float by, float least)
{
  if ((cell < low_).any() || (cell >= low_ + side_).any())
  {
    return;
  }
  float& value = at(cell);
  uint32_t& changed = changed_[static_cast<size_t>(&value - log_odds_.data())];
  if (changed != view_)
  {
    changed = view_;
    value = std::clamp(value + by, std::min(value, least), MOST);
  }
}

void OccupancyGrid::fill(const Outline& outline_odom, float by)
{
  const OutlineBounds bounds = boundsOf(outline_odom);
  const Index low = indexOf(bounds.low);
  const Index high = indexOf(bounds.high);
  for (int y = low.y(); y <= high.y(); ++y)
  {
    for (int x = low.x(); x <= high.x(); ++x)
    {
      if (contains(outline_odom, options_.cell_m * (Eigen::Vector2d(x, y).array() + 0.5).matrix()))
      {
        change({x, y}, by, -MOST);
      }
    }
  }
}

void OccupancyGrid::add(int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base, const GroundView& view,
                        const std::vector<Outline>& left_out, const Outline& vehicle)
{
  if (stamp_ns <= stamp_ns_)
  {
    if (pi_node::seconds(stamp_ns_ - stamp_ns) <= 1.0)
    {
      return;
    }
    clear();  // time began anew
  }
  const Eigen::Vector3d forward = T_odom_base.linear().col(0);
  const double heading = std::atan2(forward.y(), forward.x());
  const Eigen::Rotation2Dd R_odom_base(heading);
  const Eigen::Vector2d p_odom_base = T_odom_base.translation().head<2>();
  if (placed_ && (p_odom_base - p_odom_last_).norm() > JUMP_M)
  {
    clear();
  }
  p_odom_last_ = p_odom_base;
  const Eigen::Vector2d camera = p_odom_base + R_odom_base * view.camera;
  moveTo(indexOf(p_odom_base));
  if (stamp_ns_ != 0)
  {
    fade(stamp_ns);
  }
  stamp_ns_ = stamp_ns;
  ++view_;

  // What is occupied first: at its foot the ground may be seen as well.
  const double step = 0.7 * options_.cell_m;
  const auto alongBeam = [&](const GroundBeam& beam, double from, double to, const auto& visit)
  {
    const int rays = std::max(1, static_cast<int>(std::ceil(view.beam_rad * to / step)));
    for (int i = 0; i < rays; ++i)
    {
      const double bearing = beam.bearing + view.beam_rad * ((i + 0.5) / rays - 0.5);
      const Eigen::Vector2d direction(std::cos(heading + bearing), std::sin(heading + bearing));
      for (double distance = from; distance <= to; distance += step)
      {
        visit(indexOf(camera + distance * direction), distance);
      }
    }
  };
  for (const GroundBeam& beam : view.beams)
  {
    const Eigen::Vector2d direction(std::cos(beam.bearing), std::sin(beam.bearing));
    for (size_t i = 0; i < beam.hit_count; ++i)
    {
      const GroundBeam::Hit& hit = beam.hits[i];
      const Eigen::Vector2d p_base = view.camera + static_cast<double>(hit.distance) * direction;
      if (hit.sigma > options_.max_sigma_m ||
          std::any_of(left_out.begin(), left_out.end(),
                      [&p_base](const Outline& outline) { return contains(outline, p_base, OUTSIDE_M); }))
      {
        continue;
      }
      const double half = std::max<double>(hit.sigma, 0.5 * options_.cell_m);
      const auto weight = static_cast<float>(OCCUPIED * std::min(1.0, options_.cell_m / (2.0 * half)));
      alongBeam(beam, hit.distance - half, hit.distance + half,
                [&](const Index& cell, double) { change(cell, weight, -MOST); });
    }
  }
  for (const GroundBeam& beam : view.beams)
  {
    if (beam.free_to > beam.free_from)
    {
      alongBeam(beam, beam.free_from, beam.free_to,
                [this](const Index& cell, double distance)
                {
                  const double part = std::min(1.0, SURE_M * SURE_M / (distance * distance));
                  change(cell, FREE, -std::max(LEAST_FREE, MOST * static_cast<float>(part)));
                });
    }
  }
  Outline driven_over;
  for (const Eigen::Vector2d& corner : vehicle)
  {
    driven_over.push_back(p_odom_base + R_odom_base * corner);
  }
  if (!driven_over.empty())
  {
    fill(driven_over, FREE);
  }
}

std::vector<int8_t> OccupancyGrid::cells() const
{
  std::vector<int8_t> cells(log_odds_.size(), -1);
  for (int y = 0; y < side_; ++y)
  {
    for (int x = 0; x < side_; ++x)
    {
      const float value = log_odds_[static_cast<size_t>(modulo(low_.y() + y, side_)) * static_cast<size_t>(side_) +
                                    static_cast<size_t>(modulo(low_.x() + x, side_))];
      if (std::abs(value) >= KNOWN)
      {
        cells[static_cast<size_t>(y) * static_cast<size_t>(side_) + static_cast<size_t>(x)] =
            static_cast<int8_t>(std::lround(100.0F / (1.0F + std::exp(-value))));
      }
    }
  }
  return cells;
}

}  // namespace pi_detect
