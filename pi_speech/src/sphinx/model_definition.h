#pragma once

#include <string>

namespace pi_speech
{

/// Whether the file mdef of an acoustic model is whole: PocketSphinx takes a binary one as it is, and reads outside of
/// its memory where the file is too short or an index in it wrong. Other forms (text, the other byte order) are left to
/// PocketSphinx.
/// @return what is wrong; empty if nothing is.
std::string problemOfModelDefinition(const std::string& path);

}  // namespace pi_speech
