#include "tracking/assignment.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace pi_detect
{
namespace
{

/// Rows enter one after the other, each along the shortest path of reduced costs to a free column or to a row that
/// gives up its own. Giving up is a column of cost `forbidden` with room for all rows, whose price is always 0.
class PathSearch
{
public:
  PathSearch(const Eigen::MatrixXd& cost, double forbidden)
    : forbidden_(forbidden)
    , allowed_(static_cast<size_t>(cost.rows()))
    , row_price_(static_cast<size_t>(cost.rows()), 0.0)
    , column_of_row_(static_cast<size_t>(cost.rows()), -1)
    , columns_(static_cast<size_t>(cost.cols()))
  {
    for (Eigen::Index column = 0; column < cost.cols(); ++column)
    {
      for (Eigen::Index row = 0; row < cost.rows(); ++row)
      {
        const double value = cost(row, column);
        if (std::isfinite(value) && value < forbidden)
        {
          allowed_[static_cast<size_t>(row)].push_back({static_cast<int>(column), value});
        }
      }
    }
  }

  std::vector<int> run()
  {
    for (int row = 0; row < static_cast<int>(allowed_.size()); ++row)
    {
      enter(row);
    }
    return column_of_row_;
  }

private:
  struct Pair
  {
    int column;
    double cost;
  };
  struct Column
  {
    double price = 0.0;
    double distance = std::numeric_limits<double>::infinity();  ///< from the row that enters
    int row = -1;                                               ///< that has it
    int from_row = -1;                                          ///< before it on the shortest path
    bool passed = false;
  };

  /// Distances to the columns that can be reached from a row.
  void reachFrom(int row, double distance)
  {
    for (const Pair& pair : allowed_[static_cast<size_t>(row)])
    {
      Column& column = columns_[static_cast<size_t>(pair.column)];
      const double through = distance + pair.cost - row_price_[static_cast<size_t>(row)] - column.price;
      if (!column.passed && through < column.distance)
      {
        if (column.from_row < 0)
        {
          reached_.push_back(pair.column);
        }
        column.distance = through;
        column.from_row = row;
      }
    }
  }

  int nearestReached() const
  {
    int nearest = -1;
    for (const int index : reached_)
    {
      const Column& column = columns_[static_cast<size_t>(index)];
      if (!column.passed && (nearest < 0 || column.distance < columns_[static_cast<size_t>(nearest)].distance))
      {
        nearest = index;
      }
    }
    return nearest;
  }

  void enter(int entering)
  {
    reached_.clear();
    int row = entering;
    double distance = 0.0;
    double give_up_distance = std::numeric_limits<double>::infinity();
    int row_to_give_up = entering;
    int free_column = -1;
    for (;;)
    {
      const double give_up = distance + forbidden_ - row_price_[static_cast<size_t>(row)];
      if (give_up < give_up_distance)
      {
        give_up_distance = give_up;
        row_to_give_up = row;
      }
      reachFrom(row, distance);
      const int nearest = nearestReached();
      if (nearest < 0 || columns_[static_cast<size_t>(nearest)].distance > give_up_distance)
      {
        distance = give_up_distance;
        break;
      }
      Column& column = columns_[static_cast<size_t>(nearest)];
      distance = column.distance;
      if (column.row < 0)
      {
        free_column = nearest;
        break;
      }
      column.passed = true;
      row = column.row;
    }
    updatePrices(entering, distance);
    shiftAlongPath(entering, free_column, row_to_give_up);
    for (const int index : reached_)
    {
      Column& column = columns_[static_cast<size_t>(index)];
      column.distance = std::numeric_limits<double>::infinity();
      column.from_row = -1;
      column.passed = false;
    }
  }

  /// So that no reduced cost is negative and those of assigned pairs are zero.
  void updatePrices(int entering, double path_length)
  {
    row_price_[static_cast<size_t>(entering)] += path_length;
    for (const int index : reached_)
    {
      Column& column = columns_[static_cast<size_t>(index)];
      if (column.passed)
      {
        row_price_[static_cast<size_t>(column.row)] += path_length - column.distance;
        column.price -= path_length - column.distance;
      }
    }
  }

  void shiftAlongPath(int entering, int free_column, int row_to_give_up)
  {
    int column = free_column;
    if (column < 0)
    {
      column = column_of_row_[static_cast<size_t>(row_to_give_up)];
      column_of_row_[static_cast<size_t>(row_to_give_up)] = -1;
      if (row_to_give_up == entering)
      {
        return;
      }
    }
    for (;;)
    {
      const int row = columns_[static_cast<size_t>(column)].from_row;
      columns_[static_cast<size_t>(column)].row = row;
      std::swap(column_of_row_[static_cast<size_t>(row)], column);
      if (row == entering)
      {
        return;
      }
    }
  }

  const double forbidden_;
  std::vector<std::vector<Pair>> allowed_;  ///< by row
  std::vector<double> row_price_;
  std::vector<int> column_of_row_;
  std::vector<Column> columns_;
  std::vector<int> reached_;
};

}  // namespace

std::vector<int> assign(const Eigen::MatrixXd& cost, double forbidden)
{
  if (!std::isfinite(forbidden))
  {
    throw std::invalid_argument("forbidden = " + std::to_string(forbidden) + " must be finite");
  }
  return PathSearch(cost, forbidden).run();
}

}  // namespace pi_detect
