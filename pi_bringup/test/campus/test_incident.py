"""The list and the report of incidents, from bags as the recorder writes them."""

import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
sys.path.insert(0, str(PACKAGE / "src"))
import cv2  # noqa: E402
import genpy  # noqa: E402
import numpy  # noqa: E402
import rosbag  # noqa: E402
from campus_drive import incident  # noqa: E402
from first_drive.errors import DemoError  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from pi_bringup import incidents, pi_edge  # noqa: E402
from pi_detect.msg import Obstacle3D, ObstacleArray  # noqa: E402
from pi_vehicle.msg import ArbiterState, Incident, MotionCommand, VehicleState  # noqa: E402
from sensor_msgs.msg import CompressedImage  # noqa: E402

BEGIN = 1000.0
TRIGGER_S = 10.0
NAME = "incident_1970-01-01T00-16-50Z_emergency_braking.bag"


def speed_at(t):
    """2 m/s; brakes with 2 m/s^2 from the trigger on."""
    return max(0.0, 2.0 - 2.0 * max(0.0, t - TRIGGER_S))


def write_bag(path, pose=True):
    """15 s of a vehicle that brakes for an obstacle."""
    with rosbag.Bag(str(path), "w") as bag:
        x = 0.0
        for step in range(300):
            t = 0.05 * step
            stamp = genpy.Time.from_sec(BEGIN + t)
            x += 0.05 * speed_at(t)

            def write(topic, message, stamp=stamp):
                message.header.stamp = stamp
                bag.write(topic, message, stamp)
            write("/vehicle_state", VehicleState(speed=speed_at(t)))
            write("/motion", MotionCommand(speed=speed_at(t)))
            if pose:
                odometry = Odometry()
                odometry.pose.pose.position.x = x
                odometry.pose.pose.orientation.w = 1.0
                write("/odometry", odometry)
                obstacle = Obstacle3D()
                obstacle.position.x = 12.5 - 0.5 * t
                write("/obstacles", ObstacleArray(obstacles=[obstacle]))
            if step == 0:
                write("/arbiter/state", ArbiterState(driver="navigation", reason="an obstacle 1.5 m ahead"))
            if step == int(TRIGGER_S / 0.05):
                write("/incident", Incident(cause="emergency_braking", text="2.0 m/s^2 asked for <hard>"))
            if step % 10 == 0:
                done, jpeg = cv2.imencode(".jpg", numpy.full((48, 64), 100, numpy.uint8))
                write("/left/image_raw/compressed", CompressedImage(format="jpeg", data=jpeg.tobytes()))


class IncidentTest(unittest.TestCase):

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def report_of(self, **contents):
        write_bag(self.folder / NAME, **contents)
        return incident.write_report(self.folder / NAME, self.folder / "page.html").read_text()

    def test_the_report_tells_what_happened(self):
        text = self.report_of()
        self.assertIn("Incident: emergency_braking", text)
        self.assertIn("2.0 m/s^2 asked for &lt;hard&gt;", text)
        self.assertIn("from the first trigger until it stands</td><td>1.00 s", text)
        self.assertIn("hardest braking, by the wheels</td><td>2.0 m/s²", text)
        self.assertIn("stood", incident.page.report.standstill_line(
            {"seconds": 2.0, "pose": [1.0, 2.0, 0.0], "reason": "an obstacle"}))
        self.assertIn("met obstacle: nearest 5.0", text)
        self.assertEqual(2, text.count("data:image/png;base64,"))
        self.assertEqual(3, text.count("data:image/jpeg;base64,"))
        self.assertIn("not in the bag: the pose in the map: poses are those of odometry (no /tf)", text)

    def test_what_a_bag_does_not_hold_is_left_out_with_a_line(self):
        text = self.report_of(pose=False)
        self.assertIn("not in the bag: the pose (no /odometry)", text)
        self.assertIn("not in the bag: the obstacles (no /obstacles)", text)
        self.assertEqual(0, text.count("data:image/png;base64,"))
        self.assertIn("from the first trigger until it stands</td><td>1.00 s", text)

    def test_no_bag_is_an_error_that_names_it(self):
        path = self.folder / "incident_x.bag"
        write_bag(self.folder / NAME)
        whole = (self.folder / NAME).read_bytes()
        for damaged in (b"no bag", b"\xaf\xfe" * 1000, b"", whole[:len(whole) // 2], whole[:20]):
            path.write_bytes(damaged)
            with self.assertRaisesRegex(DemoError, "incident_x.bag is not readable as a bag"):
                incident.write_report(path, self.folder / "page.html")
            self.assertRegex(incidents.describe(path)[1], "^not readable: ")
        with self.assertRaisesRegex(DemoError, "gone.bag is not readable as a bag"):
            incident.write_report(self.folder / "gone.bag", self.folder / "page.html")

    def test_the_list_has_time_cause_duration_size_and_path(self):
        write_bag(self.folder / NAME)
        (self.folder / "incident_1970-01-02T00-00-00Z_watchdog.bag.active").write_text("x")
        (self.folder / "incident_1970-01-03T00-00-00Z_watchdog.bag").write_text("x")
        (self.folder / "slim_1970-01-01T00-00-00Z.bag").write_text("x")
        header, first, second, third = incidents.rows(self.folder)
        self.assertEqual(["time", "cause", "duration", "size", "file"], header)
        self.assertEqual(["1970-01-01T00-16-50Z", "emergency_braking", "15.0 s"], first[:3])
        self.assertEqual(str(self.folder / NAME), first[4])
        self.assertEqual("is being written, or awaits its recovery", second[1])
        self.assertRegex(third[1], "^not readable: ")

    def test_the_command_line(self):
        options = pi_edge.parse(["incidents"])
        self.assertEqual(incidents.FOLDER, options.folder)
        self.assertEqual(1, incidents.main(pi_edge.parse(["incidents", "--folder", str(self.folder / "gone")])))
        self.assertEqual(0, incidents.main(pi_edge.parse(["incidents", "--folder", str(self.folder)])))
        write_bag(self.folder / NAME)
        page = self.folder / "page.html"
        self.assertEqual(0, incidents.main(pi_edge.parse(["incidents", "report", str(self.folder / NAME), "--output",
                                                          str(page)])))
        self.assertTrue(page.is_file())


if __name__ == "__main__":
    unittest.main()
