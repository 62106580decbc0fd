"""The description of the vehicle: what is refused, where the sensors are, and the URDF made from it."""

import math
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as tree
from pathlib import Path

import numpy
import yaml

from pi_bringup import vehicle, vehicle_urdf

NODE = Path(__file__).resolve().parents[3] / "pi_node"
EXAMPLE = NODE / "config" / "vehicle.yaml"
DIFFERENTIAL = NODE / "config" / "differential.yaml"


def changed(change):
    """The example with {path: value}; null: without it."""
    about = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    for path, value in change.items():
        part = about
        *groups, name = path.split("/")
        for group in groups:
            part = part[group]
        if value is None:
            del part[name]
        else:
            part[name] = value
    return about


class Description(unittest.TestCase):
    def test_refuses_what_the_nodes_refuse_in_their_words(self):
        refusals = yaml.safe_load((NODE / "test" / "vehicle_refusals.yaml").read_text(encoding="utf-8"))
        self.assertGreater(len(refusals), 20)
        for entry in refusals:
            with self.assertRaises(vehicle.VehicleError) as raised:
                vehicle.check(changed(entry["change"]))
            self.assertIn(entry["refusal"], str(raised.exception))

    def test_takes_both_examples(self):
        self.assertEqual(1.0, vehicle.load(EXAMPLE)["footprint/front"])
        self.assertEqual("differential", vehicle.load(DIFFERENTIAL)["kind"])

    def test_names_a_file_that_is_none(self):
        for text, said in (("[", "is no YAML"), ("5", "must be a map"), ("name: a", "kind is missing")):
            with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
                file.write(text)
                file.flush()
                with self.assertRaisesRegex(vehicle.VehicleError, f"{file.name}.*{said}"):
                    vehicle.load(file.name)
        with self.assertRaisesRegex(vehicle.VehicleError, "/nowhere.yaml cannot be read"):
            vehicle.load("/nowhere.yaml")

    def test_a_camera_looks_along_x_of_its_mount(self):
        mounts = {"mounts/left_optical": [1.0, 2.0, 3.0, 0.0, 0.0, 0.0], "mounts/down_optical": [0, 0, 1, 0, math.pi / 2, 0],
                  "mounts/imu_link": [0, 0, 0, 0, 0, math.pi / 2]}
        poses = {frame: numpy.array(pose) for frame, pose in vehicle.mounts_of(mounts).items()}
        numpy.testing.assert_allclose(poses["left_optical"] @ [0.1, 0.2, 5.0, 1.0], [6.0, 1.9, 2.8, 1.0], atol=1e-12)
        numpy.testing.assert_allclose(poses["down_optical"] @ [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
        numpy.testing.assert_allclose(poses["imu_link"] @ [1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], atol=1e-12)


class Urdf(unittest.TestCase):
    def test_is_a_urdf_with_the_frames_of_the_sensors(self):
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(vehicle_urdf.make(vehicle.load(EXAMPLE)))
            file.flush()
            checked = subprocess.run(["check_urdf", file.name], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                     text=True, timeout=60, check=False)
        self.assertEqual(0, checked.returncode, checked.stdout)
        for word in ("robot name is: example", "root Link: base_link has 3", "imu_link", "left_optical", "right_optical"):
            self.assertIn(word, checked.stdout)

    def test_its_joints_are_the_mounts_however_they_are_turned(self):
        about = vehicle.load(EXAMPLE)
        for number, angles in enumerate(((0.1, -0.2, 2.0), (-3.0, 1.2, -1.0), (math.pi / 2, 0.0, 0.3), (0.4, math.pi / 2, 0.0),
                                         (0.4, -math.pi / 2, 0.7))):
            about[f"mounts/s{number}"] = [0.1, 0.2, 0.3, *angles]
            about[f"mounts/c{number}_optical"] = [-0.1, 0.2, 0.3, *angles]
        joints = tree.fromstring(vehicle_urdf.make(about)).findall("joint")
        expected = vehicle.mounts_of(about)
        self.assertEqual(len(expected), len(joints))
        for joint in joints:
            origin = joint.find("origin")
            numbers = [float(word) for word in (origin.get("xyz") + " " + origin.get("rpy")).split()]
            numpy.testing.assert_allclose(vehicle.mounts_of({"mounts/a": numbers})["a"],
                                          expected[joint.find("child").get("link")], atol=1e-9)

    def test_shows_the_outline_and_the_wheels(self):
        def visuals(about):
            return tree.fromstring(vehicle_urdf.make(about)).find("link[@name='base_link']").findall("visual")

        body, *wheels = visuals(vehicle.load(EXAMPLE))
        self.assertEqual("1.5 1.2 1.5", body.find("geometry/box").get("size"))
        self.assertEqual("0.25 0 0.85", body.find("origin").get("xyz"))
        self.assertEqual(["0 0.45 0.2", "0 -0.45 0.2", "0.75 0.45 0.2", "0.75 -0.45 0.2"],
                         [wheel.find("origin").get("xyz") for wheel in wheels])
        self.assertEqual(3, len(visuals(vehicle.load(DIFFERENTIAL))))


if __name__ == "__main__":
    unittest.main()
