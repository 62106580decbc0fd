#include "evaluation/trajectory_plot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

namespace pi_slam
{

namespace
{

constexpr int WIDTH = 1600;
constexpr int HEIGHT = 1000;
/// Drawn this much larger and made smaller at the end, which smooths OpenCV's stroke fonts.
constexpr int SCALE = 2;
/// Fractional bits of OpenCV's drawing coordinates.
constexpr int SHIFT = 4;
/// Far outside of the picture it does not matter where, but OpenCV's integers end [px].
constexpr double LIMIT = 1e5;

const cv::Scalar BACKGROUND(255, 255, 255);
const cv::Scalar INK(50, 45, 40);
const cv::Scalar FAINT_INK(125, 118, 110);
const cv::Scalar GRID(234, 231, 228);
const cv::Scalar TRUTH(150, 145, 140);
/// Of trajectories, told apart by the colour-blind as well (Okabe and Ito 2008); BGR.
const cv::Scalar CURVES[] = {{178, 114, 0}, {0, 94, 213}, {115, 158, 0}, {167, 121, 204}};
const cv::Scalar SPANS[] = {{200, 225, 255}, {215, 240, 215}, {215, 205, 250}, {245, 230, 210}};

using Points = std::vector<cv::Point2d>;

/// Range of an axis.
struct Range
{
  double low = std::numeric_limits<double>::max();
  double high = std::numeric_limits<double>::lowest();

  void add(double value)
  {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  bool empty() const { return low > high; }
  double length() const { return high - low; }
  void widenTo(double length)
  {
    const double centre = 0.5 * (low + high);
    low = centre - 0.5 * length;
    high = centre + 0.5 * length;
  }
};

/// A picture with coordinates of the final size.
class Canvas
{
public:
  Canvas() : picture_(HEIGHT * SCALE, WIDTH * SCALE, CV_8UC3, BACKGROUND) {}

  void line(const Points& points, const cv::Scalar& color, double width)
  {
    std::vector<cv::Point> fixed;
    fixed.reserve(points.size());
    for (const cv::Point2d& point : points)
    {
      const cv::Point next = toFixed(point);
      if (fixed.empty() || next != fixed.back())
      {
        fixed.push_back(next);
      }
    }
    cv::polylines(picture_, fixed, false, color, static_cast<int>(std::lround(width * SCALE)), cv::LINE_AA, SHIFT);
  }

  void box(const cv::Rect2d& area, const cv::Scalar& color, bool filled)
  {
    const cv::Rect pixels(static_cast<int>(std::lround(area.x * SCALE)), static_cast<int>(std::lround(area.y * SCALE)),
                          static_cast<int>(std::lround(area.width * SCALE)),
                          static_cast<int>(std::lround(area.height * SCALE)));
    cv::rectangle(picture_, pixels, color, filled ? static_cast<int>(cv::FILLED) : SCALE);
  }

  void disc(const cv::Point2d& centre, double radius, const cv::Scalar& color)
  {
    cv::circle(picture_, toFixed(centre), static_cast<int>(std::lround(radius * SCALE * (1 << SHIFT))), color,
               cv::FILLED, cv::LINE_AA, SHIFT);
  }

  static double textWidth(const std::string& text, double height)
  {
    int baseline = 0;
    return static_cast<double>(
               cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, fontScale(height), thickness(height), &baseline).width) /
           SCALE;
  }

  /// @param height  of capitals.
  /// @param anchor  on the line on which letters stand.
  /// @param part    of the text's width that is left of the anchor: 0 to 1.
  void text(const std::string& text, const cv::Point2d& anchor, double height, const cv::Scalar& color,
            double part = 0.0)
  {
    const cv::Point origin(static_cast<int>(std::lround((anchor.x - part * textWidth(text, height)) * SCALE)),
                           static_cast<int>(std::lround(anchor.y * SCALE)));
    cv::putText(picture_, text, origin, cv::FONT_HERSHEY_SIMPLEX, fontScale(height), color, thickness(height),
                cv::LINE_AA);
  }

