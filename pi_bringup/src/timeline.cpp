#include <pi_bringup/timeline.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_bringup
{

Timeline Timeline::build(const EurocDataset& dataset, const TimelineOptions& options)
{
  if (!(options.start_s >= 0.0) || !std::isfinite(options.start_s))
  {
    throw std::invalid_argument("start_s = " + std::to_string(options.start_s) + ", must be 0 or more");
  }
  if (!(options.duration_s >= 0.0) || !std::isfinite(options.duration_s))
  {
    throw std::invalid_argument("duration_s = " + std::to_string(options.duration_s) + ", must be 0 (all) or more");
  }

  Timeline timeline;
  const auto add = [&timeline](Stream stream, const auto& samples)
  {
    for (size_t i = 0; i < samples.size(); ++i)
    {
      timeline.items.push_back({samples[i].stamp_ns, stream, i});
    }
  };
  if (dataset.imu)
  {
    add(Stream::IMU, dataset.imu->samples);
  }
  add(Stream::GROUND_TRUTH, dataset.ground_truth);
  add(Stream::LEFT, dataset.left.images);
  if (dataset.right)
  {
    add(Stream::RIGHT, dataset.right->images);
  }
  std::sort(timeline.items.begin(), timeline.items.end(),
            [](const TimelineItem& a, const TimelineItem& b)
            { return a.stamp_ns != b.stamp_ns ? a.stamp_ns < b.stamp_ns : a.stream < b.stream; });

  if (timeline.items.empty())
  {
    throw std::invalid_argument("the recording " + dataset.folder + " has no sample");
  }
  const int64_t origin_ns =
      options.start_at_first_image ? dataset.left.images.front().stamp_ns : timeline.items.front().stamp_ns;
  timeline.start_ns = origin_ns + std::llround(options.start_s * 1e9);
  const int64_t end_ns = options.duration_s > 0.0 ? timeline.start_ns + std::llround(options.duration_s * 1e9)
                                                  : std::numeric_limits<int64_t>::max();
  timeline.items.erase(std::remove_if(timeline.items.begin(), timeline.items.end(),
                                      [&](const TimelineItem& item)
                                      { return item.stamp_ns < timeline.start_ns || item.stamp_ns >= end_ns; }),
                       timeline.items.end());
  if (timeline.items.empty())
  {
    throw std::invalid_argument("start_s = " + std::to_string(options.start_s) + ", duration_s = " +
                                std::to_string(options.duration_s) + " leave nothing of " + dataset.folder);
  }
  const auto picture_period_ns = static_cast<int64_t>(std::llround(1e9 / dataset.left.calibration.rate_hz));
  timeline.period_ns = timeline.items.back().stamp_ns - timeline.start_ns + picture_period_ns;
  return timeline;
}

}  // namespace pi_bringup
