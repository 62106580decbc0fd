#pragma once

#include <string>

namespace pi_speech
{

/// Takes PocketSphinx' log over, for the whole process: nothing is printed, and the errors of each thread are kept.
/// What PocketSphinx says before it ends the process goes to standard error.
void quietSphinx();

/// Forgets the errors of this thread.
void clearSphinxErrors();

/// The errors of this thread since then, without the places in PocketSphinx' source; empty if there were none.
std::string sphinxErrors();

}  // namespace pi_speech