  /// Everything is drawn within an area only, until the guard ends.
  class Clip
  {
  public:
    Clip(Canvas* canvas, const cv::Rect2d& area) : canvas_(*canvas), whole_(canvas->picture_)
    {
      const cv::Rect pixels(static_cast<int>(area.x * SCALE), static_cast<int>(area.y * SCALE),
                            static_cast<int>(area.width * SCALE), static_cast<int>(area.height * SCALE));
      canvas_.picture_ = whole_(pixels);
      canvas_.origin_ = cv::Point2d(pixels.x, pixels.y);
    }
    ~Clip()
    {
      canvas_.picture_ = whole_;
      canvas_.origin_ = {};
    }
    Clip(const Clip&) = delete;
    Clip& operator=(const Clip&) = delete;

  private:
    Canvas& canvas_;
    cv::Mat whole_;
  };

  cv::Mat finish() const
  {
    cv::Mat smaller;
    cv::resize(picture_, smaller, {WIDTH, HEIGHT}, 0.0, 0.0, cv::INTER_AREA);
    return smaller;
  }

private:
  static double fontScale(double height) { return height * SCALE / 21.0; }  // capitals are 21 px high at scale 1
  static int thickness(double height) { return height >= 14.0 ? 2 * SCALE - 1 : SCALE; }

  cv::Point toFixed(const cv::Point2d& point) const
  {
    const auto fix = [](double value)
    { return static_cast<int>(std::lround(std::clamp(value, -LIMIT, LIMIT) * (1 << SHIFT))); };
    return {fix(point.x * SCALE - origin_.x), fix(point.y * SCALE - origin_.y)};
  }

  cv::Mat picture_;
  cv::Point2d origin_;  // of a clipped area [px of the large picture]
};

/// 1, 2 or 5 times a power of ten, so that about `count` of it fill the length.
double tickStep(double length, double count)
{
  const double rough = length / count;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0})
  {
    if (factor * power >= rough)
    {
      return factor * power;
    }
  }
  return 10.0 * power;
}

std::string number(double value, double step)
{
  const int decimals = std::clamp(static_cast<int>(-std::floor(std::log10(step) + 1e-9)), 0, 9);
  const double rounded = std::abs(value) < 1e-6 * step ? 0.0 : value;  // no "-0"
  char text[64];
  std::snprintf(text, sizeof(text), std::abs(rounded) < 1e7 ? "%.*f" : "%.*e", decimals, rounded);
  return text;
}

/// Multiples of a step within a range.
std::vector<double> ticks(const Range& range, double step)
{
  std::vector<double> values;
  const double first = std::ceil(range.low / step);
  const auto count = static_cast<int>(std::clamp((range.high - range.low) / step + 1.0, 0.0, 100.0));
  for (int i = 0; i <= count; ++i)
  {
    const double value = (first + i) * step;
    if (value <= range.high + 1e-9 * step)
    {
      values.push_back(value);
    }
  }
  return values;
}

/// A diagram: title, frame, ticks with numbers.
class Axes
{
public:
  Axes(Canvas* canvas, const cv::Rect2d& area, const Range& x, const Range& y)
    : canvas_(*canvas), area_(area), x_(x), y_(y)
  {
  }

  cv::Point2d toPixel(const cv::Point2d& value) const
  {
    return {area_.x + (value.x - x_.low) / x_.length() * area_.width,
            area_.y + area_.height - (value.y - y_.low) / y_.length() * area_.height};
  }

  void drawGrid(const std::string& title, const std::string& x_name)
  {
    constexpr double TEXT = 9.0;
    const double x_step = tickStep(x_.length(), area_.width / 90.0);
    for (const double value : ticks(x_, x_step))
    {
      const double at = toPixel({value, y_.low}).x;
      canvas_.line({{at, area_.y}, {at, area_.y + area_.height}}, GRID, 1.0);
      canvas_.text(number(value, x_step), {at, area_.y + area_.height + TEXT + 8.0}, TEXT, INK, 0.5);
    }
    const double y_step = tickStep(y_.length(), std::max(area_.height / 55.0, 2.0));
    for (const double value : ticks(y_, y_step))
    {
      const double at = toPixel({x_.low, value}).y;
      canvas_.line({{area_.x, at}, {area_.x + area_.width, at}}, GRID, 1.0);
      canvas_.text(number(value, y_step), {area_.x - 8.0, at + 0.5 * TEXT}, TEXT, INK, 1.0);
    }
    canvas_.text(title, {area_.x, area_.y - 10.0}, 11.0, INK);
    canvas_.text(x_name, {area_.x + area_.width, area_.y + area_.height + 2.0 * TEXT + 18.0}, TEXT, FAINT_INK, 1.0);
  }

