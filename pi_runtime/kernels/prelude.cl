// Goes in front of the sources of image kernels. Devices are little-endian.

// PoCL calls larger functions instead of inlining them, which costs more than many of them do.
#define INLINE static inline __attribute__((always_inline))

// Vectors at any address, in global (LOAD16, STORE16: bytes) and in private memory. PoCL 3.1 takes vload16() and
// vstore16() apart into small pieces, which are 2 to 5 times slower than one unaligned access; vector types with the
// alignment of their elements avoid it.
#ifdef __clang__
typedef uchar16 anywhere_uchar16 __attribute__((aligned(1)));
typedef int16 anywhere_int16 __attribute__((aligned(4)));
typedef float16 anywhere_float16 __attribute__((aligned(4)));
#define LOAD16(from) (*(global const anywhere_uchar16*)(from))
#define STORE16(to, pixels) (*(global anywhere_uchar16*)(to) = (pixels))
#define LOAD16_INTS(from) (*(const anywhere_int16*)(from))
#define STORE16_INTS(to, values) (*(anywhere_int16*)(to) = (values))
#define LOAD16_FLOATS(from) (*(const anywhere_float16*)(from))
#define STORE16_FLOATS(to, values) (*(anywhere_float16*)(to) = (values))
#else
#define LOAD16(from) vload16(0, from)
#define STORE16(to, pixels) vstore16(pixels, 0, to)
#define LOAD16_INTS(from) vload16(0, from)
#define STORE16_INTS(to, values) vstore16(values, 0, to)
#define LOAD16_FLOATS(from) vload16(0, from)
#define STORE16_FLOATS(to, values) vstore16(values, 0, to)
#endif

// Index of the pixel that stands for pixel i outside of [0, size), mirrored at the outermost one (BORDER_REFLECT_101).
INLINE int reflect101(int i, int size)
{
  if (size == 1)
  {
    return 0;
  }
  while (i < 0 || i >= size)
  {
    i = i < 0 ? -i : 2 * (size - 1) - i;
  }
  return i;
}
