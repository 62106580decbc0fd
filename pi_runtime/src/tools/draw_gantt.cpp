/// Draws a trace as a picture: rosrun pi_runtime draw_gantt TRACE.json OUTPUT.png [--from s] [--to s] [--width px]

#include <boost/program_options.hpp>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>

#include "trace/gantt.h"

namespace po = boost::program_options;

namespace
{

pi_runtime::ChromeTrace readTrace(const std::string& path)
{
  std::ifstream file(path);
  if (!file)
  {
    throw std::runtime_error(path + " cannot be opened: " + std::strerror(errno));
  }
  try
  {
    return pi_runtime::readChromeTrace(file);
  }
  catch (const std::runtime_error& error)
  {
    throw std::runtime_error(path + ": " + error.what());
  }
}

}  // namespace

int main(int argc, char** argv)
{
  pi_runtime::GanttOptions options;
  po::options_description visible("Options");
  visible.add_options()("help,h", "show this text")("from", po::value(&options.from_s),
                                                    "start of the picture after the first task's start [s]")(
      "to", po::value(&options.to_s), "end of the picture [s]; without it the end of the last task")(
      "width", po::value(&options.width)->default_value(options.width), "width of the picture [px]");
  po::options_description all;
  all.add(visible).add_options()("trace", po::value<std::string>()->required())("output",
                                                                                po::value<std::string>()->required());
  try
  {
    po::variables_map values;
    const auto positions = po::positional_options_description().add("trace", 1).add("output", 1);
    po::store(po::command_line_parser(argc, argv).options(all).positional(positions).run(), values);
    if (values.count("help") > 0)
    {
      std::cout << "Usage: draw_gantt TRACE.json OUTPUT.png [options]\n" << visible;
      return 0;
    }
    po::notify(values);
    const pi_runtime::ChromeTrace trace = readTrace(values["trace"].as<std::string>());
    pi_runtime::writeGantt(values["output"].as<std::string>(), trace.records, trace.units, options);
    return 0;
  }
  catch (const std::exception& error)
  {
    std::cerr << "draw_gantt: " << error.what() << "\n";
    return 1;
  }
}
