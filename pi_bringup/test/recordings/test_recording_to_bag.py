"""Bags of recording_to_bag: content, part, namespace; what it leaves behind, and what it says, when something is wrong."""

import contextlib
import io
import os
import resource
import signal
import subprocess
import sys
import tempfile
import unittest
from collections import Counter
from pathlib import Path
from unittest import mock

import cv2
import numpy
import rosbag
import tiny_recording as tiny
from pi_bringup import recording_to_bag as converter
from pi_bringup.euroc import RecordingError


def read(bag):
    with rosbag.Bag(str(bag)) as file:
        return [(topic, message, time.to_nsec()) for topic, message, time in file.read_messages()]


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="pi_bringup_test_")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.out = self.folder / "out"
        self.out.mkdir()
        self.bag = self.out / "tiny.bag"
        self.input = self.folder / "recording"

    def options(self, *arguments):
        return converter.parser(False).parse_args([*arguments, str(self.input), str(self.bag)])

    def source(self, *arguments):
        return converter.open_input(self.options(*arguments))

    def write(self, *arguments, progress=lambda seconds: None):
        options = self.options(*arguments)
        source = converter.open_input(options)
        return source, converter.write_bag(source, self.bag, options, progress)

    def run_main(self, *arguments):
        """(exit status, what it printed, errors)"""
        printed, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
            status = converter.main([*arguments, str(self.input), str(self.bag)])
        return status, printed.getvalue(), errors.getvalue()

    def assert_nothing_left(self):
        self.assertEqual([], list(self.out.iterdir()))