  void drawFrame() { canvas_.box(area_, FAINT_INK, false); }

  void shade(double from, double to, const cv::Scalar& color)
  {
    const double left = std::clamp(toPixel({from, 0.0}).x, area_.x, area_.x + area_.width);
    const double right = std::clamp(toPixel({to, 0.0}).x, area_.x, area_.x + area_.width);
    canvas_.box({left, area_.y, std::max(right - left, 1.0), area_.height}, color, true);
  }

  void draw(const Points& values, const cv::Scalar& color, double width)
  {
    Points pixels;
    pixels.reserve(values.size());
    for (const cv::Point2d& value : values)
    {
      pixels.push_back(toPixel(value));
    }
    const Canvas::Clip clip(&canvas_, area_);
    canvas_.line(pixels, color, width);
  }

  void mark(const cv::Point2d& value, const cv::Scalar& color)
  {
    canvas_.disc(toPixel(value), 6.0, BACKGROUND);
    canvas_.disc(toPixel(value), 4.5, color);
  }

private:
  Canvas& canvas_;
  cv::Rect2d area_;
  Range x_;
  Range y_;
};

/// Beyond it, doubles have no decimetres left, and nothing is a measurement any more.
bool isDrawable(double value)
{
  return std::abs(value) < 1e12;
}

std::string ascii(std::string text)
{
  for (char& character : text)
  {
    character = character >= ' ' && character <= '~' ? character : '?';
  }
  return text;
}

/// A curve of a diagram.
struct Curve
{
  Points points;
  cv::Scalar color;
  double width;
};

/// Positions, one axis across and one up.
Points projected(const std::vector<StampedPose>& poses, int across, int up)
{
  Points points;
  points.reserve(poses.size());
  for (const StampedPose& pose : poses)
  {
    const Eigen::Vector3d p = pose.T_world_body.translation();
    if (isDrawable(p[across]) && isDrawable(p[up]))
    {
      points.emplace_back(p[across], p[up]);
    }
  }
  return points;
}

class Drawing
{
public:
  explicit Drawing(const TrajectoryPlot& plot) : plot_(plot) { findStart(); }

  cv::Mat draw()
  {
    canvas_.text(ascii(plot_.title), {70.0, 42.0}, 18.0, INK);
    canvas_.text(ascii(plot_.subtitle), {70.0, 70.0}, 10.5, FAINT_INK);
    drawPath("Top view: y over x [m]", "x [m]", {70.0, 130.0, 690.0, 490.0}, 0, 1);
    drawPath("Side view: z over x [m]", "x [m]", {70.0, 700.0, 690.0, 170.0}, 0, 2);
    const cv::Rect2d upper(860.0, 130.0, 690.0, 310.0);
    const cv::Rect2d lower(860.0, 545.0, 690.0, 325.0);
    if (hasErrors())
    {
      drawOverTime("Position error [m]", upper, errors(&PlottedTrajectory::position_errors, 1.0), true);
      drawOverTime("Rotation error [deg]", lower, errors(&PlottedTrajectory::rotation_errors, 180.0 / M_PI), true);
    }
    else
    {
      drawOverTime("Distance from the start [m]", upper, distances(), true);
      drawOverTime("Heading [deg]", lower, headings(), false);
    }
    drawLegend();
    return canvas_.finish();
  }

private:
  void findStart()
  {
    int64_t first = std::numeric_limits<int64_t>::max();
    for (const PlottedTrajectory& trajectory : plot_.trajectories)
    {
      if (!trajectory.poses.empty())
      {
        first = std::min(first, trajectory.poses.front().stamp_ns);
      }
      if (!trajectory.error_stamps.empty())
      {
        first = std::min(first, trajectory.error_stamps.front());
      }
    }
    for (const PlottedSpan& span : plot_.spans)
    {
      first = std::min(first, span.from_ns);
    }
    start_ns_ = first == std::numeric_limits<int64_t>::max() ? 0 : first;
  }

