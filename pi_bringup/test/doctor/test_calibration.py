"""Calibrations that are right, and those that are not."""

import copy
import unittest

import yaml
from fake_root import FakeRoot
from pi_bringup.doctor.calibration import check_calibration

UNIT = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
KALIBR = {
    "cam0": {"T_cam_imu": UNIT, "intrinsics": [458.0, 457.0, 367.0, 248.0], "resolution": [752, 480]},
    "cam1": {"T_cam_imu": UNIT, "intrinsics": [457.0, 456.0, 379.0, 255.0], "resolution": [752, 480],
             "T_cn_cnm1": [[1.0, 0.0, 0.0, -0.11], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]}}
CAMERA_INFO = {
    "image_width": 640, "image_height": 480,
    "camera_matrix": {"rows": 3, "cols": 3, "data": [500, 0, 320, 0, 500, 240, 0, 0, 1]},
    "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
    "projection_matrix": {"rows": 3, "cols": 4, "data": [500, 0, 320, -60, 0, 500, 240, 0, 0, 0, 1, 0]}}
EUROC = """%%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [1, 0, 0, %s, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
resolution: [752, 480]
intrinsics: [458.6, 457.2, 367.2, 248.3]
"""


class Calibration(FakeRoot):
    def check(self, tree):
        return check_calibration(self.put("calibration.yaml", yaml.safe_dump(tree)))

    def changed(self, change):
        tree = copy.deepcopy(KALIBR)
        change(tree)
        return self.check(tree)

    def test_kalibr(self):
        self.expect("OK", self.check(KALIBR), "Kalibr, 2 camera(s), baseline 110 mm")

    def test_camera_info(self):
        self.expect("OK", self.check(CAMERA_INFO), "right camera, baseline 120 mm")
        tree = copy.deepcopy(CAMERA_INFO)
        tree["projection_matrix"]["data"][3] = 0
        self.expect("OK", self.check(tree), "left")
        tree["projection_matrix"]["data"][3] = 60
        self.expect("FAIL", self.check(tree), "baseline = -0.12")

    def test_euroc(self):
        self.put("mav0/cam0/sensor.yaml", EUROC % 0.0)
        self.expect("OK", check_calibration(self.root), "one camera")
        self.put("mav0/cam1/sensor.yaml", EUROC % 0.11)
        self.expect("OK", check_calibration(self.root), "two cameras, baseline 110 mm")
        self.expect("OK", check_calibration(self.root / "mav0"))
        self.put("mav0/cam1/sensor.yaml", EUROC % 11.0)
        self.expect("FAIL", check_calibration(self.root), "baseline = 11.0")

    def intrinsics(self, camera, *numbers):
        return self.changed(lambda tree: tree[camera].update(intrinsics=list(numbers)))

    def test_focal_length_and_centre(self):
        self.expect("FAIL", self.intrinsics("cam0", 4.58, 457.0, 367.0, 248.0), "fx = 4.58")
        self.expect("FAIL", self.intrinsics("cam0", 458.0, 900.0, 367.0, 248.0), "fx / fy")
        self.expect("FAIL", self.intrinsics("cam1", 458.0, 457.0, 3.0, 248.0), "cam1: centre")

    def test_rotation(self):
        def bend(tree):
            tree["cam1"]["T_cn_cnm1"][0][0] = 1.1

        def mirror(tree):
            tree["cam1"]["T_cn_cnm1"][0][0] = -1.0

        self.expect("FAIL", self.changed(bend), "T_cn_cnm1", "off orthonormal by 0.21")
        self.expect("FAIL", self.changed(mirror), "mirrors")

    def test_what_is_missing_or_no_number(self):
        self.expect("FAIL", self.changed(lambda t: t["cam1"].pop("T_cn_cnm1")), "T_cn_cnm1")
        self.expect("FAIL", self.changed(lambda t: t["cam0"].update(intrinsics=["a", 1, 2, 3])), "must be 4 numbers")
        self.expect("FAIL", self.changed(lambda t: t["cam0"].update(intrinsics=[float("nan"), 1, 2, 3])), "finite")
        self.expect("FAIL", self.changed(lambda t: t["cam0"].pop("resolution")), "resolution")

    def test_files_that_are_none(self):
        self.expect("WARN", check_calibration(""), "--calibration")
        self.expect("FAIL", check_calibration(self.root / "absent.yaml"), "cannot be read")
        self.expect("FAIL", check_calibration(self.put("a.yaml", "[1, 2")), "no YAML")
        self.expect("FAIL", check_calibration(self.put("b.yaml", "just text")), "no map")
        self.expect("FAIL", check_calibration(self.put("c.yaml", "a: 1")), "none of Kalibr's")
        self.expect("FAIL", check_calibration(self.root), "no cam0/sensor.yaml")


if __name__ == "__main__":
    unittest.main()
