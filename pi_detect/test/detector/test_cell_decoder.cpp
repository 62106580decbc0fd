#include <gtest/gtest.h>
#include <pi_detect/model_description.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "detector/cell_decoder.h"
#include "detector/output_shapes.h"

namespace pi_detect
{
namespace
{

/// Two strides of 16 and 32 on 64 x 32 pixels: 4 x 2 and 2 x 1 cells.
constexpr size_t CELLS = 10;
constexpr size_t GRID_COLUMNS = 5 + 2;
constexpr int BINS = 4;

ModelDescription modelOf(OutputKind kind)
{
  ModelDescription model;
  model.name = "cells";
  model.input.width = 64;
  model.input.height = 32;
  model.output_kind = kind;
  model.cells.strides = {16, 32};
  model.cells.offset = kind == OutputKind::GRID ? 0.0F : 0.5F;
  model.cells.bins = BINS;
  model.cells.classes = 2;
  model.labels = {{0, "person"}, {1, "car"}};
  return model;
}

std::vector<DecodedRow> decode(const ModelDescription& model, const std::vector<cv::Mat>& outputs,
                               float score_threshold = 0.3F)
{
  const CellDecoder decoder(model, score_threshold);
  std::vector<pi_runtime::Argument> arguments = {pi_runtime::Argument::value(0)};
  for (const pi_runtime::BufferPtr& output : decoder.outputs())
  {
    arguments.push_back(pi_runtime::Argument::out(output));
  }
  decoder.store()(outputs, pi_runtime::NativeCall(arguments, 0, 1, 1, nullptr));
  const auto task = decoder.task();
  task->codelet->native[0].function(pi_runtime::NativeCall(task->arguments, 0, 1, 1, nullptr));
  const DecodedRows rows = decoder.rows();
  return std::vector<DecodedRow>(rows.first, rows.first + rows.count);
}

/// A grid without objects.
cv::Mat emptyGrid()
{
  return cv::Mat::zeros(static_cast<int>(CELLS), static_cast<int>(GRID_COLUMNS), CV_32F);
}

void setCell(int cell, const std::vector<float>& values, cv::Mat* grid)
{
  std::copy(values.begin(), values.end(), grid->ptr<float>(cell));
}

void expectBox(const DecodedRow& row, float x1, float y1, float x2, float y2)
{
  EXPECT_NEAR(x1 / 64.0F, row.x1, 1e-6);
  EXPECT_NEAR(y1 / 32.0F, row.y1, 1e-6);
  EXPECT_NEAR(x2 / 64.0F, row.x2, 1e-6);
  EXPECT_NEAR(y2 / 32.0F, row.y2, 1e-6);
}

TEST(GridDecoder, PlacesBoxesByCellAndStride)
{
  cv::Mat grid = emptyGrid();
  setCell(6, {0.25F, 0.5F, std::log(2.0F), 0.0F, 0.8F, 0.5F, 0.75F}, &grid);  // column 2, row 1 of stride 16
  setCell(9, {0.5F, 0.5F, 0.0F, std::log(0.5F), 1.0F, 0.5F, 0.1F}, &grid);    // column 1, row 0 of stride 32
  const auto rows = decode(modelOf(OutputKind::GRID), {grid});
  ASSERT_EQ(2u, rows.size());
  EXPECT_EQ(1.0F, rows[0].class_id);
  EXPECT_FLOAT_EQ(0.8F * 0.75F, rows[0].score);
  expectBox(rows[0], 36.0F - 16.0F, 24.0F - 8.0F, 36.0F + 16.0F, 24.0F + 8.0F);
  EXPECT_EQ(0.0F, rows[1].class_id);
  EXPECT_FLOAT_EQ(0.5F, rows[1].score);
  expectBox(rows[1], 48.0F - 16.0F, 16.0F - 8.0F, 48.0F + 16.0F, 16.0F + 8.0F);
}

TEST(GridDecoder, AppliesTheSigmoidWhereTheNetworkDoesNot)
{
  ModelDescription model = modelOf(OutputKind::GRID);
  model.cells.sigmoid = true;
  cv::Mat grid = cv::Mat(static_cast<int>(CELLS), static_cast<int>(GRID_COLUMNS), CV_32F, cv::Scalar(-10.0));
  setCell(0, {0.0F, 0.0F, 0.0F, 0.0F, 2.0F, 1.0F, 0.0F}, &grid);
  const auto rows = decode(model, {grid});
  ASSERT_EQ(1u, rows.size());
  EXPECT_NEAR(1.0 / (1.0 + std::exp(-2.0)) / (1.0 + std::exp(-1.0)), rows[0].score, 1e-6);
}

TEST(GridDecoder, SuppressesWithinAClassOnly)
{
  cv::Mat grid = emptyGrid();
  setCell(0, {0.5F, 0.5F, 0.0F, 0.0F, 1.0F, 0.9F, 0.0F}, &grid);
  setCell(1, {-0.5F, 0.5F, 0.0F, 0.0F, 1.0F, 0.8F, 0.0F}, &grid);  // the same box
  setCell(4, {0.5F, -0.5F, 0.0F, 0.0F, 1.0F, 0.0F, 0.7F}, &grid);  // and once more, as another class
  const auto rows = decode(modelOf(OutputKind::GRID), {grid});
  ASSERT_EQ(2u, rows.size());
  EXPECT_FLOAT_EQ(0.9F, rows[0].score);
  EXPECT_FLOAT_EQ(0.7F, rows[1].score);
}

TEST(GridDecoder, KeepsTheBestOfTooMany)
{
  ModelDescription model = modelOf(OutputKind::GRID);
  model.cells.keep_top_k = 2;
  cv::Mat grid = emptyGrid();
  for (int cell = 0; cell < 8; ++cell)
  {
    setCell(cell, {0.5F, 0.5F, 0.0F, 0.0F, 1.0F, 0.4F + 0.05F * static_cast<float>(cell), 0.0F}, &grid);
  }
  const auto rows = decode(model, {grid});
  ASSERT_EQ(2u, rows.size());
  EXPECT_FLOAT_EQ(0.75F, rows[0].score);
  EXPECT_FLOAT_EQ(0.70F, rows[1].score);
}

TEST(GridDecoder, FindsNothingInWhatIsNotANumber)
{
  const cv::Mat grid(static_cast<int>(CELLS), static_cast<int>(GRID_COLUMNS), CV_32F, cv::Scalar(std::nanf("")));
  EXPECT_TRUE(decode(modelOf(OutputKind::GRID), {grid}).empty());
}

/// Scores and distances for one person: all weight on one bin per side.
struct Distributions
{
  explicit Distributions(int cells)
    : scores(cv::Mat::zeros(cells, 2, CV_32F)), distances(cv::Mat::zeros(cells, 4 * BINS, CV_32F))
  {
  }
  void set(int cell, float score, const std::vector<int>& bins)
  {
    scores.at<float>(cell, 0) = score;
    for (int side = 0; side < 4; ++side)
    {
      distances.at<float>(cell, side * BINS + bins[static_cast<size_t>(side)]) = 50.0F;
    }
  }
  cv::Mat scores;
  cv::Mat distances;
};

TEST(DistributionDecoder, TakesTheExpectedDistanceOfEachSide)
{
  Distributions fine(8);
  Distributions coarse(2);
  fine.set(5, 0.9F, {1, 0, 2, 1});       // column 1, row 1 of stride 16
  coarse.scores.at<float>(0, 1) = 0.6F;  // even weights: 1.5 strides
  const auto rows =
      decode(modelOf(OutputKind::DISTRIBUTION), {fine.scores, fine.distances, coarse.scores, coarse.distances});
  ASSERT_EQ(2u, rows.size());
  EXPECT_FLOAT_EQ(0.9F, rows[0].score);
  expectBox(rows[0], 24.0F - 16.0F, 24.0F, 24.0F + 32.0F, 24.0F + 16.0F);
  EXPECT_EQ(1.0F, rows[1].class_id);
  expectBox(rows[1], 16.0F - 48.0F, 16.0F - 48.0F, 16.0F + 48.0F, 16.0F + 48.0F);
}

TEST(DistributionDecoder, TakesAllCellsInOneOutput)
{
  Distributions fine(8);
  Distributions coarse(2);
  fine.set(5, 0.9F, {1, 0, 2, 1});
  coarse.set(1, 0.6F, {0, 0, 0, 0});
  cv::Mat fine_cells;
  cv::Mat coarse_cells;
  cv::Mat cells;
  cv::hconcat(fine.scores, fine.distances, fine_cells);
  cv::hconcat(coarse.scores, coarse.distances, coarse_cells);
  cv::vconcat(fine_cells, coarse_cells, cells);
  const ModelDescription model = modelOf(OutputKind::DISTRIBUTION);
  const auto expected = decode(model, {fine.scores, fine.distances, coarse.scores, coarse.distances});
  const auto rows = decode(model, {cells});
  ASSERT_EQ(2u, rows.size());
  for (size_t i = 0; i < rows.size(); ++i)
  {
    EXPECT_EQ(expected[i].score, rows[i].score);
    EXPECT_EQ(expected[i].x1, rows[i].x1);
  }
}

TEST(OutputShapes, TellTheKind)
{
  ModelDescription model = modelOf(OutputKind::DETECTIONS);
  EXPECT_EQ(OutputKind::GRID, kindOf({{"output", CELLS, 7}}, model));  // 5 + 2 classes, and as many rows as cells
  EXPECT_EQ(OutputKind::DETECTIONS, kindOf({{"detections", 100, 7}}, model));
  EXPECT_EQ(OutputKind::DISTRIBUTION, kindOf({{"output", CELLS, 2 + 4 * 8}}, model));
  EXPECT_EQ(OutputKind::DISTRIBUTION, kindOf({{"a", 2, 2}, {"b", 8, 16}, {"c", 2, 16}, {"d", 8, 2}}, model));
  EXPECT_EQ(std::nullopt, kindOf({{"boxes", 30, 4}, {"scores", 30, 3}}, model));
  EXPECT_EQ(std::nullopt, kindOf({{"output", 1, 1000}}, model));
  EXPECT_EQ(std::nullopt, kindOf({}, model));
}

TEST(OutputShapes, OrderDistributionsByStrideWhateverTheirNames)
{
  const ModelDescription model = modelOf(OutputKind::DISTRIBUTION);
  const std::vector<OutputShape> outputs = {{"a", 2, 16}, {"b", 8, 16}, {"c", 2, 2}, {"d", 8, 2}};
  EXPECT_EQ((std::vector<size_t>{3, 1, 2, 0}), orderOfDistributions(outputs, model));
  EXPECT_TRUE(orderOfDistributions({{"a", 2, 16}, {"b", 8, 16}, {"c", 2, 2}}, model).empty());
}

TEST(OutputShapes, CountCellsAtTheEdgeAsWhole)
{
  EXPECT_EQ(CELLS, cellsOf(modelOf(OutputKind::GRID).input, {16, 32}));
  NetworkInput odd;
  odd.width = 65;
  odd.height = 31;
  EXPECT_EQ(5u * 2u, cellsOf(odd, {16}));  // rounded up
}

}  // namespace
}  // namespace pi_detect