  double seconds(int64_t stamp_ns) const { return 1e-9 * static_cast<double>(stamp_ns - start_ns_); }

  bool hasErrors() const
  {
    return std::any_of(plot_.trajectories.begin(), plot_.trajectories.end(),
                       [](const PlottedTrajectory& trajectory) { return !trajectory.error_stamps.empty(); });
  }

  static const cv::Scalar& colorOf(size_t trajectory) { return CURVES[trajectory % std::size(CURVES)]; }

  /// Of all points; 0 where there are none.
  static std::pair<Range, Range> extent(const std::vector<Curve>& curves)
  {
    Range x;
    Range y;
    for (const Curve& curve : curves)
    {
      for (const cv::Point2d& point : curve.points)
      {
        x.add(point.x);
        y.add(point.y);
      }
    }
    if (x.empty())
    {
      x = y = {0.0, 0.0};
    }
    return {x, y};
  }

  void drawPath(const std::string& title, const std::string& x_name, const cv::Rect2d& area, int across, int up)
  {
    std::vector<Curve> curves{{projected(plot_.truth, across, up), TRUTH, 4.0}};
    for (size_t i = plot_.trajectories.size(); i-- > 0;)
    {
      curves.push_back({projected(plot_.trajectories[i].poses, across, up), colorOf(i), 1.6});
    }
    auto [x, y] = extent(curves);
    // The same scale in both directions, and never less than a decimetre.
    const double scale = std::max({1.12 * x.length() / area.width, 1.12 * y.length() / area.height, 0.1 / area.height});
    x.widenTo(scale * area.width);
    y.widenTo(scale * area.height);
    Axes axes(&canvas_, area, x, y);
    axes.drawGrid(title, x_name);
    for (const Curve& curve : curves)
    {
      axes.draw(curve.points, curve.color, curve.width);
    }
    for (const Curve& curve : curves)
    {
      if (!curve.points.empty() && curve.width < 2.0)
      {
        axes.mark(curve.points.front(), curve.color);
      }
    }
    axes.drawFrame();
  }

  std::vector<Curve> errors(std::vector<double> PlottedTrajectory::*values, double scale) const
  {
    std::vector<Curve> curves;
    for (size_t i = plot_.trajectories.size(); i-- > 0;)
    {
      const PlottedTrajectory& trajectory = plot_.trajectories[i];
      Curve curve{{}, colorOf(i), 1.4};
      for (size_t j = 0; j < trajectory.error_stamps.size(); ++j)
      {
        const double value = scale * (trajectory.*values)[j];
        if (isDrawable(value))
        {
          curve.points.emplace_back(seconds(trajectory.error_stamps[j]), value);
        }
      }
      curves.push_back(std::move(curve));
    }
    return curves;
  }

  std::vector<Curve> distances() const
  {
    return ofPoses([](const StampedPose& first, const StampedPose& pose)
                   { return (pose.T_world_body.translation() - first.T_world_body.translation()).norm(); });
  }

  std::vector<Curve> headings() const
  {
    return ofPoses(
        [](const StampedPose&, const StampedPose& pose)
        {
          const Eigen::Matrix3d R = pose.T_world_body.linear();
          return 180.0 / M_PI * std::atan2(R(1, 0), R(0, 0));
        });
  }

  template <typename Value>
  std::vector<Curve> ofPoses(const Value& value) const
  {
    std::vector<Curve> curves;
    for (size_t i = plot_.trajectories.size(); i-- > 0;)
    {
      Curve curve{{}, colorOf(i), 1.4};
      for (const StampedPose& pose : plot_.trajectories[i].poses)
      {
        const double y = value(plot_.trajectories[i].poses.front(), pose);
        if (isDrawable(y))
        {
          curve.points.emplace_back(seconds(pose.stamp_ns), y);
        }
      }
      curves.push_back(std::move(curve));
    }
    return curves;
  }

