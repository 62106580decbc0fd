#include "ros/web_view_ros_options.h"

#include <pi_node/option_check.h>
#include <pi_node/ros/parameter_tree.h>
#include <ros/names.h>

#include <boost/asio/ip/address.hpp>
#include <stdexcept>

namespace pi_web
{

namespace parameter_tree = pi_node::parameter_tree;

/// Every parameter by the path of its name, with its field.
template <typename Visitor>
static void visitFields(WebViewRosOptions& options, Visitor&& visit)
{
  visit("address", options.address);
  visit("port", options.port);
  visit("page_folder", options.page_folder);
  visit("incidents_folder", options.incidents_folder);
  visit("token_file", options.token_file);
  visit("tls_folder", options.tls_folder);
  visit("allow_control", options.allow_control);
  visit("publish_topics", options.publish_topics);
  visit("services", options.services);
  visit("host_names", options.host_names);
  visit("web_origins", options.web_origins);
  visit("max_clients", options.max_clients);
  visit("max_message_bytes", options.max_message_bytes);
  visit("max_messages_per_s", options.max_messages_per_s);
  visit("silent_s", options.silent_s);
  visit("queue_length", options.queue_length);
  visit("web_hz", options.web_hz);
  visit("thinned_topics", options.thinned_topics);
  visit("picture_width", options.picture_width);
  visit("jpeg_quality", options.jpeg_quality);
  visit("graph_period_s", options.graph_period_s);
  visit("answer_limit_s", options.answer_limit_s);
  visit("call_limit_s", options.call_limit_s);
  visit("diagnostic_period", options.diagnostic_period);
  visit("warning_period_s", options.warning_period_s);
}

static void requireNames(const char* field, const std::vector<std::string>& names)
{
  for (const std::string& name : names)
  {
    std::string problem = "one is empty";
    if (name.empty() || !ros::names::validate(name, problem))
    {
      throw std::invalid_argument(std::string(field) + " = \"" + name + "\", must be names: " + problem);
    }
  }
}

void WebViewRosOptions::validate() const
{
  const pi_node::OptionCheck check("");
  boost::system::error_code error;
  boost::asio::ip::make_address(address, error);
  if (error)
  {
    throw std::invalid_argument("address = \"" + address + "\", must be one of this computer, as 127.0.0.1 or 0.0.0.0");
  }
  if (token_file.empty())
  {
    throw std::invalid_argument("token_file = \"\", must be a path");
  }
  check.range("port", port, 0, 65535);
  requireNames("publish_topics", publish_topics);
  requireNames("services", services);
  requireNames("thinned_topics", thinned_topics);
  check.range("max_clients", max_clients, 1, 1000);
  check.range("max_message_bytes", max_message_bytes, 1000, 64000000);
  check.range("max_messages_per_s", max_messages_per_s, 1.0, 100000.0);
  check.range("silent_s", silent_s, 1.0, 3600.0);
  check.range("queue_length", queue_length, 1, 10000);
  check.range("web_hz", web_hz, 0.1, 100.0);
  check.range("picture_width", picture_width, 16, 8192);
  check.range("jpeg_quality", jpeg_quality, 1, 100);
  check.range("graph_period_s", graph_period_s, 0.1, 60.0);
  check.range("answer_limit_s", answer_limit_s, 0.1, 60.0);
  check.range("call_limit_s", call_limit_s, 0.1, 600.0);
  parameter_tree::requireDuration("diagnostic_period", diagnostic_period);
  parameter_tree::requireDuration("warning_period_s", warning_period_s);
}

}  // namespace pi_web

template struct pi_node::NodeParameters<pi_web::WebViewRosOptions>;
