"""drive_campus --unplug without a graph: when something is unplugged and plugged in, and what is judged of it."""

import re
import sys
import unittest
from pathlib import Path
from types import SimpleNamespace

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import unplugs  # noqa: E402
from campus_drive.observer import Records  # noqa: E402

PAGE = PACKAGE.parent / "docs" / "design" / "vehicle_simulator.md"
FAR = 50.0


def device(name):
    return next(one for one in unplugs.DEVICES if one.name == name)


class Ride:
    """An Unplugger whose commands are kept, with an observer that the test fills."""

    def __init__(self, *names):
        self.records = Records()
        self.commands = []
        self.unplugger = unplugs.Unplugger([device(name) for name in names], SimpleNamespace(records=self.records),
                                           lambda service, line: self.commands.append((service, line)))
        self.unplugger.begin(100.0)

    def tick(self, now, speed=2.0, to_goal=FAR, words_wait=False):
        return self.unplugger.tick(now, speed, to_goal, words_wait)

    def lines(self):
        return [line for _, line in self.commands]


class WhenItIsDone(unittest.TestCase):
    def test_only_a_vehicle_that_drives_undisturbed_loses_something(self):
        ride = Ride("IMU")
        ride.tick(101.0)  # too early
        ride.tick(110.0, speed=0.9)
        ride.tick(110.1, words_wait=True)
        ride.tick(110.2, to_goal=5.0)
        ride.unplugger.word_said(110.0)
        ride.tick(110.3)
        ride.records.command_states.append({"stopped": True})
        ride.tick(120.0)
        self.assertEqual([], ride.commands)
        ride.records.command_states.append({"stopped": False})
        ride.tick(120.1)
        self.assertEqual([("/vehicle_simulator/command", "imu off")], ride.commands)
        self.assertTrue(ride.unplugger.busy)

    def test_it_is_plugged_in_and_awaited(self):
        ride = Ride("IMU")
        ride.tick(102.0)
        ride.tick(106.4, speed=0.0)
        self.assertEqual(["imu off"], ride.lines())
        ride.tick(106.5, speed=0.0)
        self.assertEqual(["imu off", "imu on"], ride.lines())
        ride.records.validity += [(105.0, False, "silent"), (106.7, True, "back")]
        ride.records.arrivals["/odometry"] = 106.4  # before it was plugged in
        ride.tick(106.7, speed=0.0)
        self.assertEqual({}, ride.unplugger.unplugs[0]["back"])
        ride.records.arrivals["/odometry"] = 106.8
        ride.tick(107.0, speed=0.0)
        self.assertTrue(ride.unplugger.busy)  # it does not drive yet
        ride.tick(109.0, speed=1.0)
        self.assertFalse(ride.unplugger.busy)
        entry = ride.unplugger.unplugs[0]
        self.assertAlmostEqual(0.5, entry["back"]["localisation"])
        self.assertAlmostEqual(2.5, entry["driving_s"])

    def test_a_vehicle_that_an_obstacle_holds_is_not_awaited(self):
        ride = Ride("right camera")
        ride.tick(102.0)
        ride.tick(106.5, speed=0.0)
        ride.records.validity.append((90.0, True, ""))
        ride.records.arrivals.update({"/odometry": 107.0, "/obstacles": 107.0})
        ride.records.feedback.append((107.0, 0.2, "held up", "stopping for obstacle 7"))
        ride.tick(107.0, speed=0.0)
        self.assertTrue(ride.unplugger.busy)  # it may drive in a moment
        ride.tick(109.6, speed=0.0)
        self.assertFalse(ride.unplugger.busy)
        self.assertEqual("stopping for obstacle 7", ride.unplugger.unplugs[0]["held_by"])
        self.assertIsNone(ride.unplugger.unplugs[0]["driving_s"])

    def test_one_that_does_not_come_back_is_given_up(self):
        ride = Ride("chassis", "IMU")
        ride.tick(102.0)
        ride.tick(106.5, speed=0.0)
        ride.tick(126.4, speed=0.0)
        self.assertTrue(ride.unplugger.busy)
        ride.tick(126.6, speed=0.0)
        self.assertFalse(ride.unplugger.busy)
        self.assertEqual({}, ride.unplugger.unplugs[0]["back"])
        self.assertEqual(["IMU"], ride.unplugger.left)

    def test_what_is_still_reported_waits(self):
        ride = Ride("left camera", "chassis")
        ride.records.statuses["vio: inputs"] = (1, "waits", {"warning 1": "nothing on /left/image_raw"})
        ride.records.statuses["vehicle_simulator: world"] = (1, "is the chassis unplugged", {})  # not of the vehicle
        ride.tick(102.0)
        self.assertEqual(["unplug"], ride.lines())

    def test_the_microphone_is_proved_by_a_word(self):
        ride = Ride("microphone")
        ride.tick(102.0)
        self.assertEqual([("/microphone/command", "unplug")], ride.commands)
        ride.tick(106.5)
        said = [now for now in (106.6, 107.1, 108.0, 110.2) if ride.tick(now)]
        self.assertEqual([107.1, 110.2], said)
        ride.records.commands.append({"arrival": 110.9})
        ride.tick(111.0)
        self.assertFalse(ride.unplugger.busy)
        self.assertAlmostEqual(4.5, ride.unplugger.unplugs[0]["back"]["hearing"])

    def test_devices_are_chosen_by_name_and_ordered_by_the_seed(self):
        self.assertEqual(list(unplugs.DEVICES), unplugs.devices_of("all"))
        self.assertEqual(["IMU", "chassis"], [one.name for one in unplugs.devices_of("chassis, IMU")])
        with self.assertRaisesRegex(ValueError, "no device \"moon\"; must be all, or some of: left camera,"):
            unplugs.devices_of("IMU,moon")
        orders = {tuple(one.name for one in unplugs.sequence(unplugs.DEVICES, seed)) for seed in range(5)}
        self.assertGreater(len(orders), 1)
        self.assertEqual(unplugs.sequence(unplugs.DEVICES, 3), unplugs.sequence(unplugs.DEVICES, 3))


