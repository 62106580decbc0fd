// Folders and lists of sound files become files, in an order that one can rely on.

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "audio/sound_files.h"

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

using Names = std::vector<std::string>;

std::string refusal(const std::string& entry)
{
  try
  {
    listSoundFiles({entry});
  }
  catch (const std::runtime_error& error)
  {
    return error.what();
  }
  return "";
}

TEST(SoundFiles, FilesStayAsTheyAreNamed)
{
  EXPECT_EQ((Names{"/b.wav", "/no/such.flac", "/b.wav"}), listSoundFiles({"/b.wav", "/no/such.flac", "/b.wav"}));
  EXPECT_EQ(Names(), listSoundFiles({}));
}

TEST(SoundFiles, FolderGivesItsSoundFilesByName)
{
  const TemporaryFolder folder;
  folder.file("c.WAV", "x");
  folder.file("a.flac", "x");
  folder.file("b.raw", "x");
  folder.file("notes.md", "x");
  std::filesystem::create_directory(folder.path() + "/deeper");
  EXPECT_EQ((Names{folder.path() + "/a.flac", folder.path() + "/b.raw", folder.path() + "/c.WAV", "/last.wav"}),
            listSoundFiles({folder.path(), "/last.wav"}));
}

TEST(SoundFiles, ListGivesItsLines)
{
  const TemporaryFolder folder;
  const std::string list = folder.file("list.txt", "# sounds\nb.wav\r\n\n  \n/absolute/with space.wav  \nfile");
  EXPECT_EQ((Names{folder.path() + "/b.wav", "/absolute/with space.wav", folder.path() + "/file"}),
            listSoundFiles({list}));
}

TEST(SoundFiles, TableGivesItsFirstColumn)
{
  const TemporaryFolder folder;
  const std::string table = folder.file("table.tsv", "file\tword\nyes/1.flac\tyes\nno/2.flac\tno\n");
  EXPECT_EQ((Names{folder.path() + "/yes/1.flac", folder.path() + "/no/2.flac"}), listSoundFiles({table}));
}

TEST(SoundFiles, WhatCannotBeReadIsNamed)
{
  const TemporaryFolder folder;
  const std::string& path = folder.path();
  EXPECT_EQ("folder " + path + " has no sound file, such as .wav or .flac", refusal(path));
  EXPECT_EQ("list " + path + "/none.tsv cannot be read: No such file or directory", refusal(path + "/none.tsv"));
  const std::string empty = folder.file("empty.txt", "# nothing\n");
  EXPECT_EQ("list " + empty + " names no file, must have one per line", refusal(empty));
}

}  // namespace
}  // namespace pi_speech
