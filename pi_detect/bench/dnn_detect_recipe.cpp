// The usual recipe of a ROS node that detects objects with OpenCV, for bench_live to compare ssd_node with. It follows
// what the sources of UbiquityRobotics/dnn_detect (0.1) do with every picture: copy as bgr8, resize, blobFromImage,
// forward, draw all objects, publish them and the picture drawn upon, watched or not. Own code, own messages.

#include <cv_bridge/cv_bridge.h>
#include <image_transport/image_transport.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/model_description.h>
#include <ros/ros.h>

#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

namespace
{

class RecipeNode
{
public:
  explicit RecipeNode(const pi_detect::ModelDescription& model)
    : model_(model)
    , net_(cv::dnn::readNet(model.weights.path, model.config.path))
    , transport_(node_)
    , objects_(node_.advertise<pi_detect::Detection2DArray>("detections", 1))
    , images_(transport_.advertise("dnn_images", 1))
    , subscriber_(transport_.subscribe("image", 1, &RecipeNode::onImage, this))
  {
  }

private:
  void onImage(const sensor_msgs::ImageConstPtr& message)
  {
    const cv_bridge::CvImagePtr picture = cv_bridge::toCvCopy(message, "bgr8");
    cv::Mat resized;
    cv::resize(picture->image, resized, cv::Size(model_.input.width, model_.input.height));
    const auto& mean = model_.input.mean;
    net_.setInput(cv::dnn::blobFromImage(resized, model_.input.scale[0], resized.size(),
                                         cv::Scalar(mean[0], mean[1], mean[2]), model_.input.rgb, false));
    const cv::Mat output = net_.forward();
    const cv::Mat rows = output.reshape(1, static_cast<int>(output.total() / 7));
    pi_detect::Detection2DArray objects;
    objects.header = message->header;
    for (int i = 0; i < rows.rows; ++i)
    {
      const float* row = rows.ptr<float>(i);
      if (row[2] < model_.score_threshold)
      {
        continue;
      }
      const cv::Point from(cvRound(row[3] * picture->image.cols), cvRound(row[4] * picture->image.rows));
      const cv::Point to(cvRound(row[5] * picture->image.cols), cvRound(row[6] * picture->image.rows));
      cv::rectangle(picture->image, from, to, cv::Scalar(0, 255, 0));
      cv::putText(picture->image, std::to_string(static_cast<int>(row[1])), from, cv::FONT_HERSHEY_SIMPLEX, 0.5,
                  cv::Scalar(0, 0, 255));
      pi_detect::Detection2D object;
      object.header = message->header;
      object.results.resize(1);
      object.results[0].id = static_cast<int>(row[1]);
      object.results[0].score = row[2];
      object.bbox.center.x = 0.5 * (from.x + to.x);
      object.bbox.center.y = 0.5 * (from.y + to.y);
      object.bbox.size_x = to.x - from.x;
      object.bbox.size_y = to.y - from.y;
      objects.detections.push_back(object);
    }
    objects_.publish(objects);
    images_.publish(picture->toImageMsg());
  }

  const pi_detect::ModelDescription model_;
  cv::dnn::Net net_;
  ros::NodeHandle node_;
  image_transport::ImageTransport transport_;
  ros::Publisher objects_;
  image_transport::Publisher images_;
  image_transport::Subscriber subscriber_;
};

}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "dnn_detect_recipe");
  try
  {
    const RecipeNode node(pi_detect::ModelDescription::load(ros::NodeHandle("~").param<std::string>("model", "")));
    ros::spin();
    return 0;
  }
  catch (const std::exception& error)
  {
    ROS_FATAL_STREAM_NAMED("dnn_detect_recipe", error.what());
    return 1;
  }
}
