// Detections of an SSD network: pi_runtime/kernels/ssd_postprocess.h has the contract, src/kernels/ssd_work.h the
// layout of the work memory, ssd_postprocess.cpp the same arithmetic in C++. Needs prelude.cl in front.
// ssd_clear: one work item per class. ssd_collect: one per prior. ssd_make_heaps: one per list of candidates, which are
// those of a class, or all of them if agnostic. ssd_suppress: one.

#pragma OPENCL FP_CONTRACT OFF

#define SSD_SOFTMAX 1
#define SSD_SIGMOID 2
#define SSD_CLASS_AGNOSTIC 4
#define SSD_CLIP 8

typedef struct
{
  int priors;
  int classes;
  int background;
  int top_k;
  int keep_top_k;
  float score_threshold;
  float overlap_threshold;
  int flags;
} SsdShape;

typedef struct
{
  global float4* boxes;
  global ulong* keys;
  global int* counts;
} SsdWork;

INLINE SsdWork workOf(global float4* memory, const SsdShape* shape)
{
  SsdWork work;
  work.boxes = memory;
  work.keys = (global ulong*)(memory + (size_t)shape->keep_top_k);
  work.counts = (global int*)(work.keys + (size_t)shape->classes * shape->priors);
  return work;
}

#define EXPONENTIAL(NAME, FLOAT, AS_FLOAT, TO_INT)                \
  INLINE FLOAT NAME(FLOAT x)                                      \
  {                                                               \
    x = min(max(x, -87.0f), 88.0f);                               \
    const FLOAT n = rint(x * 1.44269504f);                        \
    const FLOAT r = (x - n * 0.693359375f) - n * -2.12194440e-4f; \
    FLOAT sum = 1.0f / 5040.0f;                                   \
    sum = sum * r + 1.0f / 720.0f;                                \
    sum = sum * r + 1.0f / 120.0f;                                \
    sum = sum * r + 1.0f / 24.0f;                                 \
    sum = sum * r + 1.0f / 6.0f;                                  \
    sum = sum * r + 0.5f;                                         \
    sum = sum * r + 1.0f;                                         \
    sum = sum * r + 1.0f;                                         \
    return sum * AS_FLOAT((TO_INT(n) + 127) << 23);               \
  }

EXPONENTIAL(exponential, float, as_float, convert_int)
EXPONENTIAL(exponential16, float16, as_float16, convert_int16)

INLINE float sumOfExponentials(global const float* values, int count, float highest)
{
  float16 sums = 0.0f;
  int i = 0;
  for (; i + 16 <= count; i += 16)
  {
    sums += exponential16(vload16(0, values + i) - highest);
  }
  float lanes[16];
  vstore16(sums, 0, lanes);
  for (int k = 0; i + k < count; ++k)
  {
    lanes[k] += exponential(values[i + k] - highest);
  }
  const float8 s8 = vload8(0, lanes) + vload8(1, lanes);
  const float4 s4 = s8.lo + s8.hi;
  const float2 s2 = s4.lo + s4.hi;
  return s2.x + s2.y;
}

kernel void ssd_clear(global float4* memory, const SsdShape shape)
{
  const SsdWork work = workOf(memory, &shape);
  work.counts[get_global_id(0)] = 0;
}

INLINE float maximum(global const float* values, int count)
{
  float16 lanes = (float16)(-INFINITY);
  int i = 0;
  for (; i + 16 <= count; i += 16)
  {
    lanes = max(lanes, vload16(0, values + i));
  }
  const float8 m8 = max(lanes.lo, lanes.hi);
  const float4 m4 = max(m8.lo, m8.hi);
  float most = max(max(m4.x, m4.y), max(m4.z, m4.w));
  for (; i < count; ++i)
  {
    most = max(most, values[i]);
  }
  return most;
}

INLINE float scoreOf(float value, float sum, int flags)
{
  if (flags & SSD_SOFTMAX)
  {
    return exponential(value) / sum;
  }
  return flags & SSD_SIGMOID ? 1.0f / (1.0f + exponential(-value)) : value;
}

kernel void ssd_collect(global const float* confidences, global float4* memory, const SsdShape shape,
                        const float bound)
{
  const int prior = (int)get_global_id(0);
  if (prior >= shape.priors)
  {
    return;
  }
  global const float* row = confidences + (size_t)prior * shape.classes;
  const int background = shape.background;
  const int first = background + 1;
  float most = maximum(row + first, shape.classes - first);
  if (background > 0)
  {
    most = max(most, maximum(row, background));
  }
  float highest = 0.0f;
  if (shape.flags & SSD_SOFTMAX)
  {
    highest = background < 0 ? most : max(most, row[background]);
  }
  if (most - highest < bound)
  {
    return;
  }
  float sum = 1.0f;
  if (shape.flags & SSD_SOFTMAX)
  {
    sum = sumOfExponentials(row, shape.classes, highest);
  }
  const SsdWork work = workOf(memory, &shape);
  for (int c = 0; c < shape.classes; ++c)
  {
    if (c == background || row[c] - highest < bound)
    {
      continue;
    }
    const float score = scoreOf(row[c] - highest, sum, shape.flags);
    if (score >= shape.score_threshold)
    {
      // Lists are in no particular order: keys say what is better.
      const int list = shape.flags & SSD_CLASS_AGNOSTIC ? 0 : c;
      const uint place = (uint)c * (uint)shape.priors + (uint)prior;
      work.keys[(size_t)list * shape.priors + atomic_inc(work.counts + list)] =
          (ulong)as_uint(score) << 32 | (ulong)~place;
    }
  }
}