  void drawOverTime(const std::string& title, const cv::Rect2d& area, const std::vector<Curve>& curves, bool from_zero)
  {
    auto [x, y] = extent(curves);
    for (const PlottedSpan& span : plot_.spans)
    {
      x.add(seconds(span.from_ns));
      x.add(seconds(span.to_ns));
    }
    x.high = std::max(x.high, x.low + 1e-3);
    const double height = std::max(y.length(), 1e-6);
    y.high += 0.08 * std::max(from_zero ? y.high : height, 1e-6);
    y.low = from_zero ? 0.0 : y.low - 0.08 * height;
    Axes axes(&canvas_, area, x, y);
    for (const PlottedSpan& span : plot_.spans)
    {
      axes.shade(seconds(span.from_ns), seconds(span.to_ns), SPANS[spanIndex(span.name) % std::size(SPANS)]);
    }
    axes.drawGrid(title, "time [s]");
    for (const Curve& curve : curves)
    {
      axes.draw(curve.points, curve.color, curve.width);
    }
    axes.drawFrame();
  }

  std::vector<std::string> spanNames() const
  {
    std::vector<std::string> names;
    for (const PlottedSpan& span : plot_.spans)
    {
      if (std::find(names.begin(), names.end(), span.name) == names.end())
      {
        names.push_back(span.name);
      }
    }
    return names;
  }

  size_t spanIndex(const std::string& name) const
  {
    const std::vector<std::string> names = spanNames();
    return static_cast<size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  }

  void drawLegend()
  {
    constexpr double TEXT = 10.5;
    constexpr double LINE_Y = 955.0;
    double x = 70.0;
    const auto entry = [&](const std::string& name, const auto& symbol)
    {
      symbol(x);
      x += 42.0;
      canvas_.text(name, {x, LINE_Y + 0.5 * TEXT}, TEXT, INK);
      x += Canvas::textWidth(name, TEXT) + 34.0;
    };
    if (!plot_.truth.empty())
    {
      entry("ground truth", [&](double at) { canvas_.line({{at, LINE_Y}, {at + 32.0, LINE_Y}}, TRUTH, 4.0); });
    }
    for (size_t i = 0; i < plot_.trajectories.size(); ++i)
    {
      entry(ascii(plot_.trajectories[i].name) + " (dot: start)",
            [&](double at)
            {
              canvas_.line({{at, LINE_Y}, {at + 32.0, LINE_Y}}, colorOf(i), 2.0);
              canvas_.disc({at + 16.0, LINE_Y}, 4.5, colorOf(i));
            });
    }
    const std::vector<std::string> names = spanNames();
    for (size_t i = 0; i < names.size(); ++i)
    {
      entry(ascii(names[i]),
            [&](double at) {
              canvas_.box({at, LINE_Y - 8.0, 32.0, 16.0}, SPANS[i % std::size(SPANS)], true);
            });
    }
  }

  const TrajectoryPlot& plot_;
  Canvas canvas_;
  int64_t start_ns_ = 0;
};

}  // namespace

cv::Mat drawTrajectoryPlot(const TrajectoryPlot& plot)
{
  if (plot.trajectories.empty())
  {
    throw std::invalid_argument("plot: has no trajectory to draw");
  }
  for (const PlottedTrajectory& trajectory : plot.trajectories)
  {
    if (trajectory.position_errors.size() != trajectory.error_stamps.size() ||
        trajectory.rotation_errors.size() != trajectory.error_stamps.size())
    {
      throw std::invalid_argument(
          "plot: " + trajectory.name + " has " + std::to_string(trajectory.error_stamps.size()) + " stamps, " +
          std::to_string(trajectory.position_errors.size()) + " errors of position and " +
          std::to_string(trajectory.rotation_errors.size()) + " of rotation, expected one each");
    }
  }
  return Drawing(plot).draw();
}

}  // namespace pi_slam
