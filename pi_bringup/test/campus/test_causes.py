"""Causes of standstills, without a graph."""

import sys
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import causes  # noqa: E402
from campus_drive.observer import Records  # noqa: E402


def drive(actor=None, stands_at=10.0):
    """Along x at 2 m/s, five seconds of rest at stands_at. @param actor  (stamp, x) -> position in base_link or None."""
    states, x, t, rest = [], 0.0, 0.0, 0.0
    while x < 40.0:
        stands = x >= stands_at and rest < 5.0
        state = {"stamp": 100.0 + t, "t": t, "pose": [x, 0.0, 0.0], "speed": 0.0 if stands else 2.0}
        position = actor(t, x) if actor else None
        if position:
            state["nearest_actor"] = {"actor": "crossing", "distance": 1.0, "position": position}
        states.append(state)
        rest += 0.05 if stands else 0.0
        x += 0.0 if stands else 0.1
        t += 0.05
    return states


STANDS = {"stamp": 105.0, "seconds": 5.0}


class Causes(unittest.TestCase):
    def cause(self, states, records=None, kills=(), unplugs=()):
        return causes.add([dict(STANDS)], states, records or Records(), kills, unplugs)[0]["cause"]

    def test_none(self):
        self.assertIsNone(self.cause(drive()))

    def test_somebody_ahead(self):
        self.assertEqual("crossing", self.cause(drive(lambda t, x: [14.0 - x, 0.5] if t < 8.0 else None)))

    def test_somebody_beside_the_road(self):
        self.assertIsNone(self.cause(drive(lambda t, x: [14.0 - x, 3.5])))

    def test_somebody_far_ahead(self):
        self.assertIsNone(self.cause(drive(lambda t, x: [24.0 - x, 0.0])))

    def test_somebody_behind(self):
        self.assertIsNone(self.cause(drive(lambda t, x: [5.0 - x, 0.0] if x > 9.0 else None)))

    def test_somebody_who_is_gone_for_long(self):
        self.assertIsNone(self.cause(drive(lambda t, x: [14.0 - x, 0.0] if t < 2.0 else None)))

    def test_a_spoken_stop(self):
        records = Records()
        records.command_states = [{"arrival": 50.0, "stopped": False}, {"arrival": 104.0, "stopped": True},
                                  {"arrival": 109.0, "stopped": False}]
        self.assertEqual("a spoken stop", self.cause(drive(), records))
        records.command_states[1]["arrival"], records.command_states[2]["arrival"] = 80.0, 102.0
        self.assertIsNone(self.cause(drive(), records))
        records.command_states[2]["arrival"] = 103.5
        self.assertEqual("a spoken stop", self.cause(drive(), records))

    def test_faults(self):
        self.assertEqual("vio was killed", self.cause(drive(), kills=[{"node": "vio", "time": 103.5}]))
        self.assertIsNone(self.cause(drive(), kills=[{"node": "vio", "time": 80.0}]))
        unplugs = [{"device": "IMU", "time": 95.0, "plugged": 99.5}]
        self.assertEqual("IMU was unplugged", self.cause(drive(), unplugs=unplugs))
        unplugs.append({"device": "chassis", "time": 103.0, "plugged": 107.5})
        self.assertEqual("chassis was unplugged", self.cause(drive(), unplugs=unplugs))
        unplugs.append({"device": "left camera", "time": 106.0, "plugged": 108.5})  # it stood already
        self.assertEqual("chassis was unplugged", self.cause(drive(), unplugs=unplugs))

    def test_localisation(self):
        records = Records()
        records.validity = [(90.0, True, ""), (104.5, False, "silent"), (106.0, True, "back")]
        self.assertEqual("localisation: silent", self.cause(drive(), records))

    def test_a_fault_of_the_scenario_is_a_cause_until_it_ends(self):
        def cause(*commands):
            return causes.add([dict(STANDS)], drive(), Records(), [], [], commands)[0]["cause"]

        begin = {"stamp": 104.0, "line": "imu off", "restores": False}
        self.assertEqual("fault: imu off", cause(begin))
        self.assertEqual("fault: imu off", cause(begin, {"stamp": 106.0, "line": "imu on", "restores": True}))
        early = {"stamp": 80.0, "line": "imu off", "restores": False}
        self.assertIsNone(cause(early, {"stamp": 90.0, "line": "imu on", "restores": True}))
        self.assertIsNone(cause({"stamp": 90.0, "line": "kill vio", "restores": False}))
        self.assertIsNone(cause({"stamp": 104.0, "line": "actor box go"}))  # by hand


if __name__ == "__main__":
    unittest.main()