class Euroc(Folder):
    def setUp(self):
        super().setUp()
        tiny.write(self.input)

    def check_content(self, compression):
        self.write("--force", "--compression", compression)
        counts = Counter()
        for topic, message, time in read(self.bag):
            index = counts[topic]
            counts[topic] += 1
            if message._has_header:
                self.assertEqual((index, time), (message.header.seq, message.header.stamp.to_nsec()))
            side = topic.split("/")[1]
            if topic.endswith("image_raw"):
                self.assertEqual(tiny.picture_stamp(index), time)
                self.assertEqual(("mono8", side + "_optical"), (message.encoding, message.header.frame_id))
                self.assertEqual(bytes([tiny.grey(side == "left", index)]) * (64 * 48), message.data)
            elif topic == "/imu/data":
                self.assertEqual(tiny.sample_stamp(index), time)
                self.assertAlmostEqual(0.001 * index, message.angular_velocity.x)
            elif topic == "/ground_truth/odometry":
                self.assertAlmostEqual(0.01 * index, message.pose.pose.position.x)
            elif topic.endswith("camera_info"):
                self.assertAlmostEqual(0.0 if side == "left" else -tiny.BASELINE_M * message.P[0], message.P[3], 6)
            elif topic == "/tf_static":
                self.assertEqual(["imu_link", "left_optical", "right_optical"],
                                 [one.child_frame_id for one in message.transforms])
        self.assertEqual({"/ground_truth/odometry": tiny.SAMPLES, "/imu/data": tiny.SAMPLES,
                          "/left/camera_info": tiny.PICTURES, "/left/image_raw": tiny.PICTURES,
                          "/right/camera_info": tiny.PICTURES, "/right/image_raw": tiny.PICTURES, "/tf_static": 1,
                          "/recording_border": 2}, counts)

    def test_bag_keeps_every_message_with_its_stamp_and_content(self):
        self.check_content("none")

    def test_bag_compressed_with_lz4(self):
        self.check_content("lz4")

    def test_bag_compressed_with_bz2(self):
        self.check_content("bz2")

    def test_static_transforms_are_latched(self):
        self.write()
        with rosbag.Bag(str(self.bag)) as file:
            latched = {one.topic for one in file._get_connections() if one.header.get("latching") in ("1", b"1")}
        self.assertEqual({"/tf_static"}, latched)

    def test_lap_lasts_until_the_next_picture(self):
        self.write()
        messages = read(self.bag)
        border = [time for topic, _, time in messages if topic == "/recording_border"]
        self.assertEqual((border, True, False), ([messages[0][2], messages[-1][2]], messages[0][1].data, messages[-1][1].data))
        last = max(tiny.sample_stamp(tiny.SAMPLES - 1), tiny.picture_stamp(tiny.PICTURES - 1))
        self.assertEqual(last - tiny.FIRST_SAMPLE_NS + tiny.PICTURE_PERIOD_NS, border[1] - border[0])

    def test_order_at_equal_stamps(self):
        items = self.source().items
        self.assertEqual(2 * (tiny.SAMPLES + tiny.PICTURES), len(items))
        self.assertEqual(sorted(item[:2] for item in items), [item[:2] for item in items])
        at_picture = [stream for stamp, stream, _ in items if stamp == tiny.picture_stamp(0)]
        self.assertEqual([0, 1, 2, 3], at_picture)  # IMU, ground truth, left, right

    def test_starts_at_the_first_picture_if_asked(self):
        source = self.source("--start-at-first-image")
        self.assertEqual(tiny.picture_stamp(0), source.begin_ns)
        self.assertEqual(tiny.picture_stamp(0), source.items[0][0])

    def test_part_that_was_asked_for(self):
        items = self.source("--start", "0.1", "--duration", "0.2").items
        self.assertEqual(tiny.sample_stamp(20), items[0][0])
        self.assertEqual(tiny.sample_stamp(59), items[-1][0])  # 0.3 s is the end already

    def test_namespace_and_part(self):
        _, counts = self.write("--namespace", "/euroc", "--start-at-first-image", "--duration", "0.1")
        self.assertEqual((2, 20, 1), (counts["/euroc/left/image_raw"], counts["/euroc/imu/data"], counts["/tf_static"]))

    def test_ground_truth_as_tf_and_path(self):
        _, counts = self.write("--tf", "--map-frame", "world")
        self.assertEqual((tiny.SAMPLES, 3), (counts["/tf"], counts["/ground_truth/path"]))
        messages = read(self.bag)
        transform = [message for topic, message, _ in messages if topic == "/tf"][50].transforms[0]
        self.assertEqual(("world", "base_link", tiny.sample_stamp(50)),
                         (transform.header.frame_id, transform.child_frame_id, transform.header.stamp.to_nsec()))
        self.assertAlmostEqual(0.5, transform.transform.translation.x)
        path = [message for topic, message, _ in messages if topic == "/ground_truth/path"][-1]
        self.assertEqual("world", path.header.frame_id)
        x = [pose.pose.position.x for pose in path.poses]
        self.assertTrue(len(x) > 1 and all(b - a >= converter.PATH_SPACING_M - 1e-9 for a, b in zip(x, x[1:])), x)

    def test_sensors_are_mounted_on_the_base(self):
        mounts = {one.child_frame_id: one for one in self.source().static_transforms().transforms}
        self.assertTrue(all(one.header.frame_id == "base_link" for one in mounts.values()))
        # The right camera is on the right: the base's y points to the left.
        self.assertAlmostEqual(-0.1, mounts["right_optical"].transform.translation.y, 6)
        q = mounts["left_optical"].transform.rotation  # x right, y down, z ahead
        numpy.testing.assert_allclose(numpy.sign(q.w) * numpy.array([-0.5, 0.5, -0.5, 0.5]), (q.x, q.y, q.z, q.w),
                                      atol=1e-6)

    def test_recording_with_one_camera(self):
        os.rename(self.input / "mav0/cam1", self.folder / "cam1")
        _, counts = self.write()
        self.assertEqual((tiny.PICTURES, 0), (counts["/left/image_raw"], counts.get("/right/image_raw", 0)))

    def test_damaged_picture_is_left_out_and_counted(self):
        tiny.cut_in_half(self.input / "mav0/cam0/data" / tiny.picture_name(3))
        status, printed, errors = self.run_main()
        self.assertEqual(0, status)
        self.assertIn("%d  /left/image_raw" % (tiny.PICTURES - 1), printed)
        self.assertIn("%d  /left/camera_info" % (tiny.PICTURES - 1), printed)
        self.assertIn("%d  /right/image_raw" % tiny.PICTURES, printed)
        self.assertRegex(errors, "1 damaged pictures left out, .*%s: truncated.*again" % tiny.picture_name(3))

    def test_recording_without_a_picture_that_can_be_read(self):
        for picture in (self.input / "mav0").glob("cam?/data/*.png"):
            picture.write_text("no picture")
        status, _, errors = self.run_main()
        self.assertEqual(1, status)
        self.assertIn("none of 20 pictures can be read", errors)
        self.assert_nothing_left()

    def test_file_is_not_replaced_unless_told(self):
        self.bag.write_text("precious")
        with self.assertRaisesRegex(RecordingError, "tiny.bag exists; .*--force"):
            self.write()
        self.assertEqual("precious", self.bag.read_text())
        self.write("--force")
        self.assertTrue(read(self.bag))

    def test_nothing_is_left_when_it_is_stopped(self):
        for stop_s in (0.0, 0.3):
            def stop(seconds, at=stop_s):
                if seconds >= at:
                    raise SystemExit(130)

            with self.assertRaises(SystemExit):
                self.write(progress=stop)
            self.assert_nothing_left()

    def test_nothing_is_left_when_a_signal_ends_it(self):
        program = "import os, signal; from pi_bringup import recording_to_bag as c\n" \
                  "c.Progress.__call__ = lambda *_: os.kill(os.getpid(), signal.SIGTERM)\nraise SystemExit(c.main())"
        ended = subprocess.run([sys.executable, "-c", program, str(self.input), str(self.bag)], check=False,
                               env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, timeout=60)
        self.assertEqual(128 + signal.SIGTERM, ended.returncode)
        self.assert_nothing_left()

    def test_folder_that_does_not_exist(self):
        self.bag = self.folder / "none" / "x.bag"
        with self.assertRaisesRegex(RecordingError, "x.bag.part: cannot be created: No such file.*name a folder"):
            self.write()

    def test_nothing_is_left_when_the_disk_is_full(self):
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # what does not fit then fails as on a full disk
        for size in (4096, 60000):  # at the first write of the bag, and later
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
            try:
                with self.assertRaisesRegex(RecordingError, "tiny.bag.part: cannot be written: .*MB are free there"):
                    self.write()
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, limits)
            self.assert_nothing_left()
        signal.signal(signal.SIGXFSZ, handler)

    def test_partial_file_of_another_run_is_not_touched(self):
        partial = self.out / "tiny.bag.part"
        partial.write_text("of another run")
        with self.assertRaisesRegex(RecordingError, "remove it if not running"):
            self.write()
        self.assertEqual("of another run", partial.read_text())

    def test_options_out_of_range(self):
        for arguments, text in (
                (["--start=-1"], "--start -1.0, must be 0 or more seconds"),
                (["--start=nan"], "--start nan"),
                (["--duration=-0.1"], "--duration -0.1"),
                (["--compression=zip"], "--compression zip, must be none, lz4 or bz2"),
                (["--namespace=euroc"], "--namespace euroc"),
                (["--imu-frame=/imu"], "--imu-frame /imu, must be a frame name"),
                (["--map-frame="], "--map-frame"),
                (["--body-in-base=0 0 0 0 0 2"], "--body-in-base .* must be 7 numbers"),
                (["--body-in-base=0 0 0 0 0 0 2"], "quaternion of norm 1"),
                (["--fov=180"], r"--fov 180.0, must be in \(0, 180\)"),
                (["--frame-rate=-1"], "--frame-rate -1.0")):
            with self.subTest(arguments), self.assertRaisesRegex(RecordingError, text):
                self.write(*arguments)
        self.assert_nothing_left()

    def test_part_that_is_empty(self):
        with self.assertRaisesRegex(RecordingError, "--start 6.0 --duration 0.0 leave nothing of .*; choose a part"):
            self.write("--start", "6")

    def test_wrong_command_line(self):
        for arguments in ([], ["x"], ["x", "y.bag", "--nonsense"], ["x", "y.bag", "z"]):
            with contextlib.redirect_stderr(io.StringIO()), self.assertRaises(SystemExit) as ended:
                converter.main(arguments)
            self.assertEqual(2, ended.exception.code)

    def test_no_folder_with_that_name(self):
        self.input = self.folder / "missing"
        status, _, errors = self.run_main()
        self.assertEqual(1, status)
        self.assertIn("missing/mav0/cam0: no such folder", errors)


