#!/usr/bin/python3
"""Judge of sensors_doctor.test: publishes what the sensors would."""

import json
import random
import subprocess
import sys
import threading
import unittest

import rospy
import rostest
from sensor_msgs.msg import CameraInfo, Image, Imu

WIDTH, HEIGHT = 64, 48
PICTURE_HZ = 30.0
IMU_HZ = 200.0
RUN = "from pi_bringup.pi_edge import main; main()"


class FakeSensors(threading.Thread):
    """Publishes until it is stopped. Stamps are those of the period, not of a busy computer."""

    def __init__(self, right_offset=0.0, info_size=(WIDTH, HEIGHT), gravity=9.81):
        super().__init__(daemon=True)
        self.stopping = threading.Event()
        self.right_offset, self.info_size, self.gravity = right_offset, info_size, gravity
        self.pictures = [rospy.Publisher(f"{side}/image_raw", Image, queue_size=10) for side in ("left", "right")]
        self.infos = [rospy.Publisher(f"{side}/camera_info", CameraInfo, queue_size=10) for side in ("left", "right")]
        self.imu = rospy.Publisher("imu/data", Imu, queue_size=100)
        self.draw = random.Random(1)

    def run(self):
        begin = rospy.Time.now().to_sec()
        samples = pairs = 0
        while not self.stopping.wait(0.005):
            now = rospy.Time.now().to_sec()
            while begin + samples / IMU_HZ <= now:
                self.publish_sample(begin + samples / IMU_HZ)
                samples += 1
            while begin + pairs / PICTURE_HZ <= now:
                self.publish_pair(begin + pairs / PICTURE_HZ)
                pairs += 1

    def publish_sample(self, stamp_s):
        imu = Imu()
        imu.header.stamp = rospy.Time.from_sec(stamp_s)
        imu.linear_acceleration.z = self.gravity + self.draw.gauss(0.0, 0.01)
        imu.angular_velocity.x = self.draw.gauss(0.0, 0.001)
        self.imu.publish(imu)

    def publish_pair(self, stamp_s):
        for picture, info, offset in zip(self.pictures, self.infos, (0.0, self.right_offset)):
            image, camera = Image(), CameraInfo()
            image.header.stamp = camera.header.stamp = rospy.Time.from_sec(stamp_s - offset)
            image.header.frame_id = "optical"
            image.width, image.height, image.encoding, image.step = WIDTH, HEIGHT, "mono8", WIDTH
            image.data = bytes(WIDTH * HEIGHT)
            camera.width, camera.height = self.info_size
            camera.K[0] = camera.K[4] = 400.0
            info.publish(camera)
            picture.publish(image)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.stopping.set()
        self.join()
        for publisher in (*self.pictures, *self.infos, self.imu):
            publisher.unregister()


class SensorsDoctor(unittest.TestCase):
    def examine(self):
        """@return {check: (level, text)}, exit status"""
        ended = subprocess.run([sys.executable, "-c", RUN, "doctor", "--sensors", "--only", "IMU", "--json"],
                               stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100, check=False)
        self.assertIn(ended.returncode, (0, 1), ended.stdout + ended.stderr)
        checks = json.loads(ended.stdout)["checks"]
        return {check["check"]: (check["level"], check["text"]) for check in checks}, ended.returncode

    def test_well_sensors(self):
        with FakeSensors():
            checks, _ = self.examine()
        # Gaps in what a busy computer's python publishes are its own.
        levels = {level for name, (level, _) in checks.items() if not name.endswith("gaps")}
        self.assertEqual({"OK"}, levels, checks)
        self.assertEqual(14, len(checks), checks)

    def test_wrong_sensors_are_named(self):
        with FakeSensors(right_offset=0.01, info_size=(1280, 720), gravity=1.0):
            checks, status = self.examine()
        self.assertEqual(1, status)
        for name, part in (("stereo time difference", "10.00 ms, at most 2"), ("IMU acceleration", "1.00 m/s²"),
                           ("left camera_info", "it is for 1280x720, the pictures are 64x48")):
            level, text = checks[name]
            self.assertEqual("FAIL", level, checks)
            self.assertIn(part, text)

    def test_no_sensors(self):
        checks, status = self.examine()
        self.assertEqual(1, status)
        self.assertEqual(("FAIL", "imu/data: is not published, expected are 150 Hz"), checks["IMU rate"])


if __name__ == "__main__":
    rospy.init_node("sensors_doctor_test")
    rostest.rosrun("pi_bringup", "sensors_doctor", SensorsDoctor)
