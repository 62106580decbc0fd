#include "truth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <utility>

namespace pi_detect::bench
{

namespace
{

constexpr int STEP_PX = 2;
constexpr double TOLERANCE_M = 0.3;
constexpr double TOLERANCE_PART = 0.05;  // of the distance
constexpr double REAL_PART = 0.1;        // likewise, for something to be no mere invention
constexpr double MIN_COVERED = 0.3;      // of an object's points, to count as found
constexpr size_t MIN_POINTS = 20;        // in view, at every second pixel of every second row
constexpr double MIN_VISIBLE_M = 0.25;   // height or width of what is seen
constexpr float BORDER_PX = 8.0F;
constexpr double LARGE_M = 0.5;
constexpr size_t REAL_POINTS = 4;
constexpr double MOVING_M_S = 0.5;
constexpr double SETTLED_S = 1.0;
constexpr double FREE_M = 15.0;        // bare ground so far away counts, ...
constexpr double BARE_M = 0.03;        // and ground so low
constexpr double SHAPE_M = 0.1;        // by which a point may be outside of the shape that holds it, ...
constexpr double SHAPE_PART = 0.05;    // and by this part of its distance
constexpr double SAME_MIDDLE_M = 0.4;  // of what is seen and what is published, to be compared at all

double quantile(std::vector<double> values, double part)
{
  if (values.empty())
  {
    return NAN;
  }
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(part * static_cast<double>(values.size() - 1))];
}

bool isInside(const FoundBox& box, const Eigen::Vector3d& point, double tolerance)
{
  return ((point - box.min).array() > -tolerance).all() && ((box.max - point).array() > -tolerance).all();
}

double toleranceOf(const FoundBox& box, double part)
{
  return TOLERANCE_M + part * box.distance_m;
}

}  // namespace

