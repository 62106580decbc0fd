#!/usr/bin/python3
"""Judge of picture_edges.test."""
import threading
import unittest

import rospy
import rostest
from sensor_msgs.msg import Image
from std_msgs.msg import UInt32


class PictureEdges(unittest.TestCase):
    def test_pictures_are_not_copied_and_edges_come_out(self):
        rospy.init_node("judge")
        enough = threading.Event()
        rospy.Subscriber("views", UInt32, lambda views: enough.set() if views.data >= 10 else None)
        picture = rospy.wait_for_message("edges", Image, timeout=30.0)
        self.assertEqual(("mono8", 1920, 1080), (picture.encoding, picture.width, picture.height))
        self.assertGreater(max(picture.data), 100)  # of the number that the camera draws
        self.assertTrue(enough.wait(30.0), "fewer than ten pictures came without a copy")


if __name__ == "__main__":
    rostest.rosrun("example_picture_edges", "picture_edges", PictureEdges)
