"""When pictures of the left camera are taken during a drive, without a graph."""

import sys
import time
import types
import unittest
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import pictures  # noqa: E402

CLASSES = {0: "person", 1: "car"}


class Subscriber:
    def __init__(self, rospy, topic, callback):
        self._rospy, self._topic = rospy, topic
        rospy.callbacks[topic] = callback

    def unregister(self):
        self._rospy.callbacks.pop(self._topic, None)


class FakeRospy:
    AnyMsg = object

    def __init__(self):
        self.callbacks = {}

    @staticmethod
    def get_time():
        return time.time()

    def Subscriber(self, topic, _, callback):  # noqa: N802  (rospy's name)
        return Subscriber(self, topic, callback)


class Detections:
    """In place of a message: its buffer is itself."""

    def deserialize(self, buffer):
        return buffer


class Stamp(float):
    def to_sec(self):
        return float(self)


class SeenAhead(unittest.TestCase):
    def setUp(self):
        modules = {"pi_detect.msg": types.SimpleNamespace(Detection2DArray=Detections, LabelArray=object),
                   "sensor_msgs.msg": types.SimpleNamespace(Image=object)}
        for name in ("pi_detect", "sensor_msgs"):
            modules[name] = types.ModuleType(name)
        self.rospy = FakeRospy()
        with mock.patch.dict(sys.modules, modules):
            self.seen = pictures.SeenAhead(self.rospy)
        self.rospy.callbacks["/labels"](SimpleNamespace(ids=list(CLASSES), names=list(CLASSES.values())))

    @property
    def looks(self):
        return "/left/image_raw" in self.rospy.callbacks

    def picture(self, seconds):
        message = SimpleNamespace(header=SimpleNamespace(stamp=Stamp(seconds)), width=640)
        self.rospy.callbacks["/left/image_raw"](message)

    def detect(self, seconds, *boxes):
        """@param boxes  (class, score, x, height) with x of the middle."""
        found = [SimpleNamespace(results=[SimpleNamespace(id=kind, score=score)], bbox=SimpleNamespace(
            center=SimpleNamespace(x=x, y=200.0), size_x=30.0, size_y=height)) for kind, score, x, height in boxes]
        message = SimpleNamespace(header=SimpleNamespace(stamp=Stamp(seconds)), detections=found)
        self.rospy.callbacks["/detections"](SimpleNamespace(_buff=message))

    def test_a_person_on_the_road_is_looked_at(self):
        self.detect(1.0, (0, 0.6, 320.0, 80.0))
        self.assertTrue(self.looks)

    def test_people_beside_the_road_far_away_and_cars_are_not(self):
        self.detect(1.0, (0, 0.6, 600.0, 80.0), (0, 0.6, 320.0, 20.0), (1, 0.9, 320.0, 80.0))
        self.assertFalse(self.looks)

    def test_a_vehicle_that_comes_to_stand_is_looked_from_once(self):
        now = time.time()
        self.seen.speed(0.0, now)
        self.assertFalse(self.looks)  # it has not driven yet
        self.seen.speed(2.0, now)
        self.seen.speed(0.1, now)
        self.assertTrue(self.looks)
        self.seen.speed(0.1, now + pictures.LOOKS_S + 0.1)
        self.assertFalse(self.looks)

    def test_the_picture_with_most_is_kept_with_its_own_detections(self):
        self.detect(1.0, (0, 0.6, 320.0, 80.0))
        for seconds in (2.0, 3.0, 4.0):
            self.picture(seconds)
        self.detect(2.0, (1, 0.9, 100.0, 40.0))
        self.detect(3.0, (0, 0.7, 320.0, 80.0))
        self.detect(4.0, (0, 0.5, 600.0, 80.0))
        self.detect(5.0, (0, 0.9, 320.0, 80.0))  # of a picture that did not come
        self.seen.close()
        (kept,) = self.seen.kept
        self.assertEqual(3.0, kept[0])
        self.assertEqual([("person", 0.7)], [box[:2] for box in kept[2]])

    def test_no_more_than_a_few_are_taken(self):
        now = time.time()
        for index in range(3 * pictures.KEPT):
            later = now + index * (pictures.APART_S + 1.0)
            self.seen.speed(2.0, later)
            self.seen.speed(0.1, later)
        self.assertEqual(pictures.KEPT, self.seen.begun)


if __name__ == "__main__":
    unittest.main()
