"""drive_campus without a graph: the figures and the verdict of a drive, the scenario, the command line of rounds."""

import importlib.machinery
import importlib.util
import math
import sys
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import judge, kills, report, scenario  # noqa: E402
from campus_drive.observer import Records, compose  # noqa: E402
from first_drive.errors import DemoError  # noqa: E402


def load_program():
    loader = importlib.machinery.SourceFileLoader("drive_campus", str(PACKAGE / "scripts" / "drive_campus"))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("drive_campus", loader))
    loader.exec_module(module)
    return module


def way(speeds, begin=100.0, step=0.05):
    """States of a vehicle on the x axis with these speeds."""
    states, x = [], 0.0
    for index, speed in enumerate(speeds):
        states.append({"stamp": begin + index * step, "t": index * step, "pose": [x, 0.0, 0.0], "speed": speed})
        x += speed * step
    return states


class Judge(unittest.TestCase):
    def test_truth_is_between_the_states(self):
        truth = judge.Truth(way([2.0] * 41), 100.0, 102.0)
        self.assertAlmostEqual(1.03, truth.at(100.515)[0])
        self.assertIsNone(truth.at(99.9))
        self.assertIsNone(truth.at(102.1))
        self.assertAlmostEqual(4.0, truth.distance)

    def test_headings_are_compared_across_the_turn(self):
        states = way([0.0, 0.0])
        states[0]["pose"][2], states[1]["pose"][2] = math.pi - 0.01, -math.pi + 0.01
        truth = judge.Truth(states, 0.0, 1000.0)
        figures = judge.localisation([(100.025, 0.3, 0.4, -math.pi)], truth)
        self.assertAlmostEqual(0.5, figures["max_m"])
        self.assertAlmostEqual(0.0, figures["heading_max"], places=6)

    def test_poses_that_are_not_valid_do_not_count(self):
        truth = judge.Truth(way([0.0] * 41), 0.0, 1000.0)
        estimates = [(100.5, 0.1, 0.0, 0.0), (101.0, 9.0, 0.0, 0.0), (101.5, 0.2, 0.0, 0.0)]
        figures = judge.localisation(estimates, truth, [(100.9, False, "silent"), (101.2, True, "back")])
        self.assertEqual(2, figures["count"])
        self.assertAlmostEqual(0.2, figures["max_m"])

    def test_localisation_without_estimates_has_no_figures(self):
        self.assertIsNone(judge.localisation([], judge.Truth(way([1.0] * 3), 0.0, 1000.0))["rms_m"])

    def test_a_standstill_has_its_reason(self):
        states = way([0.0] * 10 + [1.0] * 20 + [0.0] * 40 + [1.0] * 20 + [0.0] * 40)
        arbiter = [(99.0, "navigation", "", "driving"), (101.4, "navigation", "command", "stop was said")]
        found = judge.standstills(states, arbiter)
        self.assertEqual(1, len(found))  # neither before it drives nor at the goal
        self.assertAlmostEqual(2.0, found[0]["seconds"])
        self.assertEqual("command: stop was said", found[0]["reason"])

    def stop(self, latched, speeds):
        records = Records()
        records.commands.append({"arrival": 101.2, "text": "stop", "accepted": True, "confidence": 0.9})
        if latched:
            records.command_states.append({"arrival": latched, "stopped": True})
            records.motions.append((latched + 0.4, latched + 0.4, 0.0, "command", ""))
        played = [{"begin": 100.5, "speech_end": 101.0}]
        return judge.stops(played, ["stop"], records, judge.Truth(way(speeds), 0.0, 1000.0))[0]

    def test_a_stop_counts_by_its_braking(self):
        found = self.stop(101.3, [2.0] * 28 + [1.9 - 0.1 * i for i in range(20)] + [0.0] * 5)
        self.assertTrue(found["honoured"])
        self.assertAlmostEqual(0.3, found["ordered_s"])
        self.assertAlmostEqual(0.7, found["standstill_command_s"])
        self.assertAlmostEqual(0.4, found["braking_s"])
        self.assertAlmostEqual(1.35, found["still_s"])

    def test_a_stop_that_is_late_or_unheard_is_not_honoured(self):
        self.assertFalse(self.stop(101.3, [2.0] * 40 + [1.5] * 20)["honoured"])
        never = self.stop(None, [2.0] * 60)
        self.assertFalse(never["honoured"])
        self.assertIsNone(never["braking_s"])

    def test_a_stop_at_standstill_is_honoured_once_latched(self):
        self.assertTrue(self.stop(101.2, [0.0] * 60)["honoured"])

    def test_a_stop_that_a_dead_recogniser_missed_is_not_judged(self):
        sound = {"begin": 100.5, "speech_end": 101.0}
        self.assertTrue(judge.deaf(sound, [{"node": "recognizer", "time": 99.0, "back_s": 1.2}]))
        self.assertTrue(judge.deaf(sound, [{"node": "command", "time": 101.2, "back_s": None}]))
        self.assertFalse(judge.deaf(sound, [{"node": "recognizer", "time": 90.0, "back_s": 1.2}]))
        self.assertFalse(judge.deaf(sound, [{"node": "power", "time": 100.4, "back_s": None}]))

    def test_who_was_met_and_how_near(self):
        states = way([1.0] * 3)
        for state, distance in zip(states, (9.0, 4.0, 5.0)):
            state["nearest_actor"] = {"id": 1, "actor": "child", "class": "person", "distance": distance}
        met = judge.obstacles_met(states)
        self.assertEqual(4.0, met["child"]["distance"])
        self.assertEqual({"child"}, set(met))

    def test_verdict_names_what_was_wrong(self):
        drive = SimpleNamespace(result={"success": True}, end="at the goal",
                                facts={"spoken": [{"text": "stop", "said": 1.0}, {"text": "go"}]},
                                faults=[{"line": "kill vio", "problem": "no node vio runs"}])
        result = {"expect": "reach", "goal_distance_m": 3.0,
                  "refused": [{"text": "camera lefft off: no such camera"}],
                  "collisions": [{"t": 4.0, "speed": 1.0, "with": {"actor": "", "class": "box"}}],
                  "stops": [{"honoured": False, "heard_s": None, "braking_s": None}],
                  "kills": [{"node": "vio", "back_s": None}]}
        texts = judge.failures(drive, result)
        self.assertEqual(7, len(texts))
        self.assertIn("3.0 m from B", texts[0])
        self.assertIn("\"kill vio\" was not done: no node vio", texts[1])
        self.assertIn("refused: camera lefft off", texts[2])
        self.assertIn("collision after 4.0 s with box", texts[3])
        self.assertIn("heard after never", texts[4])
        self.assertIn("go", texts[5])
        self.assertIn("vio did not come back", texts[6])

    @staticmethod
    def unexpected(expect, success=False, distance=0.0, end_speed=0.0, says="obstacles: the picture is dark"):
        records = SimpleNamespace(statuses={"power": (0, "dark", {}), "input": (1, says, {})})
        drive = SimpleNamespace(result={"success": success}, end="given up", facts={"reason": "dark"},
                                observer=SimpleNamespace(records=records))
        return judge.unexpected(drive, {"expect": expect, "distance_m": distance, "goal_distance_m": 0.1,
                                        "end_speed": end_speed})

    def test_a_vehicle_that_has_to_refuse_must_not_set_off(self):
        self.assertEqual([], self.unexpected("refuse", distance=0.3))
        self.assertIn("drove 5.0 m", self.unexpected("refuse", distance=5.0)[0])

    def test_a_vehicle_that_has_to_refuse_must_say_why(self):
        text = self.unexpected("refuse", says="no camera")[0]
        self.assertIn("does not say \"dark\"", text)
        self.assertIn("input: no camera", text)

    def test_a_vehicle_that_has_to_stop_must_stand_and_not_arrive(self):
        self.assertEqual([], self.unexpected("stop", distance=9.0))
        self.assertIn("still moved", self.unexpected("stop", distance=9.0, end_speed=1.0)[0])
        self.assertIn("reached it", self.unexpected("stop", distance=9.0, success=True)[0])
        self.assertIn("drove 0.2 m", self.unexpected("stop", distance=0.2)[0])
        self.assertEqual([], self.unexpected("reach", success=True))
        self.assertIn("not reached: given up", self.unexpected("reach")[0])

    def test_the_hardest_braking_is_that_of_the_true_speed(self):
        states = way([2.0] * 10 + [2.0 - 0.2 * i for i in range(11)] + [0.0] * 10)  # 4 m/s2
        self.assertAlmostEqual(4.0, judge.hardest_braking(states), places=6)
        self.assertIsNone(judge.hardest_braking([]))

    def test_the_nearest_thing_counts_whatever_it_is(self):
        states = way([1.0] * 3)
        states[1]["nearest"] = {"distance": 0.7}
        self.assertEqual(0.7, judge.nearest(states))
        self.assertIsNone(judge.nearest(states[:1]))

    def test_a_line_of_the_log_that_is_cut_off_is_left_out(self):
        with tempfile.NamedTemporaryFile("w", suffix=".jsonl") as file:
            file.write('{"type": "state", "stamp": 1.0}\n{"type": "sta')
            file.flush()
            self.assertEqual({"state": [{"type": "state", "stamp": 1.0}]}, judge.read_log(file.name))

    def test_whether_the_vehicle_stopped_after_a_kill(self):
        found = kills.finish([{"node": "vio", "time": 100.5, "speed": 2.0},
                              {"node": "power", "time": 110.0, "speed": 2.0}],
                             way([2.0] * 30 + [0.0] * 30) + way([2.0] * 60, begin=110.0))
        self.assertEqual([True, False], [kill["stopped"] for kill in found])


