#!/usr/bin/python3
"""Judge of simulated_time.test. The values come from tiny_recording.h."""

import queue
import sys
import unittest

import rospy
import rostest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu

FIRST_NS = 1500000000000000000
SAMPLES = 110
SAMPLE_PERIOD_NS = 5000000
PICTURE_PERIOD_NS = 50000000  # added between two laps
TIMEOUT_S = 30


class SimulatedTime(unittest.TestCase):
    def test_recorded_time_runs_and_starts_again(self):
        clocks = queue.Queue()
        samples = queue.Queue()
        # Before init_node, which waits for the first tick under /use_sim_time.
        rospy.init_node("simulated_time", disable_rostime=True)
        clock_subscriber = rospy.Subscriber("/clock", Clock, clocks.put)
        sample_subscriber = rospy.Subscriber("imu/data", Imu, samples.put)

        stamps = [samples.get(timeout=TIMEOUT_S).header.stamp.to_nsec() for _ in range(SAMPLES + 10)]
        lap = [FIRST_NS + i * SAMPLE_PERIOD_NS for i in range(SAMPLES)]
        self.assertEqual(lap + lap[:10], stamps)

        ticks = [clocks.get(timeout=TIMEOUT_S).clock.to_nsec() for _ in range(50)]
        end = FIRST_NS + (SAMPLES - 1) * SAMPLE_PERIOD_NS + PICTURE_PERIOD_NS
        self.assertTrue(all(FIRST_NS <= tick < end for tick in ticks), ticks)
        self.assertTrue(all(b - a == 10000000 or b < a for a, b in zip(ticks, ticks[1:])), ticks)
        clock_subscriber.unregister()
        sample_subscriber.unregister()


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "simulated_time", SimulatedTime, sys.argv)
