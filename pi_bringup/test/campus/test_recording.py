"""The recording of the sensors has the times at which they send, whatever the computer did that wrote it."""

import sys
import tempfile
import unittest
from pathlib import Path

import genpy
import rosbag
from sensor_msgs.msg import Imu
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from campus_drive import recording  # noqa: E402  (found through the line above)
from first_drive.errors import DemoError  # noqa: E402  (likewise)


class Ended:
    """A recorder that was stopped in time."""

    def poll(self):
        return None

    def stop(self, _):
        pass


class Recording(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "sensors.bag"
        self.recording = recording.SensorRecording(self.path, 1.0)

    def end(self):
        self.recording._recorder = Ended()
        self.recording.end(Ended())

    def test_messages_have_the_times_of_their_stamps_and_stay_latched(self):
        header = {"topic": "/tf_static", "type": TFMessage._type, "md5sum": TFMessage._md5sum,
                  "message_definition": TFMessage._full_text, "latching": "1"}
        with rosbag.Bag(str(self.path), "w") as bag:
            bag.write("/tf_static", TFMessage(), genpy.Time(11, 0), connection_header=header)
            for number in range(4):
                message = Imu()
                message.header.stamp = genpy.Time(10, number * 5000000)
                bag.write("/imu/data", message, genpy.Time(10, 40000000))
        self.end()
        with rosbag.Bag(str(self.path)) as bag:
            came = list(bag.read_messages(return_connection_header=True))
        imu = [one.timestamp.to_nsec() - 10 ** 10 for one in came if one.topic == "/imu/data"]
        self.assertEqual([0, 5000000, 10000000, 15000000], imu)
        still, = [one for one in came if one.topic == "/tf_static"]
        self.assertEqual((b"1", 11.0), (still.connection_header["latching"], still.timestamp.to_sec()))
        self.assertEqual([True, False], [one.message.data for one in came if one.topic == recording.BORDER])
        self.assertEqual(["sensors.bag"], [path.name for path in self.path.parent.iterdir()])

    def test_a_damaged_or_an_empty_recording_is_an_error_that_names_it(self):
        for name, content in (("damaged", b"no bag"), ("empty", None)):
            with self.subTest(name):
                if content is None:
                    rosbag.Bag(str(self.path), "w").close()
                else:
                    self.path.write_bytes(content)
                with self.assertRaisesRegex(DemoError, "sensors.bag"):
                    self.end()
