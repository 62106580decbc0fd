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

/// The first node of each connected part.
std::vector<uint32_t> anchorsOf(const MapData& map)
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
  std::vector<uint32_t> anchors;
  for (uint32_t i = 0; i < parent.size(); ++i)
  {
    if (parent[i] == i)
    {
      anchors.push_back(i);
    }
  }
  return anchors;
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

bool solve(const MapData& map, bool first, std::vector<State>* states)
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
    problem.AddResidualBlock(new EdgeError(edge), loss, (*states)[edge.from].data(), (*states)[edge.to].data());
  }
  for (const uint32_t anchor : anchorsOf(map))
  {
    problem.SetParameterBlockConstant((*states)[anchor].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = first ? 8 : 6;
  options.function_tolerance = 1e-4;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.IsSolutionUsable();
}

}  // namespace

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
  if (!solve(*map, true, &states) || (hasContradiction(*map, states) && !solve(*map, false, &states)) ||
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
  return true;
}

}  // namespace pi_slam::map
