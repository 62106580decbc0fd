// Sparse pyramidal Lucas-Kanade tracking: see pi_runtime/kernels/lucas_kanade.h. Needs prelude.cl in front.
// One point per item: its window stays in private memory through all iterations of a level.

#pragma OPENCL FP_CONTRACT OFF

#define MAX_WINDOW 31
#define WIDE 32            // columns of a window in memory: two vectors
#define PATCH_STRIDE 48    // of the copy of a part of an image
#define GRADIENT_STRIDE 48
#define WEIGHT_BITS 14
#define PIXEL_BITS 5       // fraction of interpolated pixels
#define FARTHEST 1e6f
#define SCALE (1.0f / (1 << 20))
#define OSCILLATION 0.01f

typedef struct
{
  int width;
  int height;
  int levels;
  int window;
  int max_iterations;
  float epsilon;
  float min_eigenvalue;
} Options;

typedef struct
{
  global const uchar* data;
  int width;
  int height;
  int stride;
} Image;

// Columns from `size` on have gradients of 0.
typedef struct
{
  int size;
  int16 pixel[MAX_WINDOW * 2];
  int16 dx[MAX_WINDOW * 2];
  int16 dy[MAX_WINDOW * 2];
} Window;

typedef struct
{
  int x;
  int y;
  int4 weights;
} Split;

INLINE Split splitPosition(float2 at)
{
  Split split;
  split.x = (int)floor(at.x);
  split.y = (int)floor(at.y);
  const float a = at.x - (float)split.x;
  const float b = at.y - (float)split.y;
  const float one = 1 << WEIGHT_BITS;
  split.weights.x = convert_int_rte((1.0f - a) * (1.0f - b) * one);
  split.weights.y = convert_int_rte(a * (1.0f - b) * one);
  split.weights.z = convert_int_rte((1.0f - a) * b * one);
  split.weights.w = (1 << WEIGHT_BITS) - split.weights.x - split.weights.y - split.weights.z;
  return split;
}

INLINE bool outside(Split split, const Image* image, int window)
{
  return split.x < -window || split.x >= image->width || split.y < -window || split.y >= image->height;
}

// Copies the square of `size` pixels from (x, y) on: with what follows up to whole vectors where it is inside of the
// image (the pyramid has 64 bytes more), else with mirrored pixels.
INLINE void copyPatch(const Image* image, int x, int y, int size, float* memory)
{
  const bool inside = x >= 0 && y >= 0 && x + size <= image->width && y + size <= image->height;
  for (int row = 0; row < size; ++row)
  {
    float* to = memory + row * PATCH_STRIDE;
    if (inside)
    {
      global const uchar* from = image->data + (size_t)(y + row) * image->stride + x;
      for (int column = 0; column < PATCH_STRIDE; column += 16)
      {
        STORE16_FLOATS(to + column, convert_float16(LOAD16(from + column)));
      }
    }
    else
    {
      global const uchar* from = image->data + (size_t)reflect101(y + row, image->height) * image->stride;
      for (int column = 0; column < size; ++column)
      {
        to[column] = from[reflect101(x + column, image->width)];
      }
    }
  }
}

// Pixels of the patch between row p and the next one, times 32. Sums of pixels and weights have less than 24 bits, so
// floats are exact; they are faster than integers of 32 bits. Rounds half up, as pixels are not negative.
INLINE int16 interpolatePixels(const float* p, int4 weights)
{
  const float4 w = convert_float4(weights) / (float)(1 << (WEIGHT_BITS - PIXEL_BITS));
  const float* below = p + PATCH_STRIDE;
  return convert_int16_rtz(LOAD16_FLOATS(p) * w.x + LOAD16_FLOATS(p + 1) * w.y + LOAD16_FLOATS(below) * w.z +
                           LOAD16_FLOATS(below + 1) * w.w + 0.5f);
}