class Verdict(unittest.TestCase):
    def finished(self, name, speeds, texts=(), back=("localisation",), driving=2.0, reason="no report of obstacles",
                 errors=(0.1, 0.1), held=""):
        """One device that was unplugged at 100 s for 4.5 s; speeds of every 0.5 s; texts: (seconds, name, text)."""
        entry = {"device": name, "stops": device(name).stops, "time": 100.0, "speed": 2.0, "plugged": 104.5,
                 "back": {need: 0.4 for need in back}, "driving_s": driving, "held_by": held}
        states = [{"stamp": 100.0 + 0.5 * i, "speed": speed} for i, speed in enumerate(speeds)]
        records = Records()
        records.arbiter.append((100.3, "navigation", "", reason))
        records.reports += [{"arrival": 100.0 + after, "name": by, "level": 1, "text": text}
                            for after, by, text in texts]
        unplugs.finish([entry], states, records, lambda begin, end: errors[0] if end <= 100.0 else errors[1])
        return entry

    def imu(self, **changes):
        arguments = {"speeds": [2.0, 1.0, 0.0, 0.0], "texts": [(2.5, "vio: inputs", "nothing on /imu/data")], **changes}
        return unplugs.failures([self.finished("IMU", **arguments)], [])

    def test_as_defined(self):
        entry = self.finished("IMU", [2.0, 1.0, 0.0], [(2.5, "vio: inputs", "nothing on /imu/data")])
        self.assertEqual([], unplugs.failures([entry], []))
        self.assertAlmostEqual(1.0, entry["stands_s"])
        self.assertAlmostEqual(2.5, entry["reported_s"])
        self.assertAlmostEqual(0.4, entry["back_s"])
        line, = unplugs.lines([entry])
        for part in ("IMU at 2.0 m/s: stood after 1.0 s, defined: stops", "after 2.5 s by vio: inputs",
                     "localisation after 0.4 s", "driving after 2.0 s", "0.10 m off, 0.10 m before"):
            self.assertIn(part, line)

    def test_each_thing_that_is_not_as_defined_is_named(self):
        for changes, text in (({"speeds": [2.0, 1.5, 1.2]}, "the vehicle went on at 1.20 m/s and more"),
                              ({"texts": []}, "reported after never"),
                              ({"texts": [(4.5, "vio: inputs", "/imu/data")]}, "reported after 4.5 s"),
                              ({"texts": [(-0.5, "vio: inputs", "/imu/data")]}, "reported after never"),
                              ({"texts": [(1.0, "vehicle_simulator: imu", "/imu/data")]}, "reported after never"),
                              ({"back": ()}, "back after never"),
                              ({"driving": None}, "the vehicle drives after never"),
                              ({"driving": 11.0}, "the vehicle drives after 11.0 s"),
                              ({"errors": (0.1, 0.7)}, "valid and is 0.70 m off, 0.10 m before")):
            texts = self.imu(**changes)
            self.assertEqual(1, len(texts), (changes, texts))
            self.assertIn("IMU", texts[0])
            self.assertIn(text, texts[0])

    def test_held_by_an_obstacle_it_need_not_drive(self):
        self.assertEqual([], self.imu(driving=None, held="stopping for obstacle 3"))

    def test_a_report_of_level_ok_is_none(self):
        records = [{"arrival": 101.0, "name": "vio: inputs", "level": 0, "text": "/imu/data"}]
        self.assertEqual([], unplugs.reported(device("IMU"), 100.0, records))

    def test_both_cameras_must_be_named_by_whomever(self):
        speeds, back = [2.0, 0.0, 0.0], ("obstacles", "detections", "localisation")
        left, right = (1.0, "vio: inputs", "nothing on /left/image_raw"), (2.2, "obstacles: input", "/right/image_raw")
        one = self.finished("both cameras", speeds, [left], back)
        self.assertIn("both cameras unplugged: reported after never", "".join(unplugs.failures([one], [])))
        both = self.finished("both cameras", speeds, [left, right], back)
        self.assertEqual([], unplugs.failures([both], []))
        self.assertAlmostEqual(2.2, both["reported_s"])

    def test_without_microphone_it_goes_on(self):
        texts = [(2.5, "recognizer: sound", "/audio_stamped: no sound")]
        for speeds, reason, count in (([2.0, 2.0], "following the path", 0), ([2.0, 0.0], "following the path", 1),
                                      ([2.0, 0.0], "no report of obstacles for 0.5 s", 1),
                                      ([2.0, 0.0], "stopping for obstacle 7", 0)):
            entry = self.finished("microphone", speeds, texts, ("hearing",), 0.1, reason)
            self.assertEqual(count, len(unplugs.failures([entry], [])), (speeds, reason))

    def test_what_was_not_done_is_named(self):
        entry = self.finished("IMU", [2.0, 0.0])
        entry["plugged"] = None
        texts = unplugs.failures([entry], ["chassis", "microphone"])
        self.assertIn("IMU: the drive ended before", texts[0])
        self.assertIn("chassis, microphone", texts[1])
        self.assertEqual([], unplugs.failures([], []))


class Definition(unittest.TestCase):
    def test_the_table_of_the_design_page_is_what_is_judged(self):
        rows = re.findall(r"^\| (.+?) \| `(.+?)` \| (stops|goes on) \| (.+?) \| (.+?) \|$",
                          PAGE.read_text(encoding="utf-8"), re.MULTILINE)
        self.assertEqual([one.name for one in unplugs.DEVICES], [row[0] for row in rows])
        for one, (_, command, vehicle, named, needs) in zip(unplugs.DEVICES, rows):
            self.assertEqual(one.unplug, command)
            self.assertEqual(one.stops, vehicle == "stops", one.name)
            self.assertEqual(one.named_by, tuple(re.findall(r"`(.+?)`", named)), one.name)
            self.assertEqual(set(one.needs), set(needs.split(", ")), one.name)


if __name__ == "__main__":
    unittest.main()
