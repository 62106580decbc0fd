// Judge of edge_server.test.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/RecognizeUtterance.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "ros/coordinator_on_graph.h"

namespace pi_offload
{
namespace
{

/// A program of this package, in a process of its own.
class Program
{
public:
  explicit Program(const std::vector<std::string>& arguments, const std::string& master = "http://localhost:1")
    : log_(folder_.path() + "/log")
  {
    std::vector<char*> words;
    std::string program = EDGE_SERVER;
    words.push_back(program.data());
    std::vector<std::string> copies = arguments;
    for (std::string& copy : copies)
    {
      words.push_back(copy.data());
    }
    words.push_back(nullptr);
    process_ = fork();
    if (process_ == 0)
    {
      const int file = open(log_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
      dup2(file, STDOUT_FILENO);
      dup2(file, STDERR_FILENO);
      setenv("ROS_MASTER_URI", master.c_str(), 1);
      execv(EDGE_SERVER, words.data());
      _exit(127);
    }
  }
  ~Program()
  {
    if (process_ > 0)
    {
      kill(process_, SIGKILL);
      waitpid(process_, nullptr, 0);
    }
  }
  void signal(int number) const { kill(process_, number); }
  /// What it ended with, -1: a signal.
  int end()
  {
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string log() const
  {
    std::ostringstream text;
    text << std::ifstream(log_).rdbuf();
    return text.str();
  }
  bool waitForLog(const std::string& part) const
  {
    return until(TIMEOUT_S, [&] { return log().find(part) != std::string::npos; });
  }

private:
  const TemporaryFolder folder_;
  const std::string log_;
  pid_t process_ = -1;
};

/// Without models, that take time to load.
constexpr char SPEECH_ONLY[] =
    "{id: tree, host: 127.0.0.1, port: 0, detection: {enabled: false}, admission: {workers: 1},"
    " health: {host: 127.0.0.1, port: 0}}";

TEST(EdgeServer, AnnouncesItselfAndWorksForVehicles)
{
  FakeDetector detector("served", "street");
  CoordinatorOnGraph coordinator("served");
  // Announcements are of the graph, not of a namespace.
  const Collector<EdgeNode> announced("/edge_nodes");
  ASSERT_TRUE(announced.waitFor([](const EdgeNode&) { return true; }));
  const EdgeNode node = *announced.last();
  EXPECT_EQ("lamp", node.id);
  EXPECT_EQ("localhost:56801", node.address);
  EXPECT_EQ("map", node.frame_id);
  EXPECT_EQ("street", node.network);
  EXPECT_EQ(12.5, node.x);
  EXPECT_TRUE(std::isinf(node.range));
  coordinator.start();
  ASSERT_TRUE(coordinator.add(node.id, node.address, node.x, node.range).success);
  ASSERT_TRUE(coordinator.listen());
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp"));
  const sensor_msgs::ImagePtr picture = coordinator.makePicture();
  coordinator.camera.publish(sensor_msgs::ImageConstPtr(picture));
  EXPECT_TRUE(coordinator.detections->waitForStamp(picture->header.stamp));
  EXPECT_EQ("remote lamp", coordinator.end(picture->header.stamp));
  ASSERT_TRUE(coordinator.waitUntilUsed("lamp", "speech"));
  pi_speech::RecognizeUtterance utterance;
  utterance.request.samples.assign(16000, 0);
  utterance.request.deadline = 20.0;
  utterance.request.commands = {"stop", "go"};
  ASSERT_TRUE(ros::service::call("/served/recognize_utterance", utterance));
  EXPECT_TRUE(utterance.response.handled);
  EXPECT_EQ("lamp", utterance.response.node);
  EXPECT_FALSE(utterance.response.accepted);  // nothing was said
}

TEST(EdgeServer, SaysHowItIs)
{
  const DiagnosticCollector diagnostics;
  EXPECT_TRUE(diagnostics.waitForStatus("edge_server: edge server", [](const DiagnosticCollector::Status& status)
                                        { return status.level == 0 && status.hardware_id == "lamp"; }))
      << diagnostics.text();
}

TEST(EdgeServer, WorksWithoutAMasterAndEndsInOrder)
{
  const TemporaryFolder folder;
  Program server({"--config", folder.file("server.yaml", SPEECH_ONLY)});
  ASSERT_TRUE(server.waitForLog("tree works at 127.0.0.1:")) << server.log();
  const std::string log = server.log();
  const size_t begin = log.find("tree works at ") + 14;
  const std::string address = log.substr(begin, log.find(',', begin) - begin);
  CoordinatorOnGraph coordinator("no_master");
  coordinator.start();
  ASSERT_TRUE(coordinator.add("tree", address).success);
  EXPECT_TRUE(coordinator.waitUntilUsed("tree", "speech")) << server.log();
  EXPECT_EQ("", coordinator.place("detection"));  // not served
  server.signal(SIGTERM);
  EXPECT_EQ(0, server.end()) << server.log();
  EXPECT_NE(std::string::npos, server.log().find("edge_server: drains")) << server.log();
}

TEST(EdgeServer, SaysInTheLogOfRosWhatIsWrong)
{
  Program server({"__name:=wrong", "_range:=far"}, ros::master::getURI());
  EXPECT_EQ(1, server.end());
  EXPECT_NE(std::string::npos, server.log().find("parameter /wrong/range = \"far\", must be a number [m], or inf"))
      << server.log();
}

TEST(EdgeServer, SaysWhatIsWrongOnce)
{
  const auto said = [](const std::vector<std::string>& arguments, int status)
  {
    Program server(arguments);
    EXPECT_EQ(status, server.end()) << server.log();
    return server.log();
  };
  const TemporaryFolder folder;
  EXPECT_EQ(
      "edge_server: error: no ROS master at http://localhost:1; start one, or give --config FILE to work without\n",
      said({}, 1));
  EXPECT_EQ("edge_server: error: /no/file.yaml: cannot be read; config/edge_server.yaml shows what it should say\n",
            said({"--config", "/no/file.yaml"}, 1));
  EXPECT_EQ("edge_server: error: unrecognised option '--confg'; --help shows how it is called\n",
            said({"--confg", "a"}, 1));
  EXPECT_EQ("edge_server: error: --announce and --check go with --config\n", said({"--check"}, 1));
  const std::string right = folder.file("right.yaml", SPEECH_ONLY);
  EXPECT_EQ("edge_server: " + right + " is right\n", said({"--config", right, "--check"}, 0));
  const std::string wrong = folder.file("wrong.yaml", "{admission: {workers: many}}");
  EXPECT_EQ("edge_server: error: " + wrong + ": parameter admission/workers = many, must be a whole number\n",
            said({"--config", wrong, "--check"}, 1));
  const std::string misspelt = folder.file("misspelt.yaml", "{heatlh: {port: 5681}}");
  EXPECT_EQ(
      "edge_server: error: " + misspelt + ": parameter heatlh/port means nothing here; see config/edge_server.yaml\n",
      said({"--config", misspelt, "--check"}, 1));
  const std::string taken = folder.file("taken.yaml", "{host: 127.0.0.1, port: 56801, detection: {enabled: false}}");
  EXPECT_NE(std::string::npos, said({"--config", taken}, 1).find("127.0.0.1:56801")) << "the port is taken";
}

}  // namespace
}  // namespace pi_offload

int main(int argc, char** argv)
{
  return pi_offload::runOnGraph(argc, argv, "edge_server_test");
}
