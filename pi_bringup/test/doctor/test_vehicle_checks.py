"""The doctor's checks of the vehicle's description against tf and camera_info."""

import unittest
from pathlib import Path

import numpy

from fake_root import FakeRoot
from pi_bringup import vehicle as description
from pi_bringup.doctor import live, vehicle

EXAMPLE = Path(__file__).resolve().parents[3] / "pi_node" / "config" / "vehicle.yaml"


def info(baseline, width=640, height=480):
    return width, height, [320.0, 0.0, 319.5, -320.0 * baseline, 0.0, 320.0, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0]


class VehicleChecks(FakeRoot):
    def setUp(self):
        super().setUp()
        self.about = description.load(EXAMPLE)
        self.poses = {frame: numpy.array(pose) for frame, pose in description.mounts_of(self.about).items()}

    def test_file(self):
        self.expect("OK", vehicle.check_file(EXAMPLE), "example, ackermann, 1.5 m x 1.2 m, up to 3 m/s, 3 mounts")
        self.expect("FAIL", vehicle.check_file("/nowhere.yaml"), "/nowhere.yaml cannot be read")

    def test_mounts(self):
        self.expect("OK", vehicle.judge_mounts(self.about, self.poses), "imu_link, left_optical, right_optical as in tf")
        self.poses["left_optical"][0, 3] += 0.02
        self.expect("FAIL", vehicle.judge_mounts(self.about, self.poses), "left_optical is 20 mm and 0.000 rad")
        self.poses["left_optical"] = self.poses["imu_link"]
        self.expect("FAIL", vehicle.judge_mounts(self.about, self.poses), "left_optical is 60 mm and 2.094 rad")
        del self.poses["imu_link"]
        self.expect("FAIL", vehicle.judge_mounts(self.about, self.poses), "imu_link is not in tf")

    def test_cameras(self):
        def judge(left, right):
            return vehicle.judge_camera_info(self.about, {"left": left, "right": right})

        self.expect("OK", judge(info(0.0), info(0.121)), "640x480, baseline 121.0 mm in camera_info, 120.0 mm in the")
        self.expect("FAIL", judge(info(0.0), info(0.11)), "baseline 110.0 mm", "calibrate again")
        self.expect("FAIL", judge(info(0.0, 752), info(0.12, 752)), "left are 752x480", "says 640x480")
        self.expect("WARN", vehicle.judge_camera_info(self.about, {"left": info(0.0)}), "no camera_info of right")
        del self.about["mounts/right_optical"]
        self.expect("WARN", judge(info(0.0), info(0.12)), "no mounts of left_optical and right_optical")

    def test_poses_of_a_chain_of_frames(self):
        step = numpy.eye(4)
        step[0, 3] = 0.5
        edges = {"base_link": {"odom"}, "mast": {"base_link"}, "left_optical": {"mast"}, "a": {"b"}, "b": {"a"}}
        poses = live.poses_in("base_link", edges, {child: step for child in edges})
        self.assertEqual({"mast", "left_optical"}, set(poses))
        self.assertEqual(1.0, poses["left_optical"][0, 3])


if __name__ == "__main__":
    unittest.main()
