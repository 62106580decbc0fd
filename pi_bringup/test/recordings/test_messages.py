"""What recording_to_bag makes of pictures, calibrations, samples and poses."""

import tempfile
import unittest
from pathlib import Path

import cv2
import numpy
from pi_bringup import euroc
from pi_bringup import recording_to_bag as converter


def camera(position=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), width=752):
    T = numpy.eye(4)
    T[:3, :3] = cv2.Rodrigues(numpy.array(turn))[0]
    T[:3, 3] = position
    return euroc.Camera(width, 480, 20.0, [458.0, 457.0, 367.0, 248.0], [-0.28, 0.07, 0.0002, 0.00002], T, [])


def project(R, P, p_raw):
    """Pixel of a point in the raw optical frame. P(0, 3) of the right camera belongs to points of the left one."""
    p = P[:, :3] @ (R @ p_raw)
    return p[:2] / p[2]


class Rectification(unittest.TestCase):
    def test_point_lies_in_one_row_with_the_disparity_of_its_depth(self):
        # Slightly turned against each other, as real pairs are.
        left, right = camera(turn=(0.01, -0.02, 0.03)), camera((0.11, 0.002, -0.001), (-0.01, 0.01, 0.0))
        (R_left, P_left), (R_right, P_right) = converter.rectify(left, right)
        baseline = numpy.linalg.norm(right.T_body_sensor[:3, 3] - left.T_body_sensor[:3, 3])
        self.assertAlmostEqual(-P_right[0, 0] * baseline, P_right[0, 3], 6)
        self.assertEqual(0.0, P_left[0, 3])
        random = numpy.random.default_rng(1)
        for p_body in random.uniform((-2, -2, 3), (2, 2, 20), (100, 3)):
            p_left, p_right = ((numpy.linalg.inv(one.T_body_sensor) @ [*p_body, 1.0])[:3] for one in (left, right))
            in_left, in_right = project(R_left, P_left, p_left), project(R_right, P_right, p_right)
            self.assertAlmostEqual(in_left[1], in_right[1], 6)
            depth = (R_left @ p_left)[2]
            self.assertAlmostEqual(P_left[0, 0] * baseline / depth, in_left[0] - in_right[0], 6)

    def test_pictures_of_different_sizes_are_refused(self):
        with self.assertRaisesRegex(euroc.RecordingError, "left is 752x480, right is 640x480"):
            converter.rectify(camera(), camera((0.1, 0.0, 0.0), width=640))

    def test_single_camera_keeps_its_intrinsics(self):
        (R, P), = converter.rectify(camera(), None)
        numpy.testing.assert_array_equal(numpy.eye(3), R)
        self.assertEqual((458.0, 248.0, 0.0), (P[0, 0], P[1, 2], P[0, 3]))


