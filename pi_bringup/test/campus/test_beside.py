"""The report of drives beside each other, without a graph."""

import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import beside, plots, report, sightings  # noqa: E402
from campus_drive.observer import Records  # noqa: E402


def topic(rate, p50, p99):
    return {"messages": 100, "rate_hz": rate, "latency_ms": {"p50": p50, "p99": p99}}


def drive(transport="π-OS", **changed):
    """The tree of a drive within all bars."""
    tree = {
        "transport": transport, "scenario": "campus_drive", "seed": 1, "failures": [], "seconds": 80.0,
        "machine": {"cpu": "a processor", "cores": 2, "memory_gb": 8.0, "load": 0.5},
        "action": {"success": True}, "collisions": [], "pairs_hz": 19.96,
        "topics": {"/odometry": topic(200.04, 7.0, 20.0), "/detections": topic(10.0, 80.0, 120.0),
                   "/left/image_raw": topic(20.0, 40.0, 90.0), "/motion": topic(50.0, 0.1, 1.0)},
        "commands": [{"accepted": True, "latency": 0.31}, {"accepted": True, "latency": 0.22},
                     {"accepted": False, "latency": 3.0}],
        "stops": [{"braking_s": 0.52}], "said": ["stop", "go"], "vehicle_cores": 0.784, "errors": [],
        "cpu_cores": {"vehicle": {"vio": 0.2, "ssd": 0.584}, "simulator": {"vehicle_simulator": 0.5}},
        "memory_mb": {"vio": {"pss": 50.0}, "ssd": {"pss": 61.0}, "vehicle_simulator": {"pss": 40.0}},
        "offloading": {"detection": {"tasks": 100, "by": {"remote gate": 60, "remote library": 20, "local": 20}}},
        "sightings": {"crossing": {"reported": 5, "in_view": 6}, "box": {"reported": 0, "in_view": 9}},
        "cameras": {"skipped pairs": "3", "delay of pictures p50 [ms]": "36.5"},
        "localisation": {"rms_m": 0.05, "max_m": 0.2}, "watts": 6.4, "watts_source": "model",
        "services": {"localisation": {"cpu": 0.2, "watts": 0.3, "memory_mb": 50 * 2 ** 20}},
        "transports": {"SHMROS": 80}}
    tree.update(changed)
    return tree


def screen_of(tree):
    with contextlib.redirect_stdout(io.StringIO()) as screen:
        beside.print_first(tree)
        beside.print_rest(tree)
    return screen.getvalue()


class Beside(unittest.TestCase):
    def test_all_bars_met_is_passed(self):
        tree = beside.compare([drive(), drive("TCPROS")])
        self.assertEqual([], tree["missed"])
        self.assertTrue(beside.verdict(tree).startswith("PASSED"))

    def test_a_bar_is_judged_by_the_figure_that_is_shown(self):
        rates = {value: dict((one[0], one[2]) for one in beside.bars(drive(pairs_hz=value)))[
            "stereo pairs into localisation"] for value in (19.96, 19.94)}
        self.assertEqual(("20.0 /s", True), (rates[19.96]["text"], rates[19.96]["met"]))
        self.assertEqual(("19.9 /s", False), (rates[19.94]["text"], rates[19.94]["met"]))

    def test_each_bar_can_be_missed(self):
        slow = {"/odometry": topic(190.0, 7.0, 20.0), "/detections": topic(9.0, 80.0, 120.0)}
        bad = drive(action=None, pairs_hz=None, topics=slow, commands=[{"accepted": True, "latency": 0.6}],
                    stops=[{"braking_s": None}], vehicle_cores=1.45, errors=[[0.0, "/vio", "broken"]])
        self.assertEqual(8, len(beside.compare([bad, drive("TCPROS")])["missed"]))

    def test_a_drive_that_failed_is_not_passed_whatever_the_bars(self):
        tree = beside.compare([drive(failures=["B was not reached"]), drive("TCPROS")])
        self.assertFalse(tree["passed"])
        self.assertIn("B was not reached", beside.verdict(tree))

    def test_the_other_drive_does_not_decide(self):
        tree = beside.compare([drive(), drive("TCPROS", failures=["late"], pairs_hz=12.0)])
        self.assertTrue(tree["passed"])
        self.assertTrue(beside.verdict(tree).startswith("PASSED"))
        self.assertIn("12.0 /s !", screen_of(tree))

    def test_ratios_are_theirs_by_ours(self):
        theirs = drive("TCPROS")
        theirs["topics"] = {**theirs["topics"], "/motion": topic(50.0, 0.35, 2.0),
                            "/left/image_raw": topic(20.0, 44.5, 99.0)}
        rows = {one["topic"].strip(): one for one in beside.transport([drive(), theirs])}
        self.assertEqual(3.5, rows["/motion"]["p50_ratio"])
        self.assertEqual(2.0, rows["/motion"]["p99_ratio"])
        self.assertEqual(1.1, rows["/left/image_raw"]["p50_ratio"])

    def test_the_screen_has_the_figures_of_the_file(self):
        tree = beside.compare([drive(), drive("TCPROS", watts=None)])
        with tempfile.TemporaryDirectory() as folder:
            written = json.loads(beside.write(tree, Path(folder)).read_text(encoding="utf-8"))
        screen = screen_of(tree)
        self.assertIn(written["verdict"], screen)
        for row in written["bars"] + written["others"]:
            line = next(line for line in screen.splitlines() if line.strip().startswith(row["what"]))
            for one in row["drives"]:
                self.assertIn(one["text"], line)

    def test_what_is_reported_once_is_not_missed(self):
        figures = dict(beside.others(drive()))
        self.assertEqual("1", figures["people and things on the way: reported"]["text"])
        self.assertEqual("1", figures["people and things on the way: missed"]["text"])
        self.assertEqual("80 %", figures["pictures detected at edge nodes"]["text"])


