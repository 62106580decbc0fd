#include "trace/gantt.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "trace/gantt_scene.h"

namespace pi_runtime
{
namespace
{

const cv::Scalar WHITE(255, 255, 255);
const cv::Scalar ROW(244, 244, 244);
const cv::Scalar GRID(215, 215, 215);
const cv::Scalar INK(40, 40, 40);
const cv::Scalar RED(30, 30, 220);
const cv::Scalar OTHER_CODELETS(150, 150, 150);

/// Blue, green, red. Told apart by most colour-blind people (after Okabe and Ito 2008), and none is red.
const cv::Scalar PALETTE[] = {{178, 114, 0},   {0, 159, 230},   {115, 158, 0},  {167, 121, 204}, {233, 180, 86},
                              {66, 228, 240},  {120, 70, 110},  {60, 110, 150}, {200, 200, 90},  {90, 90, 90},
                              {150, 200, 160}, {220, 160, 220}, {20, 90, 80}};

constexpr int MARGIN = 16;  // all lengths in pixels
constexpr int TITLE_HEIGHT = 40;
constexpr int BAR_HEIGHT = 30;
constexpr int STRIP_HEIGHT = 6;  // red where a deadline is past
constexpr int ROW_HEIGHT = BAR_HEIGHT + STRIP_HEIGHT + 8;
constexpr int AXIS_HEIGHT = 48;
constexpr int LEGEND_LINE = 24;
constexpr int UTILISATION_WIDTH = 84;
constexpr size_t LONGEST_NAME = 28;  // letters
constexpr double FONT_SCALE = 0.45;
constexpr float FAINTEST = 0.35F;    // coverage drawn where anything ran: single short tasks stay visible
constexpr double HATCHED_FROM = 4;   // narrower transfers are only darker
constexpr double OUTLINED_FROM = 3;  // narrower bars merge

cv::Size textSize(const std::string& text)
{
  int baseline = 0;
  return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, FONT_SCALE, 1, &baseline);
}

/// What the font can draw of a name, cut to LONGEST_NAME.
std::string drawable(std::string_view name)
{
  std::string text;
  for (const char letter : name)
  {
    const auto byte = static_cast<uint8_t>(letter);
    if (byte < 0x80 || byte >= 0xc0)  // one sign for a whole UTF-8 character
    {
      text += byte >= 0x20 && byte < 0x7f ? letter : '?';
    }
  }
  return text.size() <= LONGEST_NAME ? text : text.substr(0, LONGEST_NAME - 2) + "..";
}

cv::Scalar darker(const cv::Scalar& colour)
{
  return colour * 0.62;
}

std::string formattedDuration(double duration_s)
{
  const TimeUnit unit = timeUnitFor(duration_s);
  return formatted("%.4g ", duration_s / unit.seconds) + unit.name;
}

/// A colour for each codelet, and grey for those beyond the palette.
class Colours
{
public:
  explicit Colours(const std::vector<std::string_view>& codelets) : names_(codelets)
  {
    for (size_t index = 0; index < std::min(names_.size(), std::size(PALETTE)); ++index)
    {
      colours_[names_[index]] = PALETTE[index];
    }
  }

  const cv::Scalar& of(std::string_view codelet) const
  {
    const auto found = colours_.find(codelet);
    return found != colours_.end() ? found->second : OTHER_CODELETS;
  }
  const std::vector<std::string_view>& names() const { return names_; }

private:
  std::vector<std::string_view> names_;
  std::map<std::string_view, cv::Scalar> colours_;
};

/// One row's bars in sub-pixel columns: mean colour and covered part of each.
class Columns
{
public:
  explicit Columns(int width) : sums_(static_cast<size_t>(width), cv::Vec4f::all(0)) {}

  void add(double left, double right, const cv::Scalar& colour)
  {
    const double end = static_cast<double>(sums_.size());
    left = std::clamp(left, 0.0, end - 1e-3);
    right = std::clamp(right, left + 1e-3, end);  // what has no duration leaves a trace as well
    for (int column = static_cast<int>(left); column < right; ++column)
    {
      const double covered = std::min<double>(right, column + 1) - std::max<double>(left, column);
      const auto weight = static_cast<float>(covered);
      sums_[static_cast<size_t>(column)] +=
          cv::Vec4f(static_cast<float>(colour[0]), static_cast<float>(colour[1]), static_cast<float>(colour[2]), 1) *
          weight;
    }
  }