class Messages(unittest.TestCase):
    def test_time_keeps_its_nanoseconds(self):
        time = converter.time_of(1403636579763555584)
        self.assertEqual((1403636579, 763555584), (time.secs, time.nsecs))

    def test_colour_picture(self):
        pixels = numpy.arange(18, dtype=numpy.uint8).reshape(2, 3, 3)
        image = converter.image_message(pixels, "left_optical")
        self.assertEqual(("bgr8", 3, 2, 9, "left_optical"),
                         (image.encoding, image.width, image.height, image.step, image.header.frame_id))
        self.assertEqual(bytes(range(18)), image.data)

    def test_grey_picture(self):
        image = converter.image_message(numpy.array([[7, 8]], numpy.uint8), "")
        self.assertEqual(("mono8", 2, 1, 2, b"\x07\x08"),
                         (image.encoding, image.width, image.height, image.step, image.data))

    def test_part_of_a_larger_picture_has_no_padding(self):
        image = converter.image_message(numpy.arange(20, dtype=numpy.uint8).reshape(4, 5)[:, :2], "")
        self.assertEqual((2, bytes([0, 1, 5, 6, 10, 11, 15, 16])), (image.step, image.data))

    def test_camera_info_is_filled_row_by_row(self):
        info = converter.camera_info(64, 48, [1, 2, 3, 4], [5, 6, 7, 8], numpy.arange(1, 10).reshape(3, 3),
                                     numpy.arange(1, 13).reshape(3, 4), "")
        self.assertEqual((64, "plumb_bob", [5, 6, 7, 8, 0]), (info.width, info.distortion_model, info.D))
        self.assertEqual((3, 2, 6, 4, 12), (info.K[2], info.K[4], info.R[5], info.P[3], info.P[11]))

    def test_nominal_camera_spans_its_opening_angle(self):
        info = converter.nominal_camera_info(768, 576, 90.0, "")
        self.assertAlmostEqual(384.0, info.K[0])  # 45 degrees to each side
        self.assertEqual((info.K[0], 383.5), (info.K[4], info.K[2]))

    def test_imu_has_no_orientation(self):
        imu = euroc.Imu(100.0, 0.01, 0.0, numpy.eye(4), [])
        message = converter.imu_message(imu, (0, 1, 2, 3, 4, 5, 6), "imu_link")
        self.assertEqual((-1.0, 3, 4), (message.orientation_covariance[0], message.angular_velocity.z,
                                        message.linear_acceleration.x))
        self.assertAlmostEqual(0.01, message.angular_velocity_covariance[4])
        self.assertEqual(0.0, message.linear_acceleration_covariance[4])

    def test_twist_is_in_the_base_frame(self):
        # The MAV flies north with its camera ahead: body z along world y, body x up, body y to the east.
        T_world_body = numpy.eye(4)
        T_world_body[:3, :3] = numpy.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]).T
        T_world_body[:3, 3] = (1, 2, 3)
        T_base_body = euroc.matrix_of(converter.BODY_IN_BASE[3:])
        odometry = converter.odometry_message(T_world_body, [0.0, 2.0, 0.0], T_base_body, "map", "base_link")
        self.assertAlmostEqual(2.0, odometry.twist.twist.linear.x, 6)  # forward
        self.assertAlmostEqual(0.0, odometry.twist.twist.linear.y, 6)
        self.assertEqual(2.0, odometry.pose.pose.position.y)
        q = odometry.pose.pose.orientation
        R_world_base = euroc.matrix_of((q.x, q.y, q.z, q.w))[:3, :3]
        # x ahead, y to the left: west, z up.
        numpy.testing.assert_allclose(numpy.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]).T, R_world_base, atol=1e-6)
        self.assertEqual((0.0, -1.0), (odometry.twist.covariance[0], odometry.twist.covariance[21]))

    def test_velocity_that_was_not_recorded_is_marked(self):
        odometry = converter.odometry_message(numpy.eye(4), None, numpy.eye(4), "map", "base_link")
        self.assertEqual((-1.0, -1.0), (odometry.twist.covariance[0], odometry.twist.covariance[21]))

    def test_transform_maps_the_child_into_the_parent(self):
        T = euroc.matrix_of((0.0, 0.0, 0.5 ** 0.5, 0.5 ** 0.5), (1, 2, 3))
        message = converter.transform_message(T, "base_link", "imu_link", converter.time_of(5))
        self.assertEqual(("base_link", "imu_link", 5),
                         (message.header.frame_id, message.child_frame_id, message.header.stamp.to_nsec()))
        self.assertEqual((1, 3), (message.transform.translation.x, message.transform.translation.z))
        self.assertAlmostEqual(0.5 ** 0.5, message.transform.rotation.z)


class DecodeGrey(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="pi_bringup_test_")
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name) / "picture.png"
        # Noise: a cut in the middle then leaves out rows.
        self.picture = numpy.random.default_rng(1).integers(0, 256, (48, 64), numpy.uint8)
        cv2.imwrite(str(self.file), self.picture)

    def error(self, content=None, path=None):
        if content is not None:
            self.file.write_bytes(content)
        pixels, reason = converter.decode_grey(path or self.file, 64, 48)
        self.assertIsNone(pixels)
        return reason

    def test_gives_every_pixel(self):
        pixels, reason = converter.decode_grey(self.file, 64, 48)
        self.assertIsNone(reason)
        numpy.testing.assert_array_equal(self.picture, pixels)

    def test_file_that_is_cut_short(self):
        content = self.file.read_bytes()
        for kept in (len(content) - 1, len(content) // 2, len(content) // 4, 20, 5):
            self.assertIn("%s: truncated" % self.file, self.error(content[:kept]))

    def test_file_with_damaged_data(self):
        content = bytearray(self.file.read_bytes())
        content[len(content) // 2:len(content) // 2 + 23] = b"damaged damaged damaged"
        self.assertIn(str(self.file), self.error(bytes(content)))

    def test_no_picture(self):
        self.assertIn("not a picture", self.error(b"no picture"))

    def test_empty_file(self):
        self.assertIn("not a picture", self.error(b""))

    def test_missing_file(self):
        self.assertIn("cannot be opened", self.error(path=self.file.with_name("none.png")))

    def test_picture_of_another_size(self):
        cv2.imwrite(str(self.file), numpy.zeros((48, 65), numpy.uint8))
        self.assertIn("is 65x48, the calibration is for 64x48", self.error())


if __name__ == "__main__":
    unittest.main()
