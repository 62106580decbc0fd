#pragma once

#include "hmm/diagonal_mixtures.h"

#include <vector>

namespace pi_speech
{

/// Forward and backward passes over hidden Markov models of fixed topology, in logarithms (Rabiner 1989). Emissions are
/// ln p(x_t | state), one row per frame. Occupancies are p(state at t | utterance, model).

/// A chain of states from left to right: stay, go on, or skip one. The first state may be skipped, and the last one.
/// @param emissions  one column per state that exists.
/// @param columns    the chain's states, as columns of `emissions`; at least 3.
/// @param[out] occupancies  frames x columns.size(); may be null.
/// @return ln p(utterance | chain); -infinity if there are too few frames.
float chainScore(const RowMatrix& emissions, const std::vector<int>& columns, RowMatrix* occupancies);

/// Background, then states in any order, then background; the backgrounds may be empty.
/// @param filler      emissions of the states.
/// @param background  emissions of the background: one column.
float fillerScore(const RowMatrix& filler, const RowMatrix& background, RowMatrix* filler_occupancies,
                  RowMatrix* background_occupancies);

/// Background alone.
float backgroundScore(const RowMatrix& background);

}  // namespace pi_speech
