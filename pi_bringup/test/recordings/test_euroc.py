"""What pi_bringup.euroc reads of a recording, and how it names what is wrong."""

import os
import shutil
import tempfile
import unittest
from pathlib import Path

import numpy
import tiny_recording as tiny
from pi_bringup import euroc
from pi_bringup.recording_to_bag import rectify

ROW = "1500000000000000000,1,2,3,4,5,6\n"


class EurocFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="pi_bringup_test_")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.mav = self.folder / "mav0"
        tiny.write(self.folder)

    def expect_error(self, *parts):
        with self.assertRaises(euroc.RecordingError) as caught:
            euroc.load(self.folder)
        for part in parts:
            self.assertIn(part, str(caught.exception))

    def test_is_read_completely(self):
        recording = euroc.load(self.folder)
        self.assertEqual(tiny.PICTURES, len(recording.left.images))
        self.assertEqual(tiny.PICTURES, len(recording.right.images))
        self.assertEqual(tiny.picture_stamp(4), recording.left.images[4][0])
        self.assertEqual(self.mav / "cam1/data" / tiny.picture_name(4), recording.right.images[4][1])
        self.assertEqual((64, 48, 20.0), recording.left[:3])
        self.assertEqual(41.0, recording.left.intrinsics[1])
        self.assertEqual(-0.0002, recording.left.distortion[3])
        self.assertAlmostEqual(tiny.BASELINE_M, recording.right.T_body_sensor[1, 3], 12)
        self.assertEqual(tiny.SAMPLES, len(recording.imu.samples))
        self.assertEqual(tiny.sample_stamp(7), recording.imu.samples[7][0])
        self.assertAlmostEqual(0.007, recording.imu.samples[7][1])
        self.assertAlmostEqual(9.807, recording.imu.samples[7][4])
        self.assertEqual(0.01, recording.imu.gyroscope_noise)
        stamp, T_world_body, velocity = recording.ground_truth[7]
        self.assertEqual((tiny.SAMPLES, tiny.sample_stamp(7)), (len(recording.ground_truth), stamp))
        self.assertAlmostEqual(0.07, T_world_body[0, 3])
        self.assertIsNone(velocity)

    def test_may_lack_right_camera_imu_and_ground_truth(self):
        shutil.rmtree(self.mav / "cam1")
        shutil.rmtree(self.mav / "imu0")
        (self.folder / "groundtruth_tum.txt").unlink()
        self.assertEqual((None, None, []), euroc.load(self.folder)[2:])

    def test_ground_truth_of_the_original_format_comes_first(self):
        (self.mav / "state_groundtruth_estimate0").mkdir()
        (self.mav / "state_groundtruth_estimate0/data.csv").write_text(
            "#timestamp,p,p,p,qw,qx,qy,qz,v,v,v,bw,bw,bw,ba,ba,ba\n"
            "1500000000000000000,1,2,3,0,1,0,0,0.1,0.2,0.3,0,0,0,0,0,0\n")
        (_, T_world_body, velocity), = euroc.load(self.folder).ground_truth
        numpy.testing.assert_allclose(numpy.diag([1, -1, -1]), T_world_body[:3, :3], atol=1e-12)  # half a turn about x
        self.assertEqual([0.1, 0.2, 0.3], velocity)

    def test_sensor_yaml_may_have_the_directive_of_opencv(self):
        (self.mav / "imu0/sensor.yaml").write_text(
            "%YAML:1.0\n---\nT_BS:\n  data: [1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, "
            "1.0]\nrate_hz: 100\n")
        self.assertEqual(0.5, euroc.load(self.folder).imu.T_body_sensor[0, 3])

    def test_folder_without_a_recording(self):
        shutil.rmtree(self.mav / "cam0")
        self.expect_error("mav0/cam0: no such folder", "contains mav0")

    def test_missing_sensor_yaml(self):
        (self.mav / "cam1/sensor.yaml").unlink()
        self.expect_error("cam1/sensor.yaml: missing")

    def test_missing_csv(self):
        (self.mav / "imu0/data.csv").unlink()
        self.expect_error("imu0/data.csv: missing")

    def test_line_of_a_missing_picture(self):
        (self.mav / "cam0/data" / tiny.picture_name(2)).unlink()
        self.expect_error("cam0/data.csv:4: ", tiny.picture_name(2))

    def test_line_with_too_few_columns(self):
        (self.mav / "imu0/data.csv").write_text("#t\n" + ROW + "1500000000005000000,1,2,3\n")
        self.expect_error("imu0/data.csv:3: has 4 of 7 columns", "copy the recording again")

    def test_csv_that_is_cut_within_a_line(self):
        tiny.cut_in_half(self.mav / "imu0/data.csv")
        with open(self.mav / "imu0/data.csv", "a") as file:
            file.write("\n15000000")
        self.expect_error("imu0/data.csv:", "columns")

    def test_cell_that_is_no_number(self):
        csv = self.mav / "imu0/data.csv"
        csv.write_text("1500000000000000000,1,2,x3,4,5,6\n")
        self.expect_error('imu0/data.csv:1: column 4 is "x3"')
        csv.write_text("1500000000000000000,1,2,nan,4,5,6\n")
        self.expect_error("finite")
        csv.write_text("15000000000000000001,1,2,3,4,5,6\n")
        self.expect_error("time stamp")

    def test_stamps_that_do_not_increase(self):
        (self.mav / "imu0/data.csv").write_text(ROW + ROW)
        self.expect_error("imu0/data.csv:2: ", "does not come after")

    def test_broken_line_of_the_ground_truth(self):
        (self.folder / "groundtruth_tum.txt").write_text("1500000000.0 1 2 3 0 0 0 1\n1500000000.1 1 2 3 0 0 0 7\n")
        self.expect_error("groundtruth_tum.txt:2: quaternion")

    def test_decimal_seconds_keep_their_nanoseconds(self):
        (self.folder / "groundtruth_tum.txt").write_text("1500000000.123456789 1 2 3 0 0 0 1\n")
        self.assertEqual(1500000000123456789, euroc.load(self.folder).ground_truth[0][0])
        for stamp in ("1500000000.1x", "-1.5", "15000000000.0", "nan"):
            (self.folder / "groundtruth_tum.txt").write_text("%s 1 2 3 0 0 0 1\n" % stamp)
            self.expect_error('column 1 is "%s", expected a time stamp [s]' % stamp)

    def test_calibrations_that_cannot_be_used(self):
        imu, camera = self.mav / "imu0/sensor.yaml", self.mav / "cam0/sensor.yaml"
        imu.write_text("rate_hz: 100\n")
        self.expect_error("imu0/sensor.yaml: T_BS/data must be a list of 16 numbers")
        imu.write_text("T_BS:\n  data: [2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\n"
                       "rate_hz: 100\n")
        self.expect_error("not a rigid transform")
        imu.write_text("rate_hz: [1, \n: :\n  - {\n")
        self.expect_error("imu0/sensor.yaml: not readable as YAML")
        camera.write_text("camera_model: omni\n")
        self.expect_error('camera_model is "omni"')
        camera.write_text(tiny.camera_yaml(0.0).replace("rate_hz: 20", "rate_hz: fast"))
        self.expect_error("rate_hz must be a number")
        camera.write_text(tiny.camera_yaml(0.0).replace("rate_hz: 20", "rate_hz: 0"))
        self.expect_error("must be above 0")

    def test_empty_tables(self):
        (self.mav / "cam0/data.csv").write_text("#timestamp [ns],filename\n")
        self.expect_error("cam0/data.csv: names no picture")

    def test_imu_without_samples(self):
        (self.mav / "imu0/data.csv").write_text("")
        self.expect_error("imu0/data.csv: has no sample")


