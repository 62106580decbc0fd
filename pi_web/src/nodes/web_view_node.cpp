#include "ros/web_view_ros.h"

#include <pi_node/ros/node_main.h>

int main(int argc, char** argv)
{
  return pi_node::runNode<pi_web::WebViewRos>(argc, argv, "web_view");
}
