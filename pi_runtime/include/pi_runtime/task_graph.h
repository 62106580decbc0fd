#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace pi_runtime
{

/// A directed acyclic graph of sub-tasks, numbered 0 to nodes() - 1. Immutable, so any thread may read it.
class TaskGraph
{
public:
  struct Edge
  {
    uint32_t from;     ///< must have finished before `to` starts
    uint32_t to;       ///< needs the result of `from`
    double bytes = 0;  ///< data handed over [B], finite and >= 0; 0: only the order matters
  };

  /// One end of an edge, as seen from its other end.
  struct Link
  {
    uint32_t node;
    double bytes;  ///< [B]
  };

  /// The links of one node, in the order in which the edges were given.
  class Links
  {
  public:
    Links(const Link* begin, const Link* end) : begin_(begin), end_(end) {}
    const Link* begin() const { return begin_; }
    const Link* end() const { return end_; }
    std::size_t size() const { return static_cast<std::size_t>(end_ - begin_); }
    bool empty() const { return begin_ == end_; }

  private:
    const Link* begin_;
    const Link* end_;
  };

  /// The empty graph.
  TaskGraph() : TaskGraph(0, {}) {}

  /// @throws std::invalid_argument  an edge from a node to itself, with an unknown node, given twice or with impossible
  ///                                bytes, or edges that form a cycle; the message names the edge or the cycle's nodes.
  TaskGraph(uint32_t nodes, const std::vector<Edge>& edges);

  uint32_t nodes() const { return static_cast<uint32_t>(order_.size()); }
  std::size_t edges() const { return predecessors_.size(); }

  /// @param node  below nodes(); not checked.
  Links predecessors(uint32_t node) const
  {
    return {predecessors_.data() + predecessors_begin_[node], predecessors_.data() + predecessors_begin_[node + 1]};
  }
  Links successors(uint32_t node) const
  {
    return {successors_.data() + successors_begin_[node], successors_.data() + successors_begin_[node + 1]};
  }

  /// All nodes, level by level, so predecessors come first. Depends only on nodes and edges as given.
  const std::vector<uint32_t>& topologicalOrder() const { return order_; }

  /// Number of edges on the longest path from a node without predecessors. Nodes of one level do not depend on each
  /// other; each node of a level > 0 has a predecessor in the level above.
  uint32_t level(uint32_t node) const { return levels_[node]; }
  uint32_t levels() const { return order_.empty() ? 0 : levels_[order_.back()] + 1; }

private:
  void checkEdge(const Edge& edge) const;
  void linkEdges(const std::vector<Edge>& edges);
  void checkDuplicates() const;
  void sortTopologically();
  std::string describeCycle(const std::vector<uint32_t>& missing_predecessors) const;

  std::vector<std::size_t> predecessors_begin_;  // nodes + 1
  std::vector<std::size_t> successors_begin_;    // nodes + 1
  std::vector<Link> predecessors_;               // of node 0, of node 1, ...
  std::vector<Link> successors_;
  std::vector<uint32_t> order_;
  std::vector<uint32_t> levels_;
};

}  // namespace pi_runtime
