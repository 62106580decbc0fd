#!/usr/bin/python3
"""Judge of edge_worker.test: a white square in a black picture, until it is found. The vehicle's detector finds
nothing."""
import threading
import unittest

import numpy
import rospy
import rostest
from pi_detect.msg import Detection2DArray, LabelArray
from sensor_msgs.msg import Image


class EdgeWorker(unittest.TestCase):
    def test_what_the_worker_finds_comes_back(self):
        rospy.init_node("judge")
        found, boxes = threading.Event(), []

        def look(detections):
            if detections.detections:
                boxes[:] = [detection.bbox for detection in detections.detections]
                found.set()

        rospy.Subscriber("detections", Detection2DArray, look)
        on_board = rospy.Publisher("local/detections", Detection2DArray, queue_size=10)
        rospy.Subscriber("local/image", Image, lambda image: on_board.publish(Detection2DArray(header=image.header)))
        labels = rospy.Publisher("local/labels", LabelArray, queue_size=1, latch=True)
        labels.publish(LabelArray(model="street", ids=[1], names=["person"]))
        publisher = rospy.Publisher("left/image_raw", Image, queue_size=1)
        picture = numpy.zeros((240, 320), numpy.uint8)
        picture[80:120, 200:260] = 255
        image = Image(encoding="mono8", width=320, height=240, step=320, data=picture.tobytes())
        image.header.frame_id = "left_optical"
        for _ in range(600):
            image.header.stamp = rospy.Time.now()
            publisher.publish(image)
            if found.wait(0.1):
                break
        self.assertTrue(found.is_set(), "no detections within a minute")
        self.assertEqual(1, len(boxes))
        self.assertAlmostEqual(230.0, boxes[0].center.x, delta=4.0)   # JPEG blurs edges
        self.assertAlmostEqual(100.0, boxes[0].center.y, delta=4.0)


if __name__ == "__main__":
    rostest.rosrun("example_edge_worker", "edge_worker", EdgeWorker)
