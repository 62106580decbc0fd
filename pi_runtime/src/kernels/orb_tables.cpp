#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include <pi_runtime/kernels/orb.h>

namespace pi_runtime
{
namespace kernels
{
namespace
{

constexpr int CANDIDATES = 2000;
constexpr int64_t ONE = 1 << 14;          ///< correlation 1
constexpr int64_t CORRELATION_AREA = 49;  ///< [px^2]: correlation is a half at 7 px
constexpr int SHORTEST = 6;               ///< of the two pixels of a test [px]
constexpr int FIRST_BOUND = 50;           ///< of correlations [percent]
constexpr int LONGEST = 2 * ORB_TEST_RADIUS;

struct Pixel
{
  int x;
  int y;
};

struct Test
{
  Pixel a;
  Pixel b;
  int64_t variance;  ///< of the difference, in units of ONE
};

int squaredDistance(Pixel a, Pixel b)
{
  return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
}

/// Covariance of two pixels of the model, in units of ONE.
int64_t covariance(Pixel a, Pixel b)
{
  static const std::vector<int64_t> by_square = []
  {
    std::vector<int64_t> table(LONGEST * LONGEST + 1);
    for (int64_t square = 0; square < static_cast<int64_t>(table.size()); ++square)
    {
      table[square] = ONE * CORRELATION_AREA / (CORRELATION_AREA + square);
    }
    return table;
  }();
  return by_square[squaredDistance(a, b)];
}

int64_t covariance(const Test& s, const Test& t)
{
  return covariance(s.a, t.a) - covariance(s.a, t.b) - covariance(s.b, t.a) + covariance(s.b, t.b);
}

bool inDisc(Pixel p, int radius)
{
  return p.x * p.x + p.y * p.y <= radius * radius;
}

/// The moment m10 = sum of x times grey level over the disc.
class Moment
{
public:
  Moment()
  {
    for (int y = -ORB_RADIUS; y <= ORB_RADIUS; ++y)
    {
      for (int x = -ORB_RADIUS; x <= ORB_RADIUS; ++x)
      {
        if (inDisc({x, y}, ORB_RADIUS))
        {
          disc_.push_back({x, y});
        }
      }
    }
    for (const Pixel& p : disc_)
    {
      variance_ += static_cast<double>(p.x * with(p));
    }
  }
  /// Covariance with one pixel.
  int64_t with(Pixel p) const
  {
    int64_t sum = 0;
    for (const Pixel& q : disc_)
    {
      sum += q.x * covariance(p, q);
    }
    return sum;
  }
  /// Its correlation with a test of pixels a and b, without sign.
  int64_t percent(Pixel a, Pixel b, int64_t variance) const
  {
    const double covariance = static_cast<double>(with(a) - with(b));
    return std::lrint(100.0 * std::abs(covariance) / std::sqrt(static_cast<double>(variance) * variance_));
  }

private:
  std::vector<Pixel> disc_;
  double variance_ = 0.0;
};

struct Candidate
{
  Test test;
  int64_t moment_percent;  ///< its correlation with m10
};

/// Sum of twelve uniform numbers of up to 255: nearly normal, mean 0, sigma 10 px after scaling. (Distributions of the
/// standard library differ from one implementation to the next, its generators do not.)
int drawCoordinate(std::mt19937& random)
{
  int sum = -12 * 255 / 2;
  for (int i = 0; i < 12; ++i)
  {
    sum += static_cast<int>(random() >> 24);
  }
  return (sum * 100 + (sum < 0 ? -1280 : 1280)) / 2560;
}

Pixel drawPixel(std::mt19937& random)
{
  for (;;)
  {
    const int x = drawCoordinate(random);
    const Pixel pixel{x, drawCoordinate(random)};
    if (inDisc(pixel, ORB_TEST_RADIUS))
    {
      return pixel;
    }
  }
}

std::vector<Candidate> drawCandidates()
{
  const Moment moment;
  std::mt19937 random(20110611);
  std::vector<Candidate> candidates;
  while (candidates.size() < CANDIDATES)
  {
    const Pixel a = drawPixel(random);
    const Pixel b = drawPixel(random);
    if (squaredDistance(a, b) < SHORTEST * SHORTEST)
    {
      continue;
    }
    const int64_t variance = 2 * (ONE - covariance(a, b));
    candidates.push_back({{a, b, variance}, moment.percent(a, b, variance)});
  }
  return candidates;
}

bool correlated(const Test& s, const Test& t, int64_t percent)
{
  const int64_t c = covariance(s, t);
  return 10000 * c * c > percent * percent * s.variance * t.variance;
}

std::vector<Test> chooseTests()
{
  const std::vector<Candidate> candidates = drawCandidates();
  for (int64_t bound = FIRST_BOUND;; ++bound)
  {
    std::vector<Test> chosen;
    for (const Candidate& candidate : candidates)
    {
      bool fits = 5 * candidate.moment_percent <= 2 * bound;
      for (size_t i = 0; fits && i < chosen.size(); ++i)
      {
        fits = !correlated(candidate.test, chosen[i], bound);
      }
      if (fits)
      {
        chosen.push_back(candidate.test);
        if (chosen.size() == ORB_BITS)
        {
          return chosen;
        }
      }
    }
  }
}

OrbTables makeTables()
{
  OrbTables tables{};
  const std::vector<Test> tests = chooseTests();
  for (int i = 0; i < ORB_BITS; ++i)
  {
    tables.x[i] = static_cast<int16_t>(tests[i].a.x);
    tables.y[i] = static_cast<int16_t>(tests[i].a.y);
    tables.x[i + ORB_BITS] = static_cast<int16_t>(tests[i].b.x);
    tables.y[i + ORB_BITS] = static_cast<int16_t>(tests[i].b.y);
  }
  const double step = 2.0 * std::acos(-1.0) / ORB_ANGLES;
  for (int i = 0; i < ORB_ANGLES; ++i)
  {
    tables.cosine[i] = static_cast<int16_t>(std::lrint(ONE * std::cos(i * step)));
    tables.sine[i] = static_cast<int16_t>(std::lrint(ONE * std::sin(i * step)));
  }
  for (int i = 0; i < ORB_ANGLES / 8; ++i)
  {
    tables.octant[i] = static_cast<int32_t>(std::lrint(ONE * std::tan((i + 0.5) * step)));
  }
  for (int y = 0; y < 31; ++y)
  {
    for (int x = 0; x < 31; ++x)
    {
      const bool inside = inDisc({x - ORB_RADIUS, y - ORB_RADIUS}, ORB_RADIUS);
      tables.column[y][x] = static_cast<int16_t>(inside ? x - ORB_RADIUS : 0);
      tables.disc[y][x] = inside ? 1 : 0;
    }
  }
  return tables;
}

}  // namespace

const OrbTables& orbTables()
{
  static const OrbTables tables = makeTables();
  return tables;
}

BufferPtr orbTablesBuffer()
{
  // Copied to memory of its own for the alignment that OpenCL units want; shared by all tasks.
  static const BufferPtr buffer = []
  {
    const BufferPtr result = Buffer::allocate(sizeof(OrbTables));
    *result->hostAs<OrbTables>(Access::WRITE) = orbTables();
    return result;
  }();
  return buffer;
}

}  // namespace kernels
}  // namespace pi_runtime
