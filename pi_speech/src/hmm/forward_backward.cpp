#include "hmm/forward_backward.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace pi_speech
{

namespace
{

constexpr float NONE = -std::numeric_limits<float>::infinity();

// Transition probabilities. They matter little beside the emissions of 39 features, and are not trained.
const float STAY = std::log(0.6F);
const float NEXT = std::log(0.35F);
const float SKIP = std::log(0.05F);
const float FIRST_SKIPPED = std::log(0.1F);

const float FILLER_STAY = std::log(0.7F);
const float FILLER_CHANGE = std::log(0.25F);  ///< to any of the states
const float FILLER_END = std::log(0.05F);
const float FILLER_BEGIN = std::log(0.1F);  ///< with any of the states
const float BACKGROUND_STAY = std::log(0.9F);

float addLog(float a, float b)
{
  if (a < b)
  {
    std::swap(a, b);
  }
  return b == NONE ? a : a + std::log1p(std::exp(b - a));
}

float sumLog(const Eigen::Ref<const Eigen::RowVectorXf>& values)
{
  const float most = values.maxCoeff();
  return most == NONE ? NONE : most + std::log((values.array() - most).exp().sum());
}

}  // namespace

float chainScore(const RowMatrix& emissions, const std::vector<int>& columns, RowMatrix* occupancies)
{
  const Eigen::Index frames = emissions.rows();
  const auto states = static_cast<Eigen::Index>(columns.size());
  if (frames == 0)
  {
    return NONE;
  }
  RowMatrix forward(frames, states);
  forward.row(0).setConstant(NONE);
  forward(0, 0) = emissions(0, columns[0]);
  forward(0, 1) = FIRST_SKIPPED + emissions(0, columns[1]);
  for (Eigen::Index t = 1; t < frames; ++t)
  {
    for (Eigen::Index s = 0; s < states; ++s)
    {
      float sum = forward(t - 1, s) + STAY;
      if (s >= 1)
      {
        sum = addLog(sum, forward(t - 1, s - 1) + NEXT);
      }
      if (s >= 2)
      {
        sum = addLog(sum, forward(t - 1, s - 2) + SKIP);
      }
      forward(t, s) = sum + emissions(t, columns[static_cast<size_t>(s)]);
    }
  }
  const float score = addLog(forward(frames - 1, states - 1), forward(frames - 1, states - 2) + NEXT);
  if (occupancies == nullptr || score == NONE)
  {
    return score;
  }
  Eigen::RowVectorXf backward = Eigen::RowVectorXf::Constant(states, NONE);
  backward(states - 1) = 0.0F;
  backward(states - 2) = NEXT;
  Eigen::RowVectorXf next(states);
  occupancies->resize(frames, states);
  for (Eigen::Index t = frames - 1;; --t)
  {
    occupancies->row(t) = (forward.row(t) + backward).array() - score;
    if (t == 0)
    {
      break;
    }
    for (Eigen::Index s = 0; s < states; ++s)
    {
      next(s) = backward(s) + emissions(t, columns[static_cast<size_t>(s)]);
    }
    for (Eigen::Index s = 0; s < states; ++s)
    {
      float sum = STAY + next(s);
      if (s + 1 < states)
      {
        sum = addLog(sum, NEXT + next(s + 1));
      }
      if (s + 2 < states)
      {
        sum = addLog(sum, SKIP + next(s + 2));
      }
      backward(s) = sum;
    }
  }
  *occupancies = occupancies->array().exp();
  return score;
}

float fillerScore(const RowMatrix& filler, const RowMatrix& background, RowMatrix* filler_occupancies,
                  RowMatrix* background_occupancies)
{
  const Eigen::Index frames = filler.rows();
  const Eigen::Index states = filler.cols();
  if (frames == 0)
  {
    return NONE;
  }
  const float share = -std::log(static_cast<float>(states));
  RowMatrix forward(frames, states);
  Eigen::VectorXf before(frames);  // background before the speech
  Eigen::VectorXf after(frames);
  forward.row(0) = filler.row(0).array() + (FILLER_BEGIN + share);
  before(0) = background(0, 0);
  after(0) = NONE;
  for (Eigen::Index t = 1; t < frames; ++t)
  {
    const float all = sumLog(forward.row(t - 1));
    const float entered = addLog(all + FILLER_CHANGE, before(t - 1) + FILLER_BEGIN) + share;
    for (Eigen::Index s = 0; s < states; ++s)
    {
      forward(t, s) = addLog(forward(t - 1, s) + FILLER_STAY, entered) + filler(t, s);
    }
    before(t) = before(t - 1) + BACKGROUND_STAY + background(t, 0);
    after(t) = addLog(after(t - 1) + STAY, all + FILLER_END) + background(t, 0);
  }
  const float score = addLog(after(frames - 1), sumLog(forward.row(frames - 1)));
  if (filler_occupancies == nullptr)
  {
    return score;
  }
  filler_occupancies->resize(frames, states);
  background_occupancies->resize(frames, 1);
  Eigen::RowVectorXf backward = Eigen::RowVectorXf::Zero(states);
  float backward_before = NONE;
  float backward_after = 0.0F;
  for (Eigen::Index t = frames - 1;; --t)
  {
    filler_occupancies->row(t) = ((forward.row(t) + backward).array() - score).exp();
    (*background_occupancies)(t, 0) =
        std::exp(before(t) + backward_before - score) + std::exp(after(t) + backward_after - score);
    if (t == 0)
    {
      return score;
    }
    const Eigen::RowVectorXf next = backward + filler.row(t);
    const float entered = sumLog(next) + share;
    const float ended = backward_after + background(t, 0);
    const float left = addLog(entered + FILLER_CHANGE, ended + FILLER_END);
    for (Eigen::Index s = 0; s < states; ++s)
    {
      backward(s) = addLog(next(s) + FILLER_STAY, left);
    }
    backward_before = addLog(backward_before + background(t, 0) + BACKGROUND_STAY, entered + FILLER_BEGIN);
    backward_after = ended + STAY;
  }
}

float backgroundScore(const RowMatrix& background)
{
  return background.sum() + BACKGROUND_STAY * static_cast<float>(background.rows() - 1);
}

}  // namespace pi_speech
