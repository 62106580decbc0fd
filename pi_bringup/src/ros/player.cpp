#include <pi_bringup/ros/player.h>
#include <pthread.h>
#include <ros/ros.h>
#include <sys/prctl.h>

#include <chrono>
#include <exception>
#include <future>
#include <thread>

namespace pi_bringup
{

namespace
{

/// Between the last message and the shutdown of a player that is done. No event of roscpp tells that the queues of a
/// publisher have drained, and a node that shuts down drops what is still in them.
constexpr std::chrono::milliseconds LINGER{500};

}  // namespace

int runPlayer(Player* player)
{
  bool failed = false;  // read after the thread has ended
  std::promise<void> shutting_down;
  std::thread thread(
      [player, &failed, shutdown = shutting_down.get_future()]
      {
        pthread_setname_np(pthread_self(), "playback");
        // The default slack lets the kernel delay each wake-up by 50 us, which would show up as latency.
        prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
        try
        {
          player->play();
        }
        catch (const std::exception& exception)
        {
          ROS_FATAL_STREAM_NAMED("playback", exception.what());
          failed = true;
        }
        if (failed || player->exitWhenDone())
        {
          shutdown.wait_for(failed ? std::chrono::milliseconds(0) : LINGER);
          ros::requestShutdown();
        }
      });
  ros::spin();
  shutting_down.set_value();
  player->stop();
  thread.join();
  return failed ? 1 : 0;
}

}  // namespace pi_bringup
