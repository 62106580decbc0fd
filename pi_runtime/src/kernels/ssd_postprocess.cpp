// To be compiled with -ffp-contract=off: fused multiply-add would give other bits than the OpenCL kernels.
#include <pi_runtime/kernels/ssd_postprocess.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "kernels/simd.h"
#include "kernels/ssd_work.h"

namespace pi_runtime::kernels
{
namespace
{

struct Box
{
  float x1;
  float y1;
  float x2;
  float y2;
};

/// exp(x) from products and sums alone, so that every implementation gets the same bits; 2 ulp for x in [-87, 88],
/// beyond which it stays at the ends. exp(x) = 2^n exp(r), |r| <= ln 2 / 2 (Cody and Waite 1980), Taylor series.
PI_RUNTIME_ALWAYS_INLINE float exponential(float x)
{
  x = x < -87.0F ? -87.0F : x;
  x = x > 88.0F ? 88.0F : x;
  constexpr float ROUNDER = 12582912.0F;  // 1.5 * 2^23: leaves no bits for a fraction; rounds to nearest, ties to even
  const float n = (x * 1.44269504F + ROUNDER) - ROUNDER;
  const float r = (x - n * 0.693359375F) - n * -2.12194440e-4F;
  float sum = 1.0F / 5040.0F;
  for (const float factor : {1.0F / 720.0F, 1.0F / 120.0F, 1.0F / 24.0F, 1.0F / 6.0F, 0.5F, 1.0F, 1.0F})
  {
    sum = sum * r + factor;
  }
  const uint32_t bits = static_cast<uint32_t>(static_cast<int32_t>(n) + 127) << 23;
  float power;
  std::memcpy(&power, &bits, sizeof(power));
  return sum * power;
}

constexpr int LANES = 16;

/// In lanes, as compilers may not reorder a plain maximum of floats.
PI_RUNTIME_SIMD_CLONES
float maximum(const float* values, int count)
{
  float lanes[LANES];
  std::fill(lanes, lanes + LANES, -std::numeric_limits<float>::infinity());
  int i = 0;
  for (; i + LANES <= count; i += LANES)
  {
    for (int k = 0; k < LANES; ++k)
    {
      lanes[k] = values[i + k] > lanes[k] ? values[i + k] : lanes[k];
    }
  }
  float most = -std::numeric_limits<float>::infinity();
  for (const float lane : lanes)
  {
    most = lane > most ? lane : most;
  }
  for (; i < count; ++i)
  {
    most = values[i] > most ? values[i] : most;
  }
  return most;
}

/// Sum of exp(value - highest). Lane k sums the values k, k + 16, ...; then halves are added: the order that the OpenCL
/// kernel has, too.
PI_RUNTIME_SIMD_CLONES
float sumOfExponentials(const float* values, int count, float highest)
{
  float lanes[LANES] = {};
  int i = 0;
  for (; i + LANES <= count; i += LANES)
  {
    for (int k = 0; k < LANES; ++k)
    {
      lanes[k] += exponential(values[i + k] - highest);
    }
  }
  for (int k = 0; i + k < count; ++k)
  {
    lanes[k] += exponential(values[i + k] - highest);
  }
  for (int half = LANES / 2; half > 0; half /= 2)
  {
    for (int k = 0; k < half; ++k)
    {
      lanes[k] += lanes[k + half];
    }
  }
  return lanes[0];
}

Box decode(const float* location, const SsdPrior& prior, const SsdVariances& v)
{
  const float cx = prior.cx + location[0] * v.x * prior.width;
  const float cy = prior.cy + location[1] * v.y * prior.height;
  const float half_width = prior.width * exponential(location[2] * v.width) * 0.5F;
  const float half_height = prior.height * exponential(location[3] * v.height) * 0.5F;
  return {cx - half_width, cy - half_height, cx + half_width, cy + half_height};
}

bool overlaps(const Box& a, const Box& b, float threshold)
{
  const float width = std::min(a.x2, b.x2) - std::max(a.x1, b.x1);
  const float height = std::min(a.y2, b.y2) - std::max(a.y1, b.y1);
  if (!(width > 0.0F) || !(height > 0.0F))
  {
    return false;
  }
  const float both = width * height;
  const float either = (a.x2 - a.x1) * (a.y2 - a.y1) + (b.x2 - b.x1) * (b.y2 - b.y1) - both;
  return both > threshold * either;
}

class Postprocess
{
public:
  Postprocess(const float* locations, const float* confidences, const SsdPrior* priors, const SsdShape& shape,
              const SsdVariances& variances, void* work)
    : locations_(locations)
    , confidences_(confidences)
    , priors_(priors)
    , shape_(shape)
    , variances_(variances)
    , lists_((shape.flags & SSD_CLASS_AGNOSTIC) != 0 ? 1 : shape.classes)
    , bound_(ssdConfidenceBound(shape))
    , work_(ssdWork(work, shape))
  {
  }

