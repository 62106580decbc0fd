#include "dag_families.h"
#include "plan_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include <pi_runtime/inner_core_scheduler.h>

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::EtcMatrix;
using pi_runtime::TaskGraph;
using pi_runtime::TransferModel;

constexpr double MEAN_TIME = 1e-3;  // of a node [s]
constexpr double BANDWIDTH = 1e9;   // of every link [B/s]

uint32_t drawInteger(uint32_t lowest, uint32_t highest, std::mt19937_64* random)
{
  return std::uniform_int_distribution<uint32_t>(lowest, highest)(*random);
}

double drawReal(double lowest, double highest, std::mt19937_64* random)
{
  return std::uniform_real_distribution<double>(lowest, highest)(*random);
}

template <std::size_t N>
double drawOne(const std::array<double, N>& values, std::mt19937_64* random)
{
  return values[drawInteger(0, N - 1, random)];
}

/// Nodes and edges alone; bytes are shares that get their size later.
struct Shape
{
  uint32_t nodes = 0;
  std::vector<TaskGraph::Edge> edges;

  uint32_t add() { return nodes++; }
  uint32_t addAfter(const std::vector<uint32_t>& predecessors, double bytes = 1.0)
  {
    for (const uint32_t predecessor : predecessors)
    {
      edges.push_back({predecessor, nodes, bytes});
    }
    return nodes++;
  }
};

Shape randomLayers(std::mt19937_64* random)
{
  const uint32_t nodes = drawInteger(20, 40, random);
  const double alpha = drawOne<3>({0.5, 1.0, 2.0}, random);
  const uint32_t out_degree = drawInteger(1, 5, random);
  const double mean_width = std::sqrt(nodes) * alpha;

  Shape shape;
  std::vector<uint32_t> layer_begin = {0};
  std::set<std::pair<uint32_t, uint32_t>> edges;
  while (shape.nodes < nodes)
  {
    const auto drawn = static_cast<uint32_t>(std::lround(drawReal(1.0, 2.0 * mean_width - 1.0, random)));
    const uint32_t width = std::clamp(drawn, 1U, nodes - shape.nodes);
    for (uint32_t i = 0; i < width; ++i)
    {
      const uint32_t node = shape.add();
      if (layer_begin.size() > 1)  // a node of the layer above, so that this is its layer
      {
        edges.insert({drawInteger(layer_begin[layer_begin.size() - 2], layer_begin.back() - 1, random), node});
      }
    }
    layer_begin.push_back(shape.nodes);
  }
  for (std::size_t layer = 0; layer + 2 < layer_begin.size(); ++layer)
  {
    for (uint32_t node = layer_begin[layer]; node < layer_begin[layer + 1]; ++node)
    {
      for (uint32_t i = drawInteger(1, out_degree, random); i > 0; --i)
      {
        edges.insert({node, drawInteger(layer_begin[layer + 1], nodes - 1, random)});
      }
    }
  }
  for (const auto& [from, to] : edges)
  {
    shape.edges.push_back({from, to, 1.0});
  }
  return shape;
}

/// A binary tree of recursive calls, then log2(points) rows of butterflies.
Shape fft(std::mt19937_64* random)
{
  const uint32_t points = drawInteger(0, 1, random) == 0 ? 4 : 8;
  Shape shape;
  std::vector<uint32_t> row = {shape.add()};
  while (row.size() < points)
  {
    std::vector<uint32_t> next;
    for (const uint32_t node : row)
    {
      next.push_back(shape.addAfter({node}));
      next.push_back(shape.addAfter({node}));
    }
    row = next;
  }
  for (uint32_t distance = 1; distance < points; distance *= 2)
  {
    std::vector<uint32_t> next;
    for (uint32_t i = 0; i < points; ++i)
    {
      next.push_back(shape.addAfter({row[i], row[i ^ distance]}));
    }
    row = next;
  }
  return shape;
}

/// In step k a pivot, then an update of each column right of it.
Shape gauss(std::mt19937_64* random)
{
  const uint32_t columns = drawInteger(5, 8, random);
  Shape shape;
  std::vector<uint32_t> updated;  // last update of the columns from the pivot's on
  for (uint32_t k = 0; k + 1 < columns; ++k)
  {
    const uint32_t pivot = updated.empty() ? shape.add() : shape.addAfter({updated.front()});
    std::vector<uint32_t> next;
    for (uint32_t column = 1; column < columns - k; ++column)
    {
      next.push_back(updated.empty() ? shape.addAfter({pivot}) : shape.addAfter({pivot, updated[column]}));
    }
    updated = next;
  }
  return shape;
}

/// Project the images, fit the difference of overlapping ones, one model of the background, correct each image, add up.
Shape montage(std::mt19937_64* random)
{
  const uint32_t images = drawInteger(4, 8, random);
  Shape shape;
  std::vector<uint32_t> projected;
  for (uint32_t i = 0; i < images; ++i)
  {
    projected.push_back(shape.add());
  }
  std::vector<uint32_t> differences;
  for (uint32_t i = 0; i + 1 < images; ++i)
  {
    differences.push_back(shape.addAfter({projected[i], projected[i + 1]}));
    if (i + 2 < images)
    {
      differences.push_back(shape.addAfter({projected[i], projected[i + 2]}));
    }
  }
  const uint32_t model = shape.addAfter({shape.addAfter(differences)});
  std::vector<uint32_t> corrected;
  for (const uint32_t image : projected)
  {
    corrected.push_back(shape.addAfter({model, image}));
  }
  const uint32_t table = shape.addAfter(corrected);
  shape.addAfter({shape.addAfter({shape.addAfter({table})})});
  return shape;
}