class Files(unittest.TestCase):
    def test_the_map_begins_at_the_imu(self):
        x, y = scenario.to_map([1.0, 2.0, 0.0], (0.8, 0.0), (1.8, 2.0))
        self.assertAlmostEqual(0.0, math.hypot(x, y))
        x, y = scenario.to_map([1.0, 2.0, math.pi / 2], (0.8, 0.0), (0.0, 2.8))
        self.assertAlmostEqual(0.0, x)
        self.assertAlmostEqual(1.0, y)
        pose = compose((1.0, 0.0, math.pi / 2), (2.0, 0.0, math.pi))
        self.assertAlmostEqual(2.0, pose[1])
        self.assertAlmostEqual(-math.pi / 2, pose[2])

    def test_scenarios_of_the_package_are_read(self):
        self.assertTrue((PACKAGE.parent / "pi_simulation" / "config" / "scenarios" / "campus_drive.yaml").is_file())
        for path in (PACKAGE.parent / "pi_simulation" / "config" / "scenarios").rglob("*.yaml"):
            self.assertEqual(path.stem, scenario.load(scenario.find(path.stem, PACKAGE), PACKAGE).name)

    def test_an_unknown_scenario_is_named_with_the_known_ones(self):
        with self.assertRaisesRegex(DemoError, "--scenario moon: no such file, .*campus_drive"):
            scenario.find("moon", PACKAGE)

    def test_rounds_are_summed_up(self):
        tree = {"kills": [{"back_s": 1.5}, {"back_s": None}], "collisions": [],
                "standstills": [{"cause": "a spoken stop"}, {"cause": None}], "stops": [{"braking_s": 0.5}],
                "met": {"crossing": {"distance": 1.2, "actor": True}}, "localisation": {"max_m": 0.2}}
        self.assertEqual(["4 services killed, 2 came back: p50 1.50 s, most 1.50 s",
                          "0 collisions; nearest actor 1.20 m; 4 standstills, 2 without a cause",
                          "\"stop\" to braking: p50 0.50 s, most 0.50 s; localisation: most 0.20 m"],
                         report.of_rounds([tree, tree]))
        self.assertEqual(2, len(report.of_rounds([])))

    def test_rounds_pass_the_other_options_on(self):
        program = load_program()
        words = ["--rounds", "5", "--no-rviz", "--seed=3", "--output", "a", "--kill", "2"]
        self.assertEqual(["--no-rviz", "--kill", "2"], program.without(words, program.OF_EACH_ROUND))


if __name__ == "__main__":
    unittest.main()
