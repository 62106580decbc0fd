#pragma once

#include <pi_node/ros/node_parameters.h>

#include <string>
#include <vector>

namespace pi_web
{

/// The parameters of the node; config/web_view.yaml shows each with its unit.
struct WebViewRosOptions : pi_node::NodeParameters<WebViewRosOptions>
{
  std::string address = "127.0.0.1";
  int port = 8890;
  std::string page_folder;  ///< empty: that of this package
  std::string incidents_folder = "~/.ros/pi_edge/recordings";
  std::string token_file = "~/.ros/pi_edge/web_token";
  std::string tls_folder;  ///< empty: no TLS
  bool allow_control = false;
  std::vector<std::string> publish_topics = {"goal", "initialpose"};
  std::vector<std::string> services = {"command/stop",           "command/release",
                                       "arbiter/emergency_stop", "arbiter/release_emergency_stop",
                                       "navigation/cancel",      "recorder/save"};
  std::vector<std::string> host_names;
  std::vector<std::string> web_origins = {"https://app.foxglove.dev"};
  int max_clients = 64;
  int max_message_bytes = 1000000;
  double max_messages_per_s = 200.0;
  double silent_s = 20.0;
  int queue_length = 100;  ///< of a client and channel
  double web_hz = 10.0;    ///< of the channels TOPIC/web
  std::vector<std::string> thinned_topics = {"odometry", "obstacles",      "tracks", "vehicle_state",
                                             "motion",   "wheel_odometry", "/tf"};
  int picture_width = 640;  ///< [px]
  int jpeg_quality = 70;
  double graph_period_s = 2.0;
  double answer_limit_s = 2.0;
  double call_limit_s = 10.0;
  double diagnostic_period = 1.0;  ///< [s]; the name is that of diagnostic_updater
  double warning_period_s = 5.0;   ///< between two log lines of one warning [s]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

}  // namespace pi_web

extern template struct pi_node::NodeParameters<pi_web::WebViewRosOptions>;