class Played(Folder):
    """What --play makes of its arguments; `rosbag play` and the parameter server are stood in for."""

    def setUp(self):
        super().setUp()
        tiny.write(self.input)

    def play(self, *arguments):
        """What would be executed."""
        with mock.patch.object(converter.os, "execv") as execute, \
                mock.patch.object(converter.rosgraph, "Master") as master, \
                mock.patch.dict(os.environ, {"ROS_HOME": str(self.out)}), \
                contextlib.redirect_stdout(io.StringIO()):
            converter.main(["--play", str(self.input), *arguments])
        self.parameter, self.topics = master.return_value.setParam.call_args[0]
        return execute.call_args[0][1][3:]

    def test_arguments_of_rosbag_stay_in_order(self):
        arguments = self.play("--pause", "--rate", "2.0", "--tf", "__name:=player")
        self.assertEqual(["--pause", "--rate", "2.0", "__name:=player"], arguments[:-1])
        self.assertEqual("/player/topics", self.parameter)

    def test_bag_is_made_once(self):
        first = Path(self.play()[-1])
        made = first.stat().st_mtime_ns
        self.assertEqual(str(first), self.play("--loop")[-1])
        self.assertEqual(made, first.stat().st_mtime_ns)
        self.assertNotEqual(str(first), self.play("--start-at-first-image")[-1])

    def test_changed_recording_is_converted_again(self):
        first = self.play()[-1]
        os.utime(self.input / "mav0/imu0/data.csv", (1, 1))
        self.assertNotEqual(first, self.play()[-1])

    def test_parameter_server_is_told_what_the_bag_holds(self):
        self.play()
        topics = {one["topic"]: one for one in self.topics}
        self.assertEqual(1, topics["/tf_static"]["latching"])
        self.assertEqual(("sensor_msgs/Image", 0), (topics["/left/image_raw"]["type"], topics["/left/image_raw"]["latching"]))
        self.assertIn("uint32 height", topics["/left/image_raw"]["definition"])

    def test_bag_is_played_as_it_is(self):
        self.write()
        self.input = self.bag
        self.assertEqual([str(self.bag)], self.play())


