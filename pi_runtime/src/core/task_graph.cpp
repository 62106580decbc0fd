#include <pi_runtime/task_graph.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

std::string name(uint32_t from, uint32_t to)
{
  return "task graph: edge " + std::to_string(from) + " -> " + std::to_string(to);
}

/// Turns the number of entries per row, counts[row + 1], into the place where each row begins.
void accumulate(std::vector<std::size_t>* counts)
{
  for (std::size_t i = 1; i < counts->size(); ++i)
  {
    (*counts)[i] += (*counts)[i - 1];
  }
}

}  // namespace

TaskGraph::TaskGraph(uint32_t nodes, const std::vector<Edge>& edges)
  : predecessors_begin_(nodes + std::size_t{1}, 0)
  , successors_begin_(nodes + std::size_t{1}, 0)
  , predecessors_(edges.size())
  , successors_(edges.size())
  , order_(nodes)
  , levels_(nodes, 0)
{
  for (const Edge& edge : edges)
  {
    checkEdge(edge);
  }
  linkEdges(edges);
  checkDuplicates();
  sortTopologically();
}

void TaskGraph::checkEdge(const Edge& edge) const
{
  const std::string last = nodes() == 0 ? "no nodes" : "nodes 0 to " + std::to_string(nodes() - 1);
  if (edge.from >= nodes() || edge.to >= nodes())
  {
    throw std::invalid_argument(name(edge.from, edge.to) + " has an unknown end: the graph has " + last);
  }
  if (edge.from == edge.to)
  {
    throw std::invalid_argument(name(edge.from, edge.to) + " makes a node wait for itself; leave it out");
  }
  if (!std::isfinite(edge.bytes) || edge.bytes < 0)
  {
    throw std::invalid_argument(name(edge.from, edge.to) + " hands over " + std::to_string(edge.bytes) +
                                " bytes, must be finite and >= 0");
  }
}

void TaskGraph::linkEdges(const std::vector<Edge>& edges)
{
  for (const Edge& edge : edges)
  {
    ++predecessors_begin_[edge.to + std::size_t{1}];
    ++successors_begin_[edge.from + std::size_t{1}];
  }
  accumulate(&predecessors_begin_);
  accumulate(&successors_begin_);
  auto next_predecessor = predecessors_begin_;
  auto next_successor = successors_begin_;
  for (const Edge& edge : edges)
  {
    predecessors_[next_predecessor[edge.to]++] = {edge.from, edge.bytes};
    successors_[next_successor[edge.from]++] = {edge.to, edge.bytes};
  }
}

void TaskGraph::checkDuplicates() const
{
  std::vector<uint32_t> seen_by(nodes(), nodes());
  for (uint32_t node = 0; node < nodes(); ++node)
  {
    for (const Link& successor : successors(node))
    {
      if (seen_by[successor.node] == node)
      {
        throw std::invalid_argument(name(node, successor.node) + " is given twice; give it once, with all its bytes");
      }
      seen_by[successor.node] = node;
    }
  }
}

// A queue, and not a stack or a heap, takes the nodes level by level: a node enters when its last predecessor leaves.
void TaskGraph::sortTopologically()
{
  std::vector<uint32_t> missing(nodes());
  std::size_t tail = 0;
  for (uint32_t node = 0; node < nodes(); ++node)
  {
    missing[node] = static_cast<uint32_t>(predecessors(node).size());
    if (missing[node] == 0)
    {
      order_[tail++] = node;
    }
  }
  for (std::size_t head = 0; head < tail; ++head)
  {
    for (const Link& successor : successors(order_[head]))
    {
      levels_[successor.node] = levels_[order_[head]] + 1;
      if (--missing[successor.node] == 0)
      {
        order_[tail++] = successor.node;
      }
    }
  }
  if (tail < order_.size())
  {
    throw std::invalid_argument("task graph: nodes wait for each other in a circle: " + describeCycle(missing) +
                                "; remove one of these edges");
  }
}

// A node that never became ready has a predecessor that never did: walking against the edges must come round.
std::string TaskGraph::describeCycle(const std::vector<uint32_t>& missing_predecessors) const
{
  const auto stuck = [&](uint32_t node) { return missing_predecessors[node] > 0; };
  uint32_t node = 0;
  while (!stuck(node))
  {
    ++node;
  }
  std::vector<uint32_t> way;
  std::vector<bool> visited(nodes(), false);
  while (!visited[node])
  {
    visited[node] = true;
    way.push_back(node);
    const Links links = predecessors(node);
    node = std::find_if(links.begin(), links.end(), [&](const Link& link) { return stuck(link.node); })->node;
  }
  std::string text = std::to_string(node);
  for (auto step = way.rbegin(); step != way.rend(); ++step)
  {
    text += " -> " + std::to_string(*step);
    if (*step == node)
    {
      break;
    }
  }
  return text;
}

}  // namespace pi_runtime
