#pragma once

#include <string>

namespace pi_speech
{

/// Redirects the log of PocketSphinx for the whole process: errors are kept per thread, all else is dropped. The last
/// error before PocketSphinx ends the process goes to standard error.
void quietSphinx();

/// Forgets the errors of this thread.
void clearSphinxErrors();

/// The errors of this thread since then, without the places in PocketSphinx' source; empty if there were none.
std::string sphinxErrors();

}  // namespace pi_speech