TruthCloud::TruthCloud(const Pair& pair, const StereoGeometry& geometry, const Eigen::Isometry3d& T_base_body,
                       const Eigen::Isometry3d& T_base_left, const StereoObstacleOptions& options, double min_depth_m)
{
  const Eigen::Isometry3d T_body_base = T_base_body.inverse();
  const double fb = geometry.fx * geometry.baseline_m;
  std::set<std::pair<int, int>> tiles;
  for (const TrueObject& object : pair.objects)
  {
    Seen seen;
    seen.object = &object;
    seen.distance_m = 1e9;
    seen.velocity_base = T_base_body.linear() * object.velocity;
    objects_.push_back(seen);
  }
  for (int v = 0; v < pair.depth.rows; v += STEP_PX)
  {
    for (int u = 0; u < pair.depth.cols; u += STEP_PX)
    {
      const double z = pair.depth.at<float>(v, u);
      const bool no_partner = u < fb / z;
      if (z <= 0.0 || z > 40.0)
      {
        continue;
      }
      const Eigen::Vector3d ray((u - geometry.cx) / geometry.fx, (v - geometry.cy) / geometry.fy, 1.0);
      const Eigen::Vector3d p = T_base_left * (z * ray);
      const Eigen::Vector3d p_body = T_body_base * p;
      const double height = (pair.T_world_body * p_body).z();  // rendered ground is at 0
      if (std::abs(height) < BARE_M && p.head<2>().norm() < FREE_M)
      {
        tiles.emplace(static_cast<int>(std::floor(p.x() / TILE_M)), static_cast<int>(std::floor(p.y() / TILE_M)));
      }
      if (height > 0.05 && height < options.max_height_m + 0.3)
      {
        raised_.push_back(p);
      }
      if (height < options.min_height_m || height > options.max_height_m || no_partner)
      {
        continue;
      }
      for (Seen& seen : objects_)
      {
        const TrueObject& object = *seen.object;
        if (u < object.box.x1 || u >= object.box.x2 || v < object.box.y1 || v >= object.box.y2)
        {
          continue;
        }
        const Eigen::Vector3d local =
            Eigen::AngleAxisd(-object.heading, Eigen::Vector3d::UnitZ()) * (p_body - object.position);
        if ((local.cwiseAbs() - 0.5 * object.size).maxCoeff() < 0.1)
        {
          seen.points.push_back(p);
          seen.distance_m = std::min(seen.distance_m, p.head<2>().norm());
          break;
        }
      }
    }
  }
  for (const auto& [x, y] : tiles)
  {
    free_tiles_.emplace_back((x + 0.5) * TILE_M, (y + 0.5) * TILE_M);
  }
  for (Seen& seen : objects_)
  {
    if (seen.points.size() < MIN_POINTS)
    {
      continue;
    }
    Eigen::Vector3d low = seen.points.front();
    Eigen::Vector3d high = low;
    for (const Eigen::Vector3d& p : seen.points)
    {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    seen.middle = 0.5 * (low + high);
    const Eigen::Vector3d& size = seen.object->size;
    seen.counts = size.maxCoeff() > LARGE_M && std::max(high.z() - low.z(), high.y() - low.y()) > MIN_VISIBLE_M &&
                  seen.distance_m > min_depth_m + 0.2;
    // Slivers at the picture's sides are not in view.
    const Box& box = seen.object->box;
    const bool at_side = box.x1 < BORDER_PX || box.x2 > static_cast<float>(geometry.width) - BORDER_PX;
    seen.counts = seen.counts && !(at_side && box.width() < 3.0F * BORDER_PX);
  }
}

double TruthCloud::covered(const Seen& seen, const FoundBox& box)
{
  const auto inside =
      std::count_if(seen.points.begin(), seen.points.end(),
                    [&](const Eigen::Vector3d& p) { return isInside(box, p, toleranceOf(box, TOLERANCE_PART)); });
  return static_cast<double>(inside) / static_cast<double>(std::max<size_t>(1, seen.points.size()));
}

bool TruthCloud::isReal(const FoundBox& box) const
{
  size_t count = 0;
  for (const Eigen::Vector3d& p : raised_)
  {
    count += isInside(box, p, toleranceOf(box, REAL_PART)) ? 1 : 0;
    if (count >= REAL_POINTS)
    {
      return true;
    }
  }
  return false;
}

void Score::addMeasured(const TruthCloud& truth, const std::vector<FoundBox>& boxes)
{
  missed_.clear();
  false_boxes_.clear();
  const auto& objects = truth.objects();
  // Several objects may be one obstacle: the nearest of them gives its distance.
  std::vector<double> nearest(boxes.size(), 1e9);
  std::vector<std::vector<double>> covered(objects.size(), std::vector<double>(boxes.size(), 0.0));
  for (size_t o = 0; o < objects.size(); ++o)
  {
    for (size_t b = 0; b < boxes.size(); ++b)
    {
      covered[o][b] = TruthCloud::covered(objects[o], boxes[b]);
      if (covered[o][b] > MIN_COVERED)
      {
        nearest[b] = std::min(nearest[b], objects[o].distance_m);
      }
    }
  }
  for (size_t o = 0; o < objects.size(); ++o)
  {
    const int band_index = static_cast<int>(objects[o].distance_m / BAND_M);
    if (!objects[o].counts || band_index >= BANDS)
    {
      continue;
    }
    Band& band = bands_[band_index];
    Band& of_class = classes_[objects[o].object->class_name];
    ++band.wanted;
    of_class.wanted += band_index < 2 ? 1 : 0;
    int best = -1;
    double total = 0.0;
    for (size_t b = 0; b < boxes.size(); ++b)
    {
      total += covered[o][b];
      // Of a large object that is found in pieces, the nearest piece gives the distance.
      const bool piece = covered[o][b] > 0.05;
      if (piece && (best < 0 || boxes[b].distance_m < boxes[static_cast<size_t>(best)].distance_m))
      {
        best = static_cast<int>(b);
      }
    }
    if (best < 0 || total < MIN_COVERED)
    {
      missed_.push_back(static_cast<int>(o));
      continue;
    }
    ++band.found;
    of_class.found += band_index < 2 ? 1 : 0;
    const double true_m = std::min(objects[o].distance_m, nearest[static_cast<size_t>(best)]);
    const double error = (boxes[static_cast<size_t>(best)].distance_m - true_m) / true_m;
    band.errors.push_back(error);
    of_class.errors.push_back(error);
  }
  for (size_t b = 0; b < boxes.size(); ++b)
  {
    ++boxes_;
    if (!truth.isReal(boxes[b]))
    {
      ++false_measured_;
      false_boxes_.insert(b);
    }
  }
}

void Score::addShapes(const TruthCloud& truth, const std::vector<Obstacle>& obstacles)
{
  const auto boxHas = [](const Obstacle& obstacle, const Eigen::Vector2d& p, double tolerance)
  { return ((p - obstacle.position.head<2>()).cwiseAbs() - 0.5 * obstacle.size.head<2>()).maxCoeff() <= tolerance; };
  const auto outlineHas = [&boxHas](const Obstacle& obstacle, const Eigen::Vector2d& p, double tolerance)
  { return obstacle.outline.empty() ? boxHas(obstacle, p, tolerance) : contains(obstacle.outline, p, tolerance); };
  const auto count = [&obstacles](const Eigen::Vector2d& p, double tolerance, const auto& has, size_t* number)
  {
    *number += std::any_of(obstacles.begin(), obstacles.end(),
                           [&](const Obstacle& obstacle) { return has(obstacle, p, tolerance); })
                   ? 1
                   : 0;
  };
  ++shape_pairs_;
  for (const TruthCloud::Seen& seen : truth.objects())
  {
    // What is not found at all is counted elsewhere.
    const double tolerance = SHAPE_M + SHAPE_PART * seen.distance_m;
    const auto found = [&](const Obstacle& obstacle)
    {
      return std::any_of(seen.points.begin(), seen.points.end(),
                         [&](const Eigen::Vector3d& p) { return boxHas(obstacle, p.head<2>(), tolerance); });
    };
    if (!seen.counts || seen.distance_m > FREE_M || std::none_of(obstacles.begin(), obstacles.end(), found))
    {
      continue;
    }
    points_ += seen.points.size();
    for (const Eigen::Vector3d& p : seen.points)
    {
      count(p.head<2>(), tolerance, boxHas, &of_boxes_.held);
      count(p.head<2>(), tolerance, outlineHas, &of_outlines_.held);
    }
  }
  for (const Eigen::Vector2d& tile : truth.freeTiles())
  {
    count(tile, 0.0, boxHas, &of_boxes_.tiles);
    count(tile, 0.0, outlineHas, &of_outlines_.tiles);
  }
}

void Score::addPublished(const TruthCloud& truth, const std::vector<Obstacle>& obstacles, int64_t stamp_ns)
{
  for (const Obstacle& obstacle : obstacles)
  {
    if (obstacle.last_seen_ns != stamp_ns)
    {
      continue;
    }
    const FoundBox box{obstacle.position - 0.5 * obstacle.size, obstacle.position + 0.5 * obstacle.size,
                       obstacle.distance_m};
    Life& life = lives_[obstacle.id];
    if (life.frames++ == 0)
    {
      life.first_ns = stamp_ns;
      life.first_position = obstacle.position;
      life.first_size = obstacle.size;
    }
    life.false_frames += truth.isReal(box) ? 0 : 1;
    // The object it is: the one of which most is inside, if it is about the only one.
    const TruthCloud::Seen* match = nullptr;
    int inside = 0;
    for (const TruthCloud::Seen& seen : truth.objects())
    {
      if (seen.counts && TruthCloud::covered(seen, box) > 0.5)
      {
        ++inside;
        if (std::abs(seen.middle.y() - obstacle.position.y()) > SAME_MIDDLE_M)
        {
          continue;
        }
        match = &seen;
      }
    }
    if (match == nullptr || inside != 1 || obstacle.distance_m > 2.0 * BAND_M ||
        1e-9 * static_cast<double>(stamp_ns - obstacle.first_seen_ns) < SETTLED_S)
    {
      continue;
    }
    const bool moves = match->velocity_base.norm() > MOVING_M_S;
    if (moves)
    {
      ++moving_wanted_;
      moving_found_ += obstacle.moving ? 1 : 0;
      speed_errors_.push_back((obstacle.velocity - match->velocity_base).head<2>().norm());
    }
    else
    {
      ++standing_;
      standing_moving_ += obstacle.moving ? 1 : 0;
    }
  }
}

void Score::print(const std::string& name, double minutes) const
{
  std::printf("%s\n  %-12s %8s %8s %12s %12s %12s\n", name.c_str(), "distance", "in view", "recall", "error med",
              "|error| med", "|error| p95");
  const auto line = [](const std::string& label, const Band& band)
  {
    std::vector<double> magnitudes;
    for (const double error : band.errors)
    {
      magnitudes.push_back(std::abs(error));
    }
    std::printf("  %-12s %8d %7.1f%% %11.1f%% %11.1f%% %11.1f%%\n", label.c_str(), band.wanted,
                100.0 * band.found / std::max(1, band.wanted), 100.0 * quantile(band.errors, 0.5),
                100.0 * quantile(magnitudes, 0.5), 100.0 * quantile(magnitudes, 0.95));
  };
  for (int i = 0; i < BANDS; ++i)
  {
    line(std::to_string(static_cast<int>(i * BAND_M)) + "-" + std::to_string(static_cast<int>((i + 1) * BAND_M)) + " m",
         bands_[i]);
  }
  for (const auto& [class_name, band] : classes_)
  {
    line(class_name, band);
  }
  int false_lives = 0;
  for (const auto& [id, life] : lives_)
  {
    false_lives += 2 * life.false_frames > life.frames ? 1 : 0;
  }
  std::printf("  measured %d boxes, false %d; published %zu obstacles, false %d: %.2f per minute\n", boxes_,
              false_measured_, lives_.size(), false_lives, false_lives / minutes);
  for (const auto& [id, life] : lives_)
  {
    if (2 * life.false_frames > life.frames)
    {
      std::printf(
          "    false: #%lld from stamp %lld on, in %d of %d pairs, first at (%.1f, %.1f, %.1f) m, size (%.1f, %.1f, "
          "%.1f) m\n",
          static_cast<long long>(id), static_cast<long long>(life.first_ns), life.false_frames, life.frames,
          life.first_position.x(), life.first_position.y(), life.first_position.z(), life.first_size.x(),
          life.first_size.y(), life.first_size.z());
    }
  }
  std::printf(
      "  moving: %d of %d known as such, velocity error median %.2f m/s, p95 %.2f m/s; standing: %d of %d "
      "taken for moving\n",
      moving_found_, moving_wanted_, quantile(speed_errors_, 0.5), quantile(speed_errors_, 0.95), standing_moving_,
      standing_);
  const auto shapes = [this](const char* shape, const Shapes& of)
  {
    std::printf("  %s hold %.1f %% of the objects' points and cover %.2f m^2 of bare ground per pair\n", shape,
                100.0 * static_cast<double>(of.held) / static_cast<double>(std::max<size_t>(1, points_)),
                TruthCloud::TILE_M * TruthCloud::TILE_M * static_cast<double>(of.tiles) /
                    static_cast<double>(std::max<size_t>(1, shape_pairs_)));
  };
  shapes("boxes", of_boxes_);
  shapes("outlines", of_outlines_);
}

}  // namespace pi_detect::bench
