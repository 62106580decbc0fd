#!/usr/bin/python3
"""Judge of simulated_time.test. The values come from tiny_recording.py."""

import queue
import sys
import time
import unittest

import rospy
import rostest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu
from std_srvs.srv import SetBool

FIRST_NS = 1500000000000000000
SAMPLES = 110
SAMPLE_PERIOD_NS = 5000000
PICTURE_PERIOD_NS = 50000000  # added between two laps
LEAD_NS = 10000000  # from the begin of the bag to the first sample
TICK_NS = 10000000
TIMEOUT_S = 30


class SimulatedTime(unittest.TestCase):
    def start_when_connected(self, subscriber):
        deadline = time.monotonic() + TIMEOUT_S
        while subscriber.get_num_connections() == 0:
            self.assertLess(time.monotonic(), deadline, "the player does not publish")
            time.sleep(0.05)
        rospy.wait_for_service("player/pause_playback", TIMEOUT_S)
        self.assertTrue(rospy.ServiceProxy("player/pause_playback", SetBool)(False).success)

    def test_recorded_time_runs_and_starts_again(self):
        clocks = queue.Queue()
        samples = queue.Queue()
        # Before init_node, which waits for the first tick under /use_sim_time.
        rospy.init_node("simulated_time", disable_rostime=True)
        clock_subscriber = rospy.Subscriber("/clock", Clock, clocks.put)
        sample_subscriber = rospy.Subscriber("imu/data", Imu, samples.put)

        self.start_when_connected(sample_subscriber)
        stamps = [samples.get(timeout=TIMEOUT_S).header.stamp.to_nsec() for _ in range(SAMPLES + 10)]
        lap = [FIRST_NS + i * SAMPLE_PERIOD_NS for i in range(SAMPLES)]
        self.assertEqual(lap + lap[:10], stamps)

        ticks = [clocks.get(timeout=TIMEOUT_S).clock.to_nsec()]
        while len(ticks) < 50 or not any(after < before for before, after in zip(ticks, ticks[1:])):  # a second lap
            ticks.append(clocks.get(timeout=TIMEOUT_S).clock.to_nsec())
            self.assertLess(len(ticks), 10000)
        begin = FIRST_NS - LEAD_NS
        end = begin + (SAMPLES - 1) * SAMPLE_PERIOD_NS + PICTURE_PERIOD_NS
        self.assertTrue(all(begin <= tick <= end + TICK_NS for tick in ticks), ticks)
        steps = [after - before for before, after in zip(ticks, ticks[1:])]
        self.assertTrue(all(step != 0 or tick == begin for step, tick in zip(steps, ticks)), ticks)  # stands while paused
        clock_subscriber.unregister()
        sample_subscriber.unregister()


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "simulated_time", SimulatedTime, sys.argv)
