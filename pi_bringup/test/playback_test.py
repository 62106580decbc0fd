#!/usr/bin/python3
"""Judge of playback.test. The values come from tiny_recording.py."""

import json
import queue
import sys
import time
import unittest

import rospy
import rostest
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import CameraInfo, Image, Imu
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

PICTURES = 10
DAMAGED = 3  # index of the left picture that is cut short
SAMPLES = 110
PICTURE_PERIOD_NS = 50000000
SAMPLE_PERIOD_NS = 5000000
FIRST_PICTURE_NS = 50000000  # after the first sample
TOPICS = {"left/image_raw": Image, "left/camera_info": CameraInfo, "right/image_raw": Image,
          "right/camera_info": CameraInfo, "imu/data": Imu, "ground_truth/odometry": Odometry,
          "ground_truth/path": Path, "/tf": TFMessage, "/tf_static": TFMessage}
TIMEOUT_S = 30


def nanoseconds(message):
    return message.header.stamp.to_nsec()


class Playback(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("playback")
        cls.received = {topic: [] for topic in TOPICS}
        cls.arrivals = queue.Queue()
        cls.states = queue.Queue()
        cls.reports = queue.Queue()
        cls.subscribers = [rospy.Subscriber("player/status", String, cls.states.put),
                           rospy.Subscriber("topic_monitor/report", String, cls.reports.put)]
        for topic, kind in TOPICS.items():
            cls.subscribers.append(rospy.Subscriber(topic, kind, cls.on_message, topic, queue_size=1000))
        cls.seen_states = []
        while "finished" not in cls.seen_states:
            cls.status = json.loads(cls.states.get(timeout=TIMEOUT_S).data)
            cls.seen_states.append(cls.status["state"])
        # Topics are independent streams: wait until what was published has arrived on each.
        expected = {topic: SAMPLES if topic.startswith(("imu", "ground_truth/odometry", "/tf")) else PICTURES
                    for topic in TOPICS if topic not in ("/tf_static", "ground_truth/path")}
        expected["left/image_raw"] = expected["left/camera_info"] = PICTURES - 1
        cls.expected = expected
        while any(len(cls.received[topic]) < count for topic, count in expected.items()) \
                or not cls.received["/tf_static"] or not cls.received["ground_truth/path"]:
            cls.arrivals.get(timeout=TIMEOUT_S)

    @classmethod
    def on_message(cls, message, topic):
        cls.received[topic].append(message)
        cls.arrivals.put(topic)

    def test_every_message_arrives_once(self):
        for topic, count in self.expected.items():
            self.assertEqual(count, len(self.received[topic]), topic)
            if topic != "/tf":
                self.assertEqual(count, self.status["published"]["/" + topic], topic)

    def test_every_message_arrives_at_a_roscpp_node(self):
        if not rospy.get_param("~monitor"):
            self.skipTest("needs topic_monitor of pi_os_transport; build the suite from its root")
        transport = rospy.get_param("~transport")
        expected = {"/" + topic: (count, 0, 0, {transport: 1}) for topic, count in self.expected.items()
                    if topic != "/tf"}
        seen = None
        deadline = time.monotonic() + TIMEOUT_S
        while seen != expected and time.monotonic() < deadline:
            report = json.loads(self.reports.get(timeout=TIMEOUT_S).data)
            seen = {name: (topic["messages"], topic["lost"], topic["out_of_order"], topic["transports"])
                    for name, topic in report["topics"].items()}
        self.assertEqual(expected, seen)

    def test_damaged_picture_is_left_out(self):
        self.assertEqual((PICTURES - 1, PICTURES), tuple(self.status["published"]["/%s/image_raw" % side]
                                                         for side in ("left", "right")))

    def test_status_tells_how_far_it_is(self):
        self.assertEqual(["waiting", "playing", "finished"], self.seen_states[-3:])
        self.assertLess(self.status["lateness_ms"]["mean"], 1000 * TIMEOUT_S)

    def test_sequence_numbers_have_no_gap(self):
        for topic in self.expected:
            if topic != "/tf":
                first = self.received[topic][0].header.seq
                self.assertEqual([first + i for i in range(self.expected[topic])],
                                 [message.header.seq for message in self.received[topic]], topic)

    def test_stamps_keep_the_recorded_intervals(self):
        start = nanoseconds(self.received["imu/data"][0])
        for topic in ("imu/data", "ground_truth/odometry"):
            self.assertEqual([start + i * SAMPLE_PERIOD_NS for i in range(SAMPLES)],
                             [nanoseconds(message) for message in self.received[topic]], topic)
        pictures = [start + FIRST_PICTURE_NS + i * PICTURE_PERIOD_NS for i in range(PICTURES)]
        for topic in ("right/image_raw", "right/camera_info"):
            self.assertEqual(pictures, [nanoseconds(message) for message in self.received[topic]], topic)
        del pictures[DAMAGED]
        for topic in ("left/image_raw", "left/camera_info"):
            self.assertEqual(pictures, [nanoseconds(message) for message in self.received[topic]], topic)

    def test_stamps_are_moved_to_now(self):
        # The recording is of 2017. A minute is more than a loaded machine takes to get here.
        self.assertLess(abs((rospy.Time.now() - self.received["imu/data"][0].header.stamp).to_sec()), 60)

    def test_pictures_are_those_of_the_recording(self):
        for side, base in (("left", 10), ("right", 110)):
            indices = [i for i in range(PICTURES) if side == "right" or i != DAMAGED]
            for index, image in zip(indices, self.received[side + "/image_raw"]):
                self.assertEqual(("mono8", 64, 48, 64, side + "_optical"),
                                 (image.encoding, image.width, image.height, image.step, image.header.frame_id))
                self.assertEqual(bytes([base + index]) * (64 * 48), image.data)

    def test_camera_info_describes_a_rectified_pair(self):
        left = self.received["left/camera_info"][0]
        right = self.received["right/camera_info"][0]
        self.assertEqual(("left_optical", "right_optical"), (left.header.frame_id, right.header.frame_id))
        self.assertEqual((40.0, 0.0, 31.5, 0.0, 41.0, 23.5, 0.0, 0.0, 1.0), left.K)
        self.assertEqual("plumb_bob", left.distortion_model)
        self.assertEqual(0.0, left.P[3])
        self.assertAlmostEqual(-0.1 * right.P[0], right.P[3], places=6)
        self.assertEqual(left.P[0], right.P[0])

    def test_imu_has_values_and_no_orientation(self):
        sample = self.received["imu/data"][7]
        self.assertEqual("imu_link", sample.header.frame_id)
        self.assertEqual(-1.0, sample.orientation_covariance[0])
        self.assertAlmostEqual(0.007, sample.angular_velocity.x)
        self.assertAlmostEqual(9.807, sample.linear_acceleration.x)

    def test_ground_truth_moves_the_base(self):
        odometry = self.received["ground_truth/odometry"][50]
        self.assertEqual(("map", "base_link"), (odometry.header.frame_id, odometry.child_frame_id))
        self.assertAlmostEqual(0.5, odometry.pose.pose.position.x)
        transform = self.received["/tf"][50].transforms[0]
        self.assertEqual(("map", "base_link"), (transform.header.frame_id, transform.child_frame_id))
        self.assertEqual(odometry.header.stamp, transform.header.stamp)
        self.assertAlmostEqual(0.5, transform.transform.translation.x)
        path = self.received["ground_truth/path"][-1]
        self.assertGreater(len(path.poses), 1)
        self.assertEqual("map", path.header.frame_id)

    def test_sensors_are_mounted_on_the_base(self):
        transforms = {transform.child_frame_id: transform for transform in self.received["/tf_static"][0].transforms}
        self.assertEqual({"imu_link", "left_optical", "right_optical"}, set(transforms))
        self.assertTrue(all(transform.header.frame_id == "base_link" for transform in transforms.values()))
        # The right camera is on the right: the base's y points to the left.
        self.assertAlmostEqual(-0.1, transforms["right_optical"].transform.translation.y, places=6)
        # Optical axes of a camera that looks ahead: x right, y down, z ahead.
        rotation = transforms["left_optical"].transform.rotation
        for actual, expected in zip((rotation.x, rotation.y, rotation.z, rotation.w), (-0.5, 0.5, -0.5, 0.5)):
            self.assertAlmostEqual(expected * (1 if rotation.w > 0 else -1), actual, places=6)


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "playback", Playback, sys.argv)
