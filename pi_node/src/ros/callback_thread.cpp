#include <pi_node/ros/callback_thread.h>
#include <pthread.h>

#include <boost/make_shared.hpp>
#include <utility>

namespace pi_node
{
namespace
{

class PostedFunction : public ros::CallbackInterface
{
public:
  explicit PostedFunction(std::function<void()> function) : function_(std::move(function)) {}

  CallResult call() override
  {
    function_();
    return Success;
  }

private:
  const std::function<void()> function_;
};

}  // namespace

CallbackThread::CallbackThread(const std::string& name) : name_(name.substr(0, 15)) {}

CallbackThread::~CallbackThread()
{
  stop();
}

ros::NodeHandle CallbackThread::handle(ros::NodeHandle node)
{
  node.setCallbackQueue(&queue_);
  return node;
}

void CallbackThread::post(std::function<void()> function)
{
  queue_.addCallback(boost::make_shared<PostedFunction>(std::move(function)));
}

void CallbackThread::start()
{
  thread_ = std::thread(
      [this]
      {
        pthread_setname_np(pthread_self(), name_.c_str());
        while (!stopping_)
        {
          queue_.callAvailable(ros::WallDuration(0.1));
        }
      });
}

void CallbackThread::stop()
{
  stopping_ = true;
  queue_.disable();
  queue_.clear();
  if (thread_.joinable())
  {
    thread_.join();
  }
}

}  // namespace pi_node