class Rotations(unittest.TestCase):
    def test_matrix_and_quaternion_belong_together(self):
        random = numpy.random.default_rng(1)
        cases = [*random.normal(size=(50, 4)), *numpy.eye(4)]  # eye: half turns about each axis, and none
        for q in cases:
            q = q / numpy.linalg.norm(q)
            T = euroc.matrix_of(q)
            numpy.testing.assert_allclose(numpy.eye(3), T[:3, :3] @ T[:3, :3].T, atol=1e-12)
            again = euroc.quaternion_of(T)
            numpy.testing.assert_allclose(q * numpy.sign(q @ again), again, atol=1e-12)


class RealRecording(unittest.TestCase):
    def test_is_read_completely(self):
        folder = Path(os.environ.get("PI_EDGE_DATA", "none")) / "slam/mh01_first10s"
        if not folder.is_dir():
            self.skipTest("PI_EDGE_DATA names no folder with slam/mh01_first10s")
        recording = euroc.load(folder)
        self.assertEqual((200, 200, 3020, 2805), (len(recording.left.images), len(recording.right.images),
                                                  len(recording.imu.samples), len(recording.ground_truth)))
        (_, P), = rectify(recording.left, recording.right)[1:]
        self.assertAlmostEqual(0.11, -P[0, 3] / P[0, 0], delta=1e-3)  # the published baseline of the sensor


if __name__ == "__main__":
    unittest.main()