class Sightings(unittest.TestCase):
    @staticmethod
    def state(stamp, position, distance=5.0):
        return {"stamp": stamp, "nearest_actor": {"actor": "crossing", "class": "person", "distance": distance,
                                                  "position": position}}

    def test_an_obstacle_at_the_place_counts(self):
        found = sightings.sightings([self.state(1.0, [6.0, 0.0]), self.state(1.05, [6.0, 0.0])],
                                    [(1.02, [(6.5, 0.4), (1.0, 1.0)])])["crossing"]
        self.assertEqual((2, 1), (found["in_view"], found["reported"]))
        self.assertAlmostEqual(0.05, found["first_s"])

    def test_old_reports_and_other_places_do_not_count(self):
        states = [self.state(2.0, [6.0, 0.0])]
        for reports in ([(1.0, [(6.0, 0.0)])], [(1.99, [(6.0, 2.0)])], []):
            self.assertIsNone(sightings.sightings(states, reports)["crossing"]["first_s"])

    def test_what_is_beside_behind_or_far_is_not_in_view(self):
        states = [self.state(1.0, [3.0, 3.0]), self.state(1.0, [-3.0, 0.0]), self.state(1.0, [20.0, 0.0], 19.0)]
        self.assertEqual({}, sightings.sightings(states, []))


class PairsOfPictures(unittest.TestCase):
    def test_the_rate_goes_over_the_lives_of_a_node(self):
        records = Records()
        records.pairs = [(0.0, 50), (10.0, 100), (11.0, 120), (12.0, 10), (13.0, 30)]
        self.assertAlmostEqual(50.0 / 3.0, report.pairs_hz(records, 5.0, 13.0))  # 20, 10, 20 in three seconds
        self.assertIsNone(report.pairs_hz(records, 12.5, 14.0))


class Gantt(unittest.TestCase):
    def test_tasks_are_in_the_row_of_who_answered_and_the_second_chart_shows_the_changes(self):
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot

        def task(stamp, how, node=""):
            return {"kind": "detection", "how": how, "node": node, "stamp": stamp, "response_time": 0.05,
                    "by_deadline": True}
        tasks = [task(0.1 * index, "remote", "gate") for index in range(200)] + [
            task(20.0, "fallback", "gate"), task(20.1, "remote", "library"), task(20.2, "local"),
            task(40.0, "abandoned")]
        figure, axes = pyplot.subplots(2, 1)
        plots.gantt(axes, tasks, 50.0)
        self.assertEqual(["detection abandoned", "detection at gate", "detection at library", "detection on board"],
                         [label.get_text() for label in axes[0].get_yticklabels()])
        bars = {(round(bar.get_x(), 3), round(bar.get_y() + bar.get_height() / 2)) for bar in axes[0].patches}
        self.assertLessEqual({(0.0, 1), (20.0, 3), (20.1, 2), (20.2, 3), (40.0, 0)}, bars)
        begin, end = axes[1].get_xlim()
        self.assertTrue(begin < 20.0 and 20.2 < end and end - begin == plots.ZOOM_S)
        pyplot.close(figure)


if __name__ == "__main__":
    unittest.main()