class Video(Folder):
    def setUp(self):
        super().setUp()
        self.input = self.folder / "film.avi"
        # OpenCV's own Motion JPEG writer, there in every build.
        writer = cv2.VideoWriter(str(self.input), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*"MJPG"), 8.0, (64, 48))
        for i in range(5):
            writer.write(numpy.full((48, 64, 3), 40 * i, numpy.uint8))
        writer.release()

    def error(self, name, content=None):
        self.input = self.folder / name
        if content is not None:
            self.input.write_bytes(content)
        status, _, errors = self.run_main()
        self.assertEqual(1, status)
        self.assert_nothing_left()
        return errors

    def test_is_read_in_order_to_its_end(self):
        self.write()
        images = [message for topic, message, _ in read(self.bag) if topic == "/left/image_raw"]
        self.assertEqual(5, len(images))
        for i, image in enumerate(images):
            self.assertEqual(("bgr8", 64, 48), (image.encoding, image.width, image.height))
            self.assertAlmostEqual(40 * i, image.data[1000], delta=3)  # JPEG is lossy
            self.assertEqual(converter.VIDEO_START_NS + i * 125000000, image.header.stamp.to_nsec())

    def test_camera_info_comes_with_every_picture(self):
        _, counts = self.write("--fov", "90")
        self.assertEqual(5, counts["/left/camera_info"])
        info, = [message for topic, message, _ in read(self.bag) if topic == "/left/camera_info"][:1]
        self.assertAlmostEqual(32.0, info.K[0])

    def test_frame_rate_and_part(self):
        self.write("--frame-rate", "10", "--start", "0.1", "--duration", "0.2")
        images = [(message.data[1000], time) for topic, message, time in read(self.bag) if topic == "/left/image_raw"]
        self.assertEqual([converter.VIDEO_START_NS, converter.VIDEO_START_NS + 10 ** 8], [time for _, time in images])
        self.assertAlmostEqual(40, images[0][0], delta=3)

    def test_lap_lasts_until_the_next_picture(self):
        self.write()
        times = [time for _, _, time in read(self.bag)]
        self.assertEqual(5 * 125000000, times[-1] - times[0])

    def test_missing_file(self):
        self.assertRegex(self.error("none.avi"), "none.avi: no such file; install the Debian package opencv-doc")

    def test_packed_file(self):
        (self.folder / "packed.avi.gz").write_text("x")
        self.assertIn("gunzip", self.error("packed.avi"))

    def test_truncated_video_is_converted_with_a_warning(self):
        content = self.input.read_bytes()
        self.input.write_bytes(content[:content.index(b"idx1") * 2 // 3])
        status, _, errors = self.run_main()
        self.assertEqual(0, status, errors)
        self.assertRegex(errors, r"warning: \d+ damaged pictures left out, the first: .* ends after \d frames: it is "
                                 "truncated or damaged")

    def test_file_that_is_no_video(self):
        self.assertRegex(self.error("text.avi", b"no film"), r"text.avi \(7 bytes\): OpenCV cannot open it; use a format")

    def test_empty_file(self):
        self.assertRegex(self.error("empty.avi", b""), r"empty.avi \(0 bytes\): OpenCV cannot open it")

    def test_part_without_a_frame(self):
        with self.assertRaisesRegex(RecordingError, "no frame can be read from second 7.0 on.*smaller --start"):
            self.write("--start", "7")
        self.assert_nothing_left()


if __name__ == "__main__":
    unittest.main()