INLINE float4 decode(global const float* locations, global const float* priors, int index, float4 variances)
{
  const float4 location = vload4(index, locations);
  const float4 prior = vload4(index, priors);
  const float cx = prior.x + location.x * variances.x * prior.z;
  const float cy = prior.y + location.y * variances.y * prior.w;
  const float half_width = prior.z * exponential(location.z * variances.z) * 0.5f;
  const float half_height = prior.w * exponential(location.w * variances.w) * 0.5f;
  return (float4)(cx - half_width, cy - half_height, cx + half_width, cy + half_height);
}

INLINE bool overlaps(float4 a, float4 b, float threshold)
{
  const float width = min(a.z, b.z) - max(a.x, b.x);
  const float height = min(a.w, b.w) - max(a.y, b.y);
  if (!(width > 0.0f) || !(height > 0.0f))
  {
    return false;
  }
  const float both = width * height;
  const float either = (a.z - a.x) * (a.w - a.y) + (b.z - b.x) * (b.w - b.y) - both;
  return both > threshold * either;
}

// Puts key into the heap of count elements, whose element at `hole` is free.
INLINE void siftDown(global ulong* heap, int count, int hole, ulong key)
{
  for (int child = 2 * hole + 1; child < count; child = 2 * hole + 1)
  {
    child += child + 1 < count && heap[child + 1] > heap[child] ? 1 : 0;
    if (heap[child] <= key)
    {
      break;
    }
    heap[hole] = heap[child];
    hole = child;
  }
  heap[hole] = key;
}

kernel void ssd_make_heaps(global float4* memory, const SsdShape shape)
{
  const int list = (int)get_global_id(0);
  const SsdWork work = workOf(memory, &shape);
  global ulong* heap = work.keys + (size_t)list * shape.priors;
  const int count = work.counts[list];
  for (int i = count / 2 - 1; i >= 0; --i)
  {
    siftDown(heap, count, i, heap[i]);
  }
}

// heads: the best candidate of each list, 0 where there is none left. taken: candidates taken of each list.
kernel void ssd_suppress(global const float* locations, global const float* priors, global float4* memory,
                         global float* detections, global int* number, local ulong* heads, local int* taken,
                         const SsdShape shape, const float4 variances)
{
  const SsdWork work = workOf(memory, &shape);
  const bool agnostic = shape.flags & SSD_CLASS_AGNOSTIC;
  const int lists = agnostic ? 1 : shape.classes;
  for (int list = 0; list < lists; ++list)
  {
    heads[list] = work.counts[list] > 0 ? work.keys[(size_t)list * shape.priors] : 0;
    taken[list] = 0;
  }
  int found = 0;
  while (found < shape.keep_top_k)
  {
    int list = 0;
    for (int i = 1; i < lists; ++i)
    {
      list = heads[i] > heads[list] ? i : list;
    }
    const ulong key = heads[list];
    if (key == 0)
    {
      break;
    }
    global ulong* heap = work.keys + (size_t)list * shape.priors;
    const int left = work.counts[list] - ++taken[list];
    heads[list] = 0;
    if (left > 0 && taken[list] < shape.top_k)
    {
      siftDown(heap, left, 0, heap[left]);
      heads[list] = heap[0];
    }
    const uint place = ~(uint)key;
    const float class_id = (float)(place / (uint)shape.priors);
    const float4 box = decode(locations, priors, (int)(place % (uint)shape.priors), variances);
    bool suppressed = false;
    for (int i = 0; i < found && !suppressed; ++i)
    {
      const bool rivals = agnostic || detections[7 * i + 1] == class_id;
      suppressed = rivals && overlaps(work.boxes[i], box, shape.overlap_threshold);
    }
    if (suppressed)
    {
      continue;
    }
    work.boxes[found] = box;
    global float* row = detections + 7 * found;
    row[0] = 0.0f;
    row[1] = class_id;
    row[2] = as_float((uint)(key >> 32));
    vstore4(shape.flags & SSD_CLIP ? min(max(box, 0.0f), 1.0f) : box, 0, row + 3);
    ++found;
  }
  number[0] = found;
}
