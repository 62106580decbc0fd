#!/usr/bin/python3
"""Judge of odometer.test: drives around three sides of a square of 2 m."""
import threading
import unittest

import rospy
import rostest
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64

WAY = [(0.0, 0.0), (2.0, 0.0), (2.0, 0.01), (2.0, 2.0), (0.0, 2.0)]   # [m]; the third is a step too small to count


class Odometer(unittest.TestCase):
    def test_distances_add_up(self):
        rospy.init_node("judge")
        arrived = threading.Event()
        rospy.Subscriber("distance", Float64, lambda driven: arrived.set() if abs(driven.data - 6.0) < 1e-6 else None)
        listened = threading.Event()

        class Listener(rospy.SubscribeListener):
            def peer_subscribe(self, *_):
                listened.set()

        publisher = rospy.Publisher("odometry", Odometry, subscriber_listener=Listener(), queue_size=len(WAY))
        self.assertTrue(listened.wait(30.0), "the odometer does not subscribe to odometry")
        for x, y in WAY:
            odometry = Odometry()
            odometry.pose.pose.position.x, odometry.pose.pose.position.y = x, y
            publisher.publish(odometry)
        self.assertTrue(arrived.wait(30.0), "no distance of 6 m")


if __name__ == "__main__":
    rostest.rosrun("example_odometer", "odometer", Odometer)
