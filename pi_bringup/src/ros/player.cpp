#include <pi_bringup/ros/player.h>
#include <pthread.h>
#include <ros/ros.h>
#include <sys/prctl.h>

#include <atomic>
#include <exception>
#include <thread>

namespace pi_bringup
{

int runPlayer(Player* player)
{
  std::atomic<bool> failed{false};
  std::thread thread(
      [player, &failed]
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
          ros::requestShutdown();
        }
      });
  ros::spin();
  player->stop();
  thread.join();
  return failed ? 1 : 0;
}

}  // namespace pi_bringup