/// What a node of the vehicle needs on a CPU core, and how many times as fast the accelerator is (0: cannot run it).
struct Work
{
  double time;  // [s]
  double acceleration;
};

Shape vehicle(std::vector<Work>* work)
{
  constexpr double IMAGE = 300e3;  // [B]
  constexpr double PYRAMID = 400e3;
  constexpr double FEATURES = 20e3;
  constexpr double TENSOR = 500e3;
  Shape shape;
  const auto node = [&](Work costs, const std::vector<uint32_t>& predecessors, double bytes)
  {
    work->push_back(costs);
    return shape.addAfter(predecessors, bytes);
  };
  const uint32_t rectify_left = node({1.5e-3, 4.0}, {}, 0);
  const uint32_t rectify_right = node({1.5e-3, 4.0}, {}, 0);
  const uint32_t pyramid_left = node({1.0e-3, 4.0}, {rectify_left}, IMAGE);
  const uint32_t pyramid_right = node({1.0e-3, 4.0}, {rectify_right}, IMAGE);
  const uint32_t corners = node({2.0e-3, 3.0}, {pyramid_left}, PYRAMID);
  const uint32_t track = node({2.5e-3, 1.5}, {pyramid_left}, PYRAMID);
  shape.edges.push_back({corners, track, FEATURES});
  const uint32_t match = node({3.0e-3, 2.0}, {pyramid_right}, PYRAMID);
  shape.edges.push_back({track, match, FEATURES});
  const uint32_t descriptors = node({1.5e-3, 2.0}, {pyramid_left}, PYRAMID);
  shape.edges.push_back({match, descriptors, FEATURES});

  std::vector<uint32_t> tiles = {node({1.0e-3, 0.0}, {}, 0)};  // the blob
  for (int stage = 0; stage < 4; ++stage)
  {
    const uint32_t upper = node({4.0e-3, 10.0}, tiles, TENSOR);
    const uint32_t lower = node({4.0e-3, 10.0}, tiles, TENSOR);
    tiles = {upper, lower};
  }
  node({0.8e-3, 0.0}, tiles, TENSOR);  // box decoding and suppression
  return shape;
}

/// @param work  filled for VEHICLE only.
Shape drawShape(DagFamily family, std::vector<Work>* work, std::mt19937_64* random)
{
  switch (family)
  {
    case DagFamily::RANDOM:
      return randomLayers(random);
    case DagFamily::FFT:
      return fft(random);
    case DagFamily::GAUSS:
      return gauss(random);
    case DagFamily::MONTAGE:
      return montage(random);
    case DagFamily::VEHICLE:
      return vehicle(work);
  }
  return {};
}

EtcMatrix vehicleTimes(const std::vector<Work>& work, const DagSetting& setting, std::mt19937_64* random)
{
  EtcMatrix etc(work.size(), setting.units);
  for (std::size_t node = 0; node < work.size(); ++node)
  {
    const double time = work[node].time * drawReal(0.8, 1.2, random);
    for (uint32_t unit = 0; unit < setting.units; ++unit)
    {
      etc.at(node, unit) = time;
    }
    if (setting.heterogeneous && setting.units > 1)
    {
      const double acceleration = work[node].acceleration;
      etc.at(node, setting.units - 1) =
          acceleration > 0.0 ? time / acceleration : std::numeric_limits<double>::infinity();
    }
  }
  return etc;
}

EtcMatrix randomTimes(std::size_t nodes, const DagSetting& setting, std::mt19937_64* random)
{
  const double beta = setting.heterogeneous ? drawOne<5>({0.1, 0.25, 0.5, 0.75, 1.0}, random) : 0.0;
  EtcMatrix etc(nodes, setting.units);
  for (std::size_t node = 0; node < nodes; ++node)
  {
    const double mean = drawReal(0.01, 1.99, random) * MEAN_TIME;
    for (uint32_t unit = 0; unit < setting.units; ++unit)
    {
      etc.at(node, unit) = mean * (1.0 + beta * drawReal(-0.5, 0.5, random));
    }
  }
  return etc;
}

}  // namespace

const char* toString(DagFamily family)
{
  switch (family)
  {
    case DagFamily::RANDOM:
      return "random";
    case DagFamily::FFT:
      return "fft";
    case DagFamily::GAUSS:
      return "gauss";
    case DagFamily::MONTAGE:
      return "montage";
    case DagFamily::VEHICLE:
      return "vehicle";
  }
  return "unknown";
}

DagProblem makeDagProblem(DagFamily family, const DagSetting& setting, std::mt19937_64* random)
{
  std::vector<Work> work;
  const Shape shape = drawShape(family, &work, random);
  const bool measured = family == DagFamily::VEHICLE;
  EtcMatrix etc = measured ? vehicleTimes(work, setting, random) : randomTimes(shape.nodes, setting, random);

  std::vector<TaskGraph::Edge> edges = shape.edges;
  for (TaskGraph::Edge& edge : edges)
  {
    edge.bytes *= measured ? drawReal(0.8, 1.2, random) : drawReal(0.01, 1.99, random);
  }
  if (setting.ccr == 0.0)
  {
    return {TaskGraph(shape.nodes, edges), std::move(etc), TransferModel(setting.units)};
  }
  const TransferModel transfers(setting.units, {0.0, BANDWIDTH});
  const double unscaled = communicationToComputation(TaskGraph(shape.nodes, edges), etc, transfers);
  for (TaskGraph::Edge& edge : edges)
  {
    edge.bytes *= setting.ccr / unscaled;
  }
  return {TaskGraph(shape.nodes, edges), std::move(etc), transfers};
}

}  // namespace pi_runtime_bench
