#pragma once

namespace pi_bringup
{

/// What the two player nodes have in common for runPlayer().
class Player
{
public:
  virtual ~Player() = default;

  /// Plays to the end, for ever when looping, or until stop(). Blocks; needs a thread that serves the callback queue.
  virtual void play() = 0;

  /// Ends play() soon. Any thread.
  virtual void stop() = 0;

  /// The node is to shut down once play() has returned.
  virtual bool exitWhenDone() const = 0;
};

/// Serves callbacks in the calling thread and plays in a second one, until ROS shuts down or the player is done. In the
/// latter case it gives the last messages half a second to leave.
/// @return exit status of the process: 0, or 1 if play() threw (the reason is logged).
int runPlayer(Player* player);

}  // namespace pi_bringup