  void paint(cv::Mat& bars) const
  {
    for (int column = 0; column < bars.cols; ++column)
    {
      const cv::Vec4f& sum = sums_[static_cast<size_t>(column)];
      if (sum[3] > 0)
      {
        const float share = std::clamp(sum[3], FAINTEST, 1.0F);
        const cv::Scalar mean(sum[0] / sum[3], sum[1] / sum[3], sum[2] / sum[3]);
        bars.col(column).setTo(ROW * (1 - share) + mean * share);
      }
    }
  }

private:
  std::vector<cv::Vec4f> sums_;
};

class Picture
{
public:
  Picture(GanttScene scene, const std::vector<std::string>& units, int width)
    : scene_(std::move(scene)), colours_(scene_.codelets), rows_(static_cast<int>(scene_.units))
  {
    int longest = 0;
    for (size_t unit = 0; unit < scene_.units; ++unit)
    {
      names_.push_back(drawable(unit < units.size() ? units[unit] : "unit " + std::to_string(unit)));
      longest = std::max(longest, textSize(names_.back()).width);
    }
    left_ = MARGIN + longest + MARGIN;
    plot_width_ = width - left_ - UTILISATION_WIDTH;
    bottom_ = TITLE_HEIGHT + rows_ * ROW_HEIGHT;
    // The legend is set twice: first to learn how many lines it takes.
    image_ = cv::Mat(1, width, CV_8UC3, WHITE);
    const int legend_bottom = drawLegend(bottom_ + AXIS_HEIGHT);
    image_ = cv::Mat(legend_bottom + MARGIN, width, CV_8UC3, WHITE);
  }

  GanttImage draw()
  {
    drawTitle();
    drawRows();
    drawAxis();
    drawTasks();
    drawLegend(bottom_ + AXIS_HEIGHT);
    GanttImage result{image_.cols, image_.rows, {}};
    result.bgr.assign(image_.datastart, image_.dataend);
    return result;
  }

private:
  void write(const std::string& text, int x, int middle, const cv::Scalar& colour = INK)
  {
    cv::putText(image_, text, cv::Point(x, middle + textSize(text).height / 2), cv::FONT_HERSHEY_SIMPLEX, FONT_SCALE,
                colour, 1, cv::LINE_AA);
  }

  int rowTop(size_t unit) const { return TITLE_HEIGHT + static_cast<int>(unit) * ROW_HEIGHT + 4; }
  /// Column in the plot, not clipped to it.
  double columnOf(int64_t time_ns) const
  {
    return static_cast<double>(time_ns - scene_.from_ns) * plot_width_ /
           static_cast<double>(scene_.to_ns - scene_.from_ns);
  }
  /// The part of columns [left, right) that is in the plot, in pixels of the image, at least one wide.
  cv::Rect pixels(double left, double right, int top, int height) const
  {
    // Clipped before the conversion: a long task seen through a short window has more columns than an int.
    const int first = static_cast<int>(std::clamp(std::floor(left), 0.0, plot_width_ - 1.0));
    const int end = static_cast<int>(std::clamp(std::ceil(right), first + 1.0, plot_width_ * 1.0));
    return cv::Rect(left_ + first, top, end - first, height);
  }

  void drawTitle()
  {
    size_t late = 0;
    for (const TaskTrace& task : scene_.tasks)
    {
      late += task.missedDeadline();
    }
    std::string title = std::to_string(scene_.tasks.size()) + (scene_.tasks.size() == 1 ? " task in " : " tasks in ") +
                        formattedDuration(scene_.durationS()) + ", " + std::to_string(late) + " late";
    if (scene_.never_ran > 0)
    {
      title += "; " + std::to_string(scene_.never_ran) + " of the trace never ran";
    }
    write(title, left_, TITLE_HEIGHT / 2);
    write("busy", left_ + plot_width_ + 12, TITLE_HEIGHT / 2);
  }

  void drawRows()
  {
    const std::vector<double> busy = unitUtilisation(scene_.tasks, scene_.units, scene_.from_ns, scene_.to_ns);
    for (size_t unit = 0; unit < scene_.units; ++unit)
    {
      const int middle = rowTop(unit) + BAR_HEIGHT / 2;
      cv::rectangle(image_, cv::Rect(left_, rowTop(unit), plot_width_, BAR_HEIGHT + STRIP_HEIGHT), ROW, cv::FILLED);
      write(names_[unit], MARGIN, middle);
      write(formatted("%.1f %%", 100 * busy[unit]), left_ + plot_width_ + 12, middle);
    }
  }

