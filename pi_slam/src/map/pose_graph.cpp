#include "map/pose_graph.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace pi_slam::map
{

namespace
{

using State = std::array<double, 4>;  // x, y, z, heading

constexpr double ROBUST = 3.0;  ///< deviations from which on a loop counts less
/// On the deviations of odometry beside GNSS: those are of steps, whose errors are taken for independent. Over
/// kilometres the scale is wrong by up to 1 % in the same direction.
constexpr double POSITION_FACTOR = 6.0;
constexpr double HEADING_FACTOR = 2.0;
constexpr double FIX_ROBUST = 2.0;  ///< likewise of GNSS, which is often wrong by far more: multipath

/// Residuals of one edge over its deviations: shift in the axes of `from`, then turn.
class EdgeError : public ceres::SizedCostFunction<4, 4, 4>
{
public:
  explicit EdgeError(const MapEdge& edge) : edge_(edge) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override
  {
    const Eigen::Map<const Eigen::Vector3d> from(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> to(parameters[1]);
    const double c = std::cos(parameters[0][3]);
    const double s = std::sin(parameters[0][3]);
    const Eigen::Vector3d across = to - from;
    Eigen::Matrix3d back;  // Rz(-heading_from)
    back << c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0;
    const double a = 1.0 / edge_.position_deviation;
    const double b = 1.0 / edge_.heading_deviation;
    Eigen::Map<Eigen::Vector4d> r(residuals);
    r.head<3>() = a * (back * across - edge_.shift);
    r(3) = b * std::remainder(parameters[1][3] - parameters[0][3] - edge_.turn, 2.0 * M_PI);
    using Jacobian = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
    if (jacobians != nullptr && jacobians[0] != nullptr)
    {
      Eigen::Map<Jacobian> J(jacobians[0]);
      J.setZero();
      J.topLeftCorner<3, 3>() = -a * back;
      J(0, 3) = a * (-s * across.x() + c * across.y());
      J(1, 3) = a * (-c * across.x() - s * across.y());
      J(3, 3) = -b;
    }
    if (jacobians != nullptr && jacobians[1] != nullptr)
    {
      Eigen::Map<Jacobian> J(jacobians[1]);
      J.setZero();
      J.topLeftCorner<3, 3>() = a * back;
      J(3, 3) = b;
    }
    return true;
  }

private:
  const MapEdge edge_;
};

/// Residuals of a fix of GNSS over its deviations, by node and place on earth.
class FixError : public ceres::SizedCostFunction<3, 4, 4>
{
public:
  explicit FixError(const MapFix& fix) : fix_(fix) {}

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override
  {
    const Eigen::Map<const Eigen::Vector3d> node(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> place(parameters[1]);
    const Eigen::Matrix3d node_turn = aboutZ(parameters[0][3]);
    const Eigen::Matrix3d turn = aboutZ(parameters[1][3]);
    const Eigen::Vector3d shift = node_turn * fix_.shift;
    const Eigen::Vector3d antenna = turn * (node + shift);
    const Eigen::Vector3d weight(1.0 / fix_.deviation, 1.0 / fix_.deviation, 1.0 / fix_.up_deviation);
    Eigen::Map<Eigen::Vector3d> r(residuals);
    r = weight.cwiseProduct(antenna + place - fix_.p_local);
    using Jacobian = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
    if (jacobians != nullptr && jacobians[0] != nullptr)
    {
      Eigen::Map<Jacobian> J(jacobians[0]);
      J.leftCols<3>() = weight.asDiagonal() * turn;
      J.col(3) = weight.cwiseProduct(turn * Eigen::Vector3d::UnitZ().cross(shift));
    }
    if (jacobians != nullptr && jacobians[1] != nullptr)
    {
      Eigen::Map<Jacobian> J(jacobians[1]);
      J.leftCols<3>() = weight.asDiagonal();
      J.col(3) = weight.cwiseProduct(Eigen::Vector3d::UnitZ().cross(antenna));
    }
    return true;
  }

private:
  static Eigen::Matrix3d aboutZ(double angle)
  {
    return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  }
  const MapFix fix_;
};

/// The first node of the connected part of each node.
std::vector<uint32_t> rootsOf(const MapData& map)
{
  std::vector<uint32_t> parent(map.nodes.size());
  std::iota(parent.begin(), parent.end(), 0U);
  const auto root = [&](uint32_t i)
  {
    while (parent[i] != i)
    {
      parent[i] = parent[parent[i]];
      i = parent[i];
    }
    return i;
  };
  for (const MapEdge& edge : map.edges)
  {
    const uint32_t a = root(edge.from);
    const uint32_t b = root(edge.to);
    parent[std::max(a, b)] = std::min(a, b);
  }
  for (uint32_t i = 0; i < parent.size(); ++i)
  {
    parent[i] = root(i);
  }
  return parent;
}

/// The fixes of the connected part that has the oldest one: others have a place of their own until they are joined.
std::vector<MapFix> usedFixes(const MapData& map, const std::vector<uint32_t>& roots)
{
  std::vector<MapFix> fixes;
  for (const MapFix& fix : map.fixes)
  {
    if (roots[fix.node] == roots[map.fixes.front().node])
    {
      fixes.push_back(fix);
    }
  }
  return fixes;
}

/// Whether a loop is so far off that it counts less than in full.
bool hasContradiction(const MapData& map, const std::vector<State>& states)
{
  return std::any_of(map.edges.begin(), map.edges.end(),
                     [&](const MapEdge& edge)
                     {
                       const double* const parameters[2] = {states[edge.from].data(), states[edge.to].data()};
                       Eigen::Vector4d residuals;
                       return edge.loop && EdgeError(edge).Evaluate(parameters, residuals.data(), nullptr) &&
                              residuals.norm() > ROBUST;
                     });
}

/// @param earth  null: its place is not known.
bool solve(const MapData& map, const std::vector<uint32_t>& roots, bool first, std::vector<State>* states, State* earth)
{
  ceres::Problem problem;
  for (State& state : *states)
  {
    problem.AddParameterBlock(state.data(), 4);
  }
  for (const MapEdge& edge : map.edges)
  {
    ceres::LossFunction* loss = nullptr;
    if (edge.loop)
    {
      loss = first ? static_cast<ceres::LossFunction*>(new ceres::HuberLoss(ROBUST)) : new ceres::CauchyLoss(ROBUST);
    }
    MapEdge weighed = edge;
    if (earth != nullptr && !edge.loop)
    {
      weighed.position_deviation *= POSITION_FACTOR;
      weighed.heading_deviation *= HEADING_FACTOR;
    }
    problem.AddResidualBlock(new EdgeError(weighed), loss, (*states)[edge.from].data(), (*states)[edge.to].data());
  }
  if (earth != nullptr)
  {
    problem.AddParameterBlock(earth->data(), 4);
    for (const MapFix& fix : usedFixes(map, roots))
    {
      problem.AddResidualBlock(new FixError(fix), new ceres::CauchyLoss(FIX_ROBUST), (*states)[fix.node].data(),
                               earth->data());
    }
  }
  for (uint32_t i = 0; i < roots.size(); ++i)
  {
    if (roots[i] == i)
    {
      problem.SetParameterBlockConstant((*states)[i].data());
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = earth != nullptr ? 30 : first ? 8 : 6;
  options.function_tolerance = 1e-4;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable();
}

}  // namespace

std::optional<EarthPlace> locateOnEarth(const MapData& map)
{
  if (map.earth || map.fixes.empty())
  {
    return map.earth;
  }
  std::vector<PlacePair> pairs;
  for (const MapFix& fix : usedFixes(map, rootsOf(map)))
  {
    const MapNode& node = map.nodes[fix.node];
    const Eigen::Vector3d shift = Eigen::AngleAxisd(node.heading, Eigen::Vector3d::UnitZ()) * fix.shift;
    pairs.push_back({node.p_map_body + shift, fix.p_local, fix.deviation});
  }
  return findEarthPlace(pairs);
}

bool optimizePoseGraph(MapData* map)
{
  if (map->nodes.size() < 2 || map->edges.empty())
  {
    return false;
  }
  std::vector<State> states(map->nodes.size());
  for (size_t i = 0; i < states.size(); ++i)
  {
    const MapNode& node = map->nodes[i];
    states[i] = {node.p_map_body.x(), node.p_map_body.y(), node.p_map_body.z(), node.heading};
  }
  const std::vector<uint32_t> roots = rootsOf(*map);
  const std::optional<EarthPlace> place = map->fixes.empty() ? std::nullopt : locateOnEarth(*map);
  State earth{};
  if (place)
  {
    earth = {place->position.x(), place->position.y(), place->position.z(), place->heading};
  }
  State* const on_earth = place ? &earth : nullptr;
  if (!solve(*map, roots, true, &states, on_earth) ||
      (hasContradiction(*map, states) && !solve(*map, roots, false, &states, on_earth)) ||
      !std::all_of(states.begin(), states.end(),
                   [](const State& state) { return Eigen::Map<const Eigen::Vector4d>(state.data()).allFinite(); }))
  {
    return false;
  }
  for (size_t i = 0; i < states.size(); ++i)
  {
    map->nodes[i].p_map_body = Eigen::Vector3d(states[i][0], states[i][1], states[i][2]);
    map->nodes[i].heading = states[i][3];
  }
  if (place)
  {
    map->earth = EarthPlace{Eigen::Vector3d(earth[0], earth[1], earth[2]), earth[3]};
  }
  return true;
}

}  // namespace pi_slam::map
