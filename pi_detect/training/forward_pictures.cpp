// Runs a network of OpenCV's dnn module over pictures and writes its raw outputs as NumPy files, so that evaluate.py
// and export.py judge a network through the library in which it is deployed. Built by dnn_forward.py.
#include <opencv2/core.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

namespace
{
/// Writes a float32 array of NumPy format version 1.0; the outputs of all pictures are stacked along a new first axis.
class NpyWriter
{
public:
  NpyWriter(const std::string& path, size_t pictures) : file_(path, std::ios::binary), pictures_(pictures)
  {
    if (!file_)
      throw std::runtime_error("cannot write " + path);
  }

  /// @param output  one picture's output; must keep the shape of the first one.
  void append(const cv::Mat& output)
  {
    const cv::Mat data = output.isContinuous() ? output : output.clone();
    const std::vector<int> shape(data.size.p, data.size.p + data.dims);
    if (shape_.empty())
      writeHeader(shape);
    else if (shape != shape_)
      throw std::runtime_error("the shape of the output changed between pictures");
    file_.write(data.ptr<char>(), static_cast<std::streamsize>(data.total() * sizeof(float)));
  }

private:
  void writeHeader(const std::vector<int>& shape)
  {
    shape_ = shape;
    std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + std::to_string(pictures_);
    for (int size : shape)
      header += ", " + std::to_string(size);
    header += "), }";
    header += std::string(63 - (10 + header.size()) % 64, ' ') + "\n";
    const uint16_t length = static_cast<uint16_t>(header.size());
    file_.write("\x93NUMPY\x01\x00", 8);
    file_.write(reinterpret_cast<const char*>(&length), 2);
    file_ << header;
  }

  std::ofstream file_;
  size_t pictures_;
  std::vector<int> shape_;
};

std::vector<std::string> readLines(const std::string& path)
{
  std::ifstream file(path);
  if (!file)
    throw std::runtime_error("cannot read " + path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);)
    if (!line.empty())
      lines.push_back(line);
  return lines;
}

/// Medians are printed as one JSON line; the first forward of a network allocates and is left out.
void printTiming(std::vector<double> times_ms)
{
  if (times_ms.size() > 1)
    times_ms.erase(times_ms.begin());
  std::sort(times_ms.begin(), times_ms.end());
  std::cout << "{\"forwards\": " << times_ms.size() << ", \"min_ms\": " << times_ms.front()
            << ", \"median_ms\": " << times_ms[times_ms.size() / 2]
            << ", \"p95_ms\": " << times_ms[times_ms.size() * 95 / 100] << "}\n";
}

void run(const cv::CommandLineParser& arguments)
{
  cv::setNumThreads(arguments.get<int>("threads"));
  cv::dnn::Net net = cv::dnn::readNet(arguments.get<std::string>("model"));
  net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  const std::vector<std::string> outputs = net.getUnconnectedOutLayersNames();
  const std::vector<std::string> pictures = readLines(arguments.get<std::string>("pictures"));
  std::vector<NpyWriter> writers;
  for (const std::string& name : outputs)
    writers.emplace_back(arguments.get<std::string>("output") + name + ".npy", pictures.size());

  const int size = arguments.get<int>("size");
  std::vector<double> times_ms;
  for (const std::string& path : pictures)
  {
    const cv::Mat picture = cv::imread(path, cv::IMREAD_COLOR);
    if (picture.empty())
      throw std::runtime_error("cannot decode " + path);
    net.setInput(cv::dnn::blobFromImage(picture, 1.0 / 127.5, {size, size}, cv::Scalar::all(127.5), true, false));
    std::vector<cv::Mat> results;
    const auto start = std::chrono::steady_clock::now();
    net.forward(results, outputs);
    const std::chrono::duration<double, std::milli> elapsed = std::chrono::steady_clock::now() - start;
    times_ms.push_back(elapsed.count());
    for (size_t i = 0; i < results.size(); ++i)
      writers[i].append(results[i]);
  }
  if (!times_ms.empty())
    printTiming(times_ms);
}
}  // namespace

int main(int argc, char** argv)
{
  const cv::CommandLineParser arguments(argc, argv,
                                        "{help | | prints this text}"
                                        "{model | | network file}"
                                        "{pictures | | text file with one picture path a line}"
                                        "{output | | prefix of the .npy files, one per network output}"
                                        "{size | 300 | input width and height in pixels}"
                                        "{threads | 2 | threads of OpenCV}");
  if (arguments.has("help") || !arguments.has("model") || !arguments.has("pictures") || !arguments.has("output"))
  {
    arguments.printMessage();
    return 2;
  }
  try
  {
    run(arguments);
  }
  catch (const std::exception& error)
  {
    std::cerr << "forward_pictures: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