INLINE int16 interpolateGradients(const int* top, const int* bottom, int4 w)
{
  const int16 sum = LOAD16_INTS(top) * w.x + LOAD16_INTS(top + 1) * w.y + LOAD16_INTS(bottom) * w.z +
                    LOAD16_INTS(bottom + 1) * w.w;
  return (sum + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS;
}

INLINE long total(int16 v)
{
  const long8 eight = convert_long8(v.lo) + convert_long8(v.hi);
  const long4 four = eight.lo + eight.hi;
  return four.x + four.y + four.z + four.w;
}

INLINE int16 columnsFrom(int first)
{
  return (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15) + first;
}

// Scharr's gradients at the whole pixels of one row, 0 outside of the image.
// p: the patch, from one pixel left of and above the row's first gradient on.
INLINE void gradientRow(const float* p, int x, bool row_inside, int width, int* dx, int* dy)
{
  for (int column = 0; column < WIDE; column += 16)
  {
    const float* r0 = p + column;
    const float* r1 = r0 + PATCH_STRIDE;
    const float* r2 = r1 + PATCH_STRIDE;
    const float16 diagonal = LOAD16_FLOATS(r2 + 2) - LOAD16_FLOATS(r0);
    const float16 other = LOAD16_FLOATS(r0 + 2) - LOAD16_FLOATS(r2);
    const float16 across = LOAD16_FLOATS(r1 + 2) - LOAD16_FLOATS(r1);
    const float16 down = LOAD16_FLOATS(r2 + 1) - LOAD16_FLOATS(r0 + 1);
    const int16 at = columnsFrom(x + column);
    const int16 inside = row_inside ? at >= 0 && at < width : (int16)0;
    STORE16_INTS(dx + column, convert_int16_rtz((diagonal + other) * 3.0f + across * 10.0f) & inside);
    STORE16_INTS(dy + column, convert_int16_rtz((diagonal - other) * 3.0f + down * 10.0f) & inside);
  }
}

// Cuts the window with its first pixel at `corner` out of the image. Returns the sums of its gradients' products: xx,
// xy, yy. A lane sums up at most 62 products below 2^24.
INLINE long4 cutWindow(const Image* image, Split corner, float* memory, Window* window)
{
  const int size = window->size;
  copyPatch(image, corner.x - 1, corner.y - 1, size + 3, memory);
  int dx[2][GRADIENT_STRIDE];
  int dy[2][GRADIENT_STRIDE];
  dx[0][WIDE] = dx[1][WIDE] = dy[0][WIDE] = dy[1][WIDE] = 0;
  int16 xx = 0;
  int16 xy = 0;
  int16 yy = 0;
  for (int row = 0; row <= size; ++row)
  {
    const int y = corner.y + row;
    gradientRow(memory + row * PATCH_STRIDE, corner.x, y >= 0 && y < image->height, image->width, dx[row % 2],
                dy[row % 2]);
    if (row == 0)
    {
      continue;
    }
    const int above = (row - 1) % 2;
    for (int piece = 0; piece * 16 < size; ++piece)
    {
      const int column = piece * 16;
      const int at = (row - 1) * 2 + piece;
      const int16 used = columnsFrom(column) < size;
      const int16 gx = used & interpolateGradients(dx[above] + column, dx[row % 2] + column, corner.weights);
      const int16 gy = used & interpolateGradients(dy[above] + column, dy[row % 2] + column, corner.weights);
      window->pixel[at] = interpolatePixels(memory + row * PATCH_STRIDE + 1 + column, corner.weights);
      window->dx[at] = gx;
      window->dy[at] = gy;
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  return (long4)(total(xx), total(xy), total(yy), 0);
}

// Sums over the window of (next - previous) * gradient. A lane sums up at most 62 products below 8160 * 4080, which is
// less than 2^31.
INLINE long2 compareWindow(const Window* window, const float* next, int4 weights)
{
  int16 sum_x = 0;
  int16 sum_y = 0;
  for (int row = 0; row < window->size; ++row)
  {
    for (int piece = 0; piece * 16 < window->size; ++piece)
    {
      const int at = row * 2 + piece;
      const int16 difference = interpolatePixels(next + row * PATCH_STRIDE + piece * 16, weights) -
                               window->pixel[at];
      sum_x += difference * window->dx[at];
      sum_y += difference * window->dy[at];
    }
  }
  return (long2)(total(sum_x), total(sum_y));
}

INLINE float meanDifference(const Window* window, const float* next, int4 weights)
{
  int16 sum = 0;
  for (int row = 0; row < window->size; ++row)
  {
    for (int piece = 0; piece * 16 < window->size; ++piece)
    {
      const int16 difference = interpolatePixels(next + row * PATCH_STRIDE + piece * 16, weights) -
                               window->pixel[row * 2 + piece];
      const int16 used = columnsFrom(piece * 16) < window->size;
      sum += used & convert_int16(abs(difference));
    }
  }
  return (float)total(sum) / (float)(32 * window->size * window->size);
}

INLINE bool usable(float2 point)
{
  return fabs(point.x) < FARTHEST && fabs(point.y) < FARTHEST;
}

// Moves `to` from the guess to the result of one level (Bouguet 2000, section 2.4). Returns true if it was found.
INLINE bool searchLevel(const Image* previous, const Image* next, const Options* options, float2 from, float2* to,
                        Window* window, float* memory)
{
  const float half_window = (float)(options->window - 1) * 0.5f;
  const Split corner = splitPosition(from - half_window);
  if (outside(corner, previous, options->window))
  {
    return false;
  }
  const long4 sums = cutWindow(previous, corner, memory, window);
  const float a11 = (float)sums.x * SCALE;
  const float a12 = (float)sums.y * SCALE;
  const float a22 = (float)sums.z * SCALE;
  const float determinant = a11 * a22 - a12 * a12;
  const float root = sqrt((a11 - a22) * (a11 - a22) + 4.0f * a12 * a12);
  const float eigenvalue = (a22 + a11 - root) / (float)(2 * options->window * options->window);
  if (eigenvalue < options->min_eigenvalue || determinant < FLT_EPSILON)
  {
    return false;
  }
  const float inverse = 1.0f / determinant;
  float2 last = 0.0f;
  int2 copied = INT_MIN;  // place of the patch in memory
  for (int i = 0; i < options->max_iterations; ++i)
  {
    const Split at = splitPosition(*to - half_window);
    if (outside(at, next, options->window))
    {
      return false;
    }
    if (at.x != copied.x || at.y != copied.y)
    {
      copyPatch(next, at.x, at.y, options->window + 1, memory);
      copied = (int2)(at.x, at.y);
    }
    const long2 mismatch = compareWindow(window, memory, at.weights);
    const float b1 = (float)mismatch.x * SCALE;
    const float b2 = (float)mismatch.y * SCALE;
    const float2 step = (float2)((a12 * b2 - a22 * b1) * inverse, (a12 * b1 - a11 * b2) * inverse);
    *to += step;
    if (step.x * step.x + step.y * step.y <= options->epsilon * options->epsilon)
    {
      break;
    }
    if (i > 0 && fabs(step.x + last.x) < OSCILLATION && fabs(step.y + last.y) < OSCILLATION)
    {
      *to -= step * 0.5f;
      break;
    }
    last = step;
  }
  return true;
}

// Mean absolute difference at the result; false if it is outside of the image.
INLINE bool residualAt(const Image* next, const Window* window, float2 to, float* memory, float* mean)
{
  const Split at = splitPosition(to - (float)(window->size - 1) * 0.5f);
  if (outside(at, next, window->size))
  {
    return false;
  }
  copyPatch(next, at.x, at.y, window->size + 1, memory);
  *mean = meanDifference(window, memory, at.weights);
  return true;
}

// The level's image. The layout is that of PyramidLayout.
INLINE Image levelOf(global const uchar* pyramid, const Options* options, int level)
{
  Image image;
  image.data = pyramid;
  image.width = options->width;
  image.height = options->height;
  image.stride = (image.width + 63) / 64 * 64;
  for (int i = 0; i < level; ++i)
  {
    image.data += (size_t)image.stride * image.height;
    image.width = (image.width + 1) / 2;
    image.height = (image.height + 1) / 2;
    image.stride = (image.width + 63) / 64 * 64;
  }
  return image;
}

kernel void track_points(global const uchar* restrict previous_pyramid, global const uchar* restrict next_pyramid,
                         global const float2* restrict previous_points, global float2* restrict next_points,
                         global uchar* restrict status, global float* restrict residuals, Options options)
{
  const size_t point = get_global_id(0);
  Window window;
  float memory[PATCH_STRIDE * (MAX_WINDOW + 3)];
  window.size = options.window;
  const float2 from = previous_points[point];
  float2 to = next_points[point];
  float residual = 0.0f;
  bool found = usable(from) && usable(to);
  bool more = found;
  to *= 1.0f / (1 << (options.levels - 1));
  for (int level = options.levels - 1; level >= 0 && more; --level)
  {
    const Image previous = levelOf(previous_pyramid, &options, level);
    const Image next = levelOf(next_pyramid, &options, level);
    found = searchLevel(&previous, &next, &options, from * (1.0f / (1 << level)), &to, &window, memory);
    more = usable(to);
    found = found && more;
    if (level == 0 && more)
    {
      next_points[point] = to;
      found = found && residualAt(&next, &window, to, memory, &residual);
    }
    to *= 2.0f;
  }
  status[point] = found;
  residuals[point] = residual;
}