  void drawAxis()
  {
    constexpr double CLOSEST = 90;
    const double from_s = static_cast<double>(scene_.from_ns - scene_.origin_ns) * 1e-9;
    const double step_s = roundStep(scene_.durationS() * CLOSEST / plot_width_);
    const TimeUnit unit = timeUnitFor(scene_.durationS());
    cv::line(image_, {left_, bottom_}, {left_ + plot_width_ - 1, bottom_}, INK);
    for (auto tick = static_cast<int64_t>(std::ceil(from_s / step_s - 1e-9));; ++tick)
    {
      const double column = (static_cast<double>(tick) * step_s - from_s) / scene_.durationS() * plot_width_;
      if (column > plot_width_ - 1 + 1e-6)
      {
        break;
      }
      const int x = left_ + static_cast<int>(column);
      cv::line(image_, {x, TITLE_HEIGHT}, {x, bottom_}, GRID);
      cv::line(image_, {x, bottom_}, {x, bottom_ + 5}, INK);
      const std::string label = formatted("%.10g", static_cast<double>(tick) * step_s / unit.seconds);
      write(label, x - textSize(label).width / 2, bottom_ + 15);
    }
    write(std::string("time since the first task's start [") + unit.name + "]", left_, bottom_ + 35);
  }

  void drawTasks()
  {
    std::vector<Columns> rows(scene_.units, Columns(plot_width_));
    for (const TaskTrace& task : scene_.tasks)
    {
      const cv::Scalar& colour = colours_.of(task.codelet);
      Columns& row = rows[task.unit];
      if (task.transfer_ns > 0 && task.started_ns > scene_.from_ns)
      {
        row.add(columnOf(takenNs(task)), columnOf(task.started_ns), darker(colour));
      }
      if (task.started_ns < scene_.to_ns)
      {
        row.add(columnOf(task.started_ns), columnOf(task.finished_ns), colour);
      }
    }
    for (size_t unit = 0; unit < scene_.units; ++unit)
    {
      cv::Mat bars = image_(cv::Rect(left_, rowTop(unit), plot_width_, BAR_HEIGHT));
      rows[unit].paint(bars);
    }
    for (const TaskTrace& task : scene_.tasks)
    {
      drawDetails(task);
    }
  }

  /// What only a bar of some width can show, and the marks that must show at any width.
  void drawDetails(const TaskTrace& task)
  {
    const int top = rowTop(task.unit);
    const double taken = columnOf(takenNs(task));
    const double started = columnOf(task.started_ns);
    const double finished = columnOf(task.finished_ns);
    const cv::Scalar& colour = colours_.of(task.codelet);
    if (started - taken >= HATCHED_FROM)
    {
      hatch(pixels(taken, started, top, BAR_HEIGHT), colour);
    }
    const cv::Rect bar = pixels(started, finished, top, BAR_HEIGHT);
    if (finished - started >= OUTLINED_FROM)
    {
      cv::rectangle(image_, bar, darker(colour));
      label(task, bar, colour);
    }
    if (task.outcome != TaskOutcome::OK)
    {
      cross(pixels(taken, finished, top, BAR_HEIGHT));
    }
    if (task.missedDeadline())
    {
      const double past = std::max(columnOf(task.deadline_ns), taken);
      cv::rectangle(image_, pixels(past, finished, top + BAR_HEIGHT + 1, STRIP_HEIGHT), RED, cv::FILLED);
    }
  }

  void hatch(const cv::Rect& area, const cv::Scalar& colour)
  {
    constexpr int SPACING = 5;
    cv::Mat part = image_(area);
    for (int x = -area.height; x < area.width; x += SPACING)
    {
      cv::line(part, {x, area.height}, {x + area.height, 0}, colour, 1, cv::LINE_AA);
    }
  }

  void cross(const cv::Rect& area)
  {
    constexpr int SIZE = 9;  // also on narrower bars: a failure must show
    const cv::Point middle = (area.tl() + area.br()) / 2;
    const cv::Point half(SIZE / 2, SIZE / 2);
    const cv::Point other(SIZE / 2, -SIZE / 2);
    cv::line(image_, middle - half, middle + half, INK, 2, cv::LINE_AA);
    cv::line(image_, middle - other, middle + other, INK, 2, cv::LINE_AA);
  }

