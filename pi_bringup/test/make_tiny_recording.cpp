// make_tiny_recording FOLDER: writes the recording of the rostests. The fourth left picture is cut short.

#include <exception>
#include <iostream>

#include "tiny_recording.h"

int main(int argc, char** argv)
{
  if (argc != 2)
  {
    std::cerr << "usage: make_tiny_recording FOLDER\n";
    return 2;
  }
  try
  {
    const std::filesystem::path folder(argv[1]);
    std::filesystem::remove_all(folder / "mav0");
    TinyRecording::write(folder);
    const auto picture = folder / "mav0" / "cam0" / "data" / TinyRecording::pictureName(3);
    std::filesystem::resize_file(picture, std::filesystem::file_size(picture) / 2);
    return 0;
  }
  catch (const std::exception& exception)
  {
    std::cerr << exception.what() << "\n";
    return 1;
  }
}