  int run(SsdDetection* detections)
  {
    std::fill(work_.counts, work_.counts + shape_.classes, 0);
    for (int prior = 0; prior < shape_.priors; ++prior)
    {
      collect(prior);
    }
    for (int list = 0; list < lists_; ++list)
    {
      std::make_heap(listAt(list), listAt(list) + work_.counts[list]);
    }
    return suppress(detections);
  }

private:
  /// Steps 1 and 2 for one prior.
  void collect(int prior)
  {
    const float* const row = confidences_ + static_cast<size_t>(prior) * shape_.classes;
    const int background = shape_.background;
    const float most = background < 0 ? maximum(row, shape_.classes)
                                      : std::max(maximum(row, background),
                                                 maximum(row + background + 1, shape_.classes - background - 1));
    float highest = 0.0F;
    float sum = 1.0F;
    if ((shape_.flags & SSD_SOFTMAX) != 0)
    {
      highest = background < 0 ? most : std::max(most, row[background]);
    }
    if (most - highest < bound_)
    {
      return;
    }
    if ((shape_.flags & SSD_SOFTMAX) != 0)
    {
      sum = sumOfExponentials(row, shape_.classes, highest);
    }
    for (int c = 0; c < shape_.classes; ++c)
    {
      if (c != background && row[c] - highest >= bound_)
      {
        add(c, prior, scoreOf(row[c] - highest, sum));
      }
    }
  }

  float scoreOf(float value, float sum) const
  {
    if ((shape_.flags & SSD_SOFTMAX) != 0)
    {
      return exponential(value) / sum;
    }
    return (shape_.flags & SSD_SIGMOID) != 0 ? 1.0F / (1.0F + exponential(-value)) : value;
  }

  void add(int class_id, int prior, float score)
  {
    if (!(score >= shape_.score_threshold))
    {
      return;
    }
    uint32_t bits;
    std::memcpy(&bits, &score, sizeof(bits));
    const int list = lists_ == 1 ? 0 : class_id;
    const uint32_t place = static_cast<uint32_t>(class_id) * static_cast<uint32_t>(shape_.priors) + prior;
    listAt(list)[work_.counts[list]++] = static_cast<uint64_t>(bits) << 32 | ~place;
  }

  uint64_t* listAt(int list) const { return work_.keys + static_cast<size_t>(list) * shape_.priors; }
  int priorOf(uint64_t key) const { return static_cast<int>(~static_cast<uint32_t>(key) % shape_.priors); }
  Box boxOf(uint64_t key) const
  {
    const int prior = priorOf(key);
    return decode(locations_ + 4 * static_cast<size_t>(prior), priors_[prior], variances_);
  }

  /// Steps 3 to 5. Classes do not influence each other, so candidates of all classes may come in one sequence by score,
  /// and the rest need not be looked at once keep_top_k are found.
  int suppress(SsdDetection* detections)
  {
    std::vector<uint64_t> heads(lists_);
    std::vector<int> taken(lists_, 0);
    for (int list = 0; list < lists_; ++list)
    {
      heads[list] = work_.counts[list] > 0 ? listAt(list)[0] : 0;
    }
    int found = 0;
    while (found < shape_.keep_top_k)
    {
      const int list = static_cast<int>(std::max_element(heads.begin(), heads.end()) - heads.begin());
      const uint64_t key = heads[list];
      if (key == 0)
      {
        break;
      }
      uint64_t* const heap = listAt(list);
      const int left = work_.counts[list] - taken[list];
      std::pop_heap(heap, heap + left);
      ++taken[list];
      heads[list] = left > 1 && taken[list] < shape_.top_k ? heap[0] : 0;
      found += addDetection(key, detections, found) ? 1 : 0;
    }
    return found;
  }

  /// @return false if a better one suppresses it
  bool addDetection(uint64_t key, SsdDetection* detections, int found)
  {
    const Box box = boxOf(key);
    const SsdDetection detection = detectionOf(key, box);
    Box* const boxes = reinterpret_cast<Box*>(work_.boxes);
    for (int i = 0; i < found; ++i)
    {
      const bool rivals = lists_ == 1 || detections[i].class_id == detection.class_id;
      if (rivals && overlaps(boxes[i], box, shape_.overlap_threshold))
      {
        return false;
      }
    }
    boxes[found] = box;
    detections[found] = detection;
    return true;
  }

  SsdDetection detectionOf(uint64_t key, const Box& box) const
  {
    const auto bits = static_cast<uint32_t>(key >> 32);
    float score;
    std::memcpy(&score, &bits, sizeof(score));
    const auto cut = [&](float value)
    { return (shape_.flags & SSD_CLIP) != 0 ? std::min(std::max(value, 0.0F), 1.0F) : value; };
    const auto class_id = static_cast<float>(~static_cast<uint32_t>(key) / shape_.priors);
    return {0.0F, class_id, score, cut(box.x1), cut(box.y1), cut(box.x2), cut(box.y2)};
  }

  const float* const locations_;
  const float* const confidences_;
  const SsdPrior* const priors_;
  const SsdShape shape_;
  const SsdVariances variances_;
  const int lists_;
  const float bound_;
  const SsdWork work_;
};

}  // namespace

float ssdConfidenceBound(const SsdShape& shape)
{
  const double threshold = shape.score_threshold;
  constexpr double MARGIN = 1e-3;  // far above rounding errors: what passes is compared exactly later
  if ((shape.flags & SSD_SOFTMAX) != 0)
  {
    return static_cast<float>(std::log(threshold) - MARGIN);
  }
  if ((shape.flags & SSD_SIGMOID) != 0)
  {
    return threshold >= 1.0 ? 16.0F : static_cast<float>(std::log(threshold / (1.0 - threshold)) - MARGIN);
  }
  return shape.score_threshold;
}

int postprocessSsd(const float* locations, const float* confidences, const SsdPrior* priors, const SsdShape& shape,
                   const SsdVariances& variances, void* work, SsdDetection* detections)
{
  return Postprocess(locations, confidences, priors, shape, variances, work).run(detections);
}

}  // namespace pi_runtime::kernels
