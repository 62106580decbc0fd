#pragma once

#include <string>
#include <vector>

namespace pi_speech
{

/// Sound files by name, in their order. An entry is one of:
/// - a file;
/// - a folder: the sound files in it (wav, flac, ogg, aiff, au, mp3, raw), by name;
/// - a list that ends in .txt or .tsv: one file per line, in .tsv in the first column, from the folder of the list if
///   not absolute. Empty lines, those that begin with #, and a first line of .tsv whose first column is "file" do not
///   count.
/// Files are not looked at. @throws std::runtime_error naming a folder or list that cannot be read or has no file.
std::vector<std::string> listSoundFiles(const std::vector<std::string>& entries);

}  // namespace pi_speech