  void label(const TaskTrace& task, const cv::Rect& bar, const cv::Scalar& colour)
  {
    const std::string number = std::to_string(task.task);
    const bool bright = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2] > 120;
    for (const std::string& text : {drawable(task.codelet) + " " + number, number})
    {
      const int width = textSize(text).width;
      if (width + 8 <= bar.width)
      {
        write(text, bar.x + (bar.width - width) / 2, bar.y + bar.height / 2, bright ? INK : WHITE);
        return;
      }
    }
  }

  struct Entry
  {
    std::string text;
    cv::Scalar colour;
    void (Picture::*mark)(const cv::Rect&, const cv::Scalar&);
  };

  std::vector<Entry> legendEntries() const
  {
    std::vector<Entry> entries;
    const std::vector<std::string_view>& names = colours_.names();
    for (size_t index = 0; index < std::min(names.size(), std::size(PALETTE)); ++index)
    {
      entries.push_back({drawable(names[index]), PALETTE[index], &Picture::markBar});
    }
    if (names.size() > std::size(PALETTE))
    {
      const size_t more = names.size() - std::size(PALETTE);
      entries.push_back({std::to_string(more) + " others", OTHER_CODELETS, &Picture::markBar});
    }
    const auto any = [this](auto condition)
    { return std::any_of(scene_.tasks.begin(), scene_.tasks.end(), condition); };
    if (any([](const TaskTrace& task) { return task.transfer_ns > 0; }))
    {
      entries.push_back({"transfer before a run", OTHER_CODELETS, &Picture::markTransfer});
    }
    if (any([](const TaskTrace& task) { return task.missedDeadline(); }))
    {
      entries.push_back({"past the deadline", RED, &Picture::markStrip});
    }
    if (any([](const TaskTrace& task) { return task.outcome != TaskOutcome::OK; }))
    {
      entries.push_back({"failed or cancelled", WHITE, &Picture::markCross});
    }
    return entries;
  }

  void markBar(const cv::Rect& area, const cv::Scalar& colour) { cv::rectangle(image_, area, colour, cv::FILLED); }
  void markTransfer(const cv::Rect& area, const cv::Scalar& colour)
  {
    cv::rectangle(image_, area, darker(colour), cv::FILLED);
    hatch(area, colour);
  }
  void markStrip(const cv::Rect& area, const cv::Scalar& colour)
  {
    cv::rectangle(image_, cv::Rect(area.x, area.y + 4, area.width, STRIP_HEIGHT), colour, cv::FILLED);
  }
  void markCross(const cv::Rect& area, const cv::Scalar&) { cross(area); }

  /// @return where it ends. Drawing outside the image is clipped.
  int drawLegend(int top)
  {
    constexpr int SAMPLE = 22;
    int x = left_;
    int y = top;
    for (const Entry& entry : legendEntries())
    {
      const int width = SAMPLE + 6 + textSize(entry.text).width + 22;
      if (x + width > image_.cols && x > left_)
      {
        x = left_;
        y += LEGEND_LINE;
      }
      const cv::Rect area(x, y + 5, SAMPLE, 14);
      if (area.br().y <= image_.rows)
      {
        (this->*entry.mark)(area, entry.colour);
        write(entry.text, x + SAMPLE + 6, y + LEGEND_LINE / 2);
      }
      x += width;
    }
    return y + LEGEND_LINE;
  }

  const GanttScene scene_;
  const Colours colours_;
  const int rows_;
  std::vector<std::string> names_;
  int left_ = 0;
  int plot_width_ = 0;
  int bottom_ = 0;
  cv::Mat image_;
};

}  // namespace

GanttImage drawGantt(const std::vector<TaskTrace>& records, const std::vector<std::string>& units,
                     const GanttOptions& options)
{
  return Picture(arrangeGantt(records, units.size(), options), units, options.width).draw();
}

void writeGantt(const std::string& path, const std::vector<TaskTrace>& records, const std::vector<std::string>& units,
                const GanttOptions& options)
{
  GanttImage image = drawGantt(records, units, options);
  const cv::Mat pixels(image.height, image.width, CV_8UC3, image.bgr.data());
  bool written = false;
  try
  {
    written = cv::imwrite(path, pixels);
  }
  catch (const cv::Exception&)  // an ending that it does not know
  {
  }
  if (!written)
  {
    throw std::runtime_error(path + ": the picture cannot be written; the name must end in .png and the folder exist");
  }
}

}  // namespace pi_runtime
