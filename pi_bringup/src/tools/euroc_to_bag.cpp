// euroc_to_bag FOLDER BAG: writes an EuRoC recording to a rosbag. Needs no ROS master.

#include <pi_bringup/ros/euroc_bag_writer.h>
#include <unistd.h>

#include <boost/program_options.hpp>
#include <csignal>
#include <exception>
#include <iostream>
#include <string>

namespace
{

namespace po = boost::program_options;

volatile std::sig_atomic_t received_signal = 0;

void onSignal(int signal)
{
  received_signal = signal;
}

/// Percentage on one line of a terminal, or a line every tenth elsewhere.
class Progress
{
public:
  void show(size_t done, size_t total)
  {
    const int percent = total == 0 ? 100 : static_cast<int>(100 * done / total);
    const int step = on_terminal_ ? 1 : 10;
    if (percent / step == shown_ / step && shown_ >= 0)
    {
      return;
    }
    shown_ = percent;
    const std::string text =
        std::to_string(percent) + " %  " + std::to_string(done) + " of " + std::to_string(total) + " messages";
    std::cerr << (on_terminal_ ? "\r" : "") << text << (on_terminal_ ? "" : "\n") << std::flush;
  }
  void end()
  {
    if (on_terminal_ && shown_ >= 0)
    {
      std::cerr << "\n";
    }
  }

private:
  const bool on_terminal_ = isatty(STDERR_FILENO) == 1;
  int shown_ = -1;
};

}  // namespace

int main(int argc, char** argv)
{
  std::string folder;
  std::string bag;
  std::string prefix;
  pi_bringup::BagWriterOptions options;
  po::options_description visible(
      "Usage: euroc_to_bag [options] FOLDER BAG\n"
      "Writes the EuRoC recording FOLDER (the one that contains mav0) to the rosbag BAG.\n\nOptions");
  visible.add_options()("help,h", "show this text")("force,f", po::bool_switch(&options.overwrite),
                                                    "replace BAG if it exists")(
      "namespace,n", po::value(&prefix)->default_value("/"), "namespace of the topics")(
      "compression,c", po::value(&options.compression)->default_value("none"), "none, lz4 or bz2")(
      "start,s", po::value(&options.timeline.start_s)->default_value(0.0), "seconds of the recording to leave out")(
      "duration,d", po::value(&options.timeline.duration_s)->default_value(0.0), "seconds to write, 0: all");
  po::options_description all;
  all.add(visible).add_options()("folder", po::value(&folder))("bag", po::value(&bag));
  po::positional_options_description positional;
  positional.add("folder", 1).add("bag", 1);
  Progress progress;
  try
  {
    po::variables_map values;
    po::store(po::command_line_parser(argc, argv).options(all).positional(positional).run(), values);
    po::notify(values);
    if (values.count("help") > 0)
    {
      std::cout << visible;
      return 0;
    }
    if (folder.empty() || bag.empty())
    {
      std::cerr << visible;
      return 2;
    }
    options.topic_prefix = prefix.empty() || prefix.back() != '/' ? prefix + "/" : prefix;

    // No SA_RESTART is needed and the default action would leave the partial file.
    struct sigaction action = {};
    action.sa_handler = onSignal;
    sigaction(SIGINT, &action, nullptr);
    sigaction(SIGTERM, &action, nullptr);
    sigaction(SIGHUP, &action, nullptr);

    const pi_bringup::EurocDataset dataset = pi_bringup::EurocDataset::load(folder);
    const pi_bringup::BagWriterResult result = pi_bringup::writeBag(dataset, bag, options,
                                                                    [&](size_t done, size_t total)
                                                                    {
                                                                      progress.show(done, total);
                                                                      return received_signal == 0;
                                                                    });
    progress.end();
    if (!result.complete)
    {
      std::cerr << "stopped; the partial file was removed\n";
      return 128 + received_signal;
    }
    for (const auto& [topic, count] : result.written)
    {
      std::cout << count << "  " << topic << "\n";
    }
    if (result.skipped_pictures > 0)
    {
      std::cerr << "warning: " << result.skipped_pictures
                << " damaged pictures skipped, the first: " << result.first_skip_reason << "\n";
    }
    std::cout << bag << "\n";
    return 0;
  }
  catch (const po::error& error)
  {
    std::cerr << "euroc_to_bag: " << error.what() << "\n" << visible;
    return 2;
  }
  catch (const std::exception& exception)
  {
    progress.end();
    std::cerr << "euroc_to_bag: " << exception.what() << "\n";
    return 1;
  }
}
