#!/usr/bin/python3
"""Judge of vision_msgs.test."""

import threading
import unittest

import genpy.dynamic
import rospy
import rostest
from pi_detect.msg import Detection2DArray
from sensor_msgs.msg import Image

TIMEOUT_S = 60.0
SIDE = 64

RULE = "=" * 80

# Fields of the definitions of ROS noetic; genpy computes the md5 sums of these, and reads messages by them.
HEADER = f"{RULE}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
DETECTIONS = f"""Header header
Detection2D[] detections
{HEADER}{RULE}
MSG: vision_msgs/Detection2D
Header header
ObjectHypothesisWithPose[] results
BoundingBox2D bbox
sensor_msgs/Image source_img
{RULE}
MSG: vision_msgs/ObjectHypothesisWithPose
int64 id
float64 score
geometry_msgs/PoseWithCovariance pose
{RULE}
MSG: geometry_msgs/PoseWithCovariance
Pose pose
float64[36] covariance
{RULE}
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
{RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{RULE}
MSG: vision_msgs/BoundingBox2D
geometry_msgs/Pose2D center
float64 size_x
float64 size_y
{RULE}
MSG: geometry_msgs/Pose2D
float64 x
float64 y
float64 theta
{RULE}
MSG: sensor_msgs/Image
Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
"""
INFO = f"Header header\nstring method\nstring database_location\nint32 database_version\n{HEADER}"


def upstream(name, definition):
    """A class as in the package vision_msgs, which Debian does not have."""
    return genpy.dynamic.generate_dynamic(f"vision_msgs/{name}", definition)[f"vision_msgs/{name}"]


class Collector:
    """The messages of a topic with their connection's header."""

    def __init__(self, topic, kind):
        self._came = threading.Condition()
        self._messages = []
        self.subscriber = rospy.Subscriber(topic, kind, self._on_message)

    def _on_message(self, message):
        with self._came:
            self._messages.append(message)
            self._came.notify_all()

    def wait(self, wanted=lambda message: True):
        with self._came:
            found = self._came.wait_for(lambda: [m for m in self._messages if wanted(m)], TIMEOUT_S)
            return found[0] if found else None


class VisionMessages(unittest.TestCase):
    def setUp(self):
        self.images = rospy.Publisher("image", Image, queue_size=1)
        self.stamp = rospy.Time(1000)
        self.timer = rospy.Timer(rospy.Duration(0.2), lambda _: self.show())
        self.addCleanup(self.timer.shutdown)

    def show(self):
        self.stamp += rospy.Duration(0.2)
        image = Image(height=SIDE, width=SIDE, encoding="mono8", step=SIDE)
        image.header.stamp = self.stamp
        image.header.frame_id = "camera_optical"
        image.data = bytes((x * y) % 256 for y in range(SIDE) for x in range(SIDE))
        self.images.publish(image)

    def test_type_and_sum_are_those_of_upstream(self):
        for topic, name, sum_of_noetic, definition in (
                ("detections_vision", "Detection2DArray", "402071f61477de256df9f1aa45e6e4c8", DETECTIONS),
                ("vision_info", "VisionInfo", "eee36f8dc558754ceb4ef619179d8b34", INFO)):
            message = Collector(topic, rospy.AnyMsg).wait()
            self.assertIsNotNone(message, topic)
            header = message._connection_header
            self.assertEqual((header["type"], header["md5sum"]), (f"vision_msgs/{name}", sum_of_noetic))
            self.assertEqual(upstream(name, definition)._md5sum, sum_of_noetic)
            # What a recording keeps describes the message as well.
            self.assertEqual(upstream(name, header["message_definition"])._md5sum, sum_of_noetic)
            self.assertNotIn("pi_detect", header["message_definition"].replace("vision_msgs", ""))

    def test_a_tool_for_upstream_reads_what_is_on_detections(self):
        own = Collector("detections", Detection2DArray)
        tool = Collector("detections_vision", upstream("Detection2DArray", DETECTIONS))
        vision = tool.wait(lambda message: message.detections)
        self.assertIsNotNone(vision)
        message = own.wait(lambda message: message.header.stamp == vision.header.stamp)
        self.assertIsNotNone(message)
        self.assertEqual(vision.header.frame_id, "camera_optical")
        self.assertEqual(len(vision.detections), len(message.detections))
        for a, b in zip(vision.detections, message.detections):
            self.assertEqual((a.results[0].id, a.results[0].score), (b.results[0].id, b.results[0].score))
            self.assertEqual((a.bbox.center.x, a.bbox.center.y, a.bbox.size_x, a.bbox.size_y),
                             (b.bbox.center.x, b.bbox.center.y, b.bbox.size_x, b.bbox.size_y))

    def test_names_of_classes_are_where_vision_info_says(self):
        info = Collector("vision_info", upstream("VisionInfo", INFO)).wait()
        self.assertIsNotNone(info)
        self.assertEqual((info.method, info.database_version), ("street", 1))
        self.assertEqual(rospy.get_param(info.database_location)[:3], ["person", "bicycle", "car"])


if __name__ == "__main__":
    rospy.init_node("vision_msgs_test")
    rostest.rosrun("pi_detect", "vision_msgs", VisionMessages)
