"""The report of `make demo`, without a graph."""

import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import demo, page, plots, report, sightings  # noqa: E402
from campus_drive.observer import Records  # noqa: E402


def topic(rate, p50, p99):
    return {"messages": 100, "rate_hz": rate, "latency_ms": {"p50": p50, "p99": p99}}


def drive(**changed):
    """The tree of a drive within all bars."""
    tree = {
        "transport": "π-OS", "scenario": "campus_drive", "seed": 1, "failures": [], "seconds": 80.0,
        "distance_m": 90.0, "machine": {"cpu": "a processor", "cores": 2, "memory_gb": 8.0, "load": 0.5},
        "action": {"success": True}, "collisions": [], "nearest_m": 0.6, "hardest_braking": 1.9,
        "commands": [{"accepted": True, "latency": 0.31, "text": "stop", "confidence": 1.0, "fast": False},
                     {"accepted": True, "latency": 0.22, "text": "go", "confidence": 1.0, "fast": False}],
        "stops": [], "said": ["stop", "go"], "errors": [], "standstills": [], "corrections": 1, "losses": [], "met": {},
        "sightings": {"crossing": {"reported": 5, "in_view": 6, "first_s": 0.1}}, "links": [], "kills": [],
        "cameras": {"pairs": "90", "skipped pairs": "3", "delay of pictures p50 [ms]": "36.5"}, "offloading": {},
        "network": "net",
        "localisation": {"rms_m": 0.05, "max_m": 0.2, "heading_max": 0.01}, "transports": {"SHMROS": 80},
        "reactions": [], "unplugs": [], "no_gantt": ""}
    tree.update(changed)
    return tree


def run(**changed):
    """The tree of a run on the recording, within all bars."""
    tree = {
        "pairs_hz": 19.96, "vehicle_cores": 0.784, "others_share": 0.02, "watts": 6.4, "watts_source": "model",
        "battery": "2.2 Ah at 11.1 V", "battery_wh": 24.42,
        "topics": {"/odometry": topic(200.04, 7.0, 20.0), "/detections": topic(10.0, 80.0, 120.0),
                   "/left/image_raw": topic(20.0, 1.0, 3.0), "/imu/data": topic(200.0, 0.1, 1.0)},
        "commands": [{"accepted": True, "latency": 0.31}], "said": 1, "transports": {"SHMROS": 70}, "errors": [],
        "latency_ms": {"/obstacles": {"p50": 40.0, "p99": 90.0}, "/detections": {"p50": 60.0, "p99": None}},
        "cpu_cores": {"vehicle": {"vio": 0.2, "ssd": 0.584}, "recording": {"player": 0.1}},
        "memory_mb": {"vio": {"pss": 50.0}, "ssd": {"pss": 61.0}},
        "services": {"localisation": {"cpu": 0.2, "watts": 0.3, "memory_mb": 50 * 2 ** 20}}}
    tree.update(changed)
    return tree


def compare(driven=None, ours=None, theirs=None, reasons=("", ""), alone=""):
    return demo.compare(driven or drive(), [[run()] * 2 if ours is None else ours,
                                            [run()] * 2 if theirs is None else theirs], reasons, alone)


def row(tree, what):
    return next(one for one in tree["speed"] if one["what"] == what)


def screen_of(tree):
    with contextlib.redirect_stdout(io.StringIO()) as screen:
        demo.print_first(tree)
        demo.print_rest(tree)
    return screen.getvalue()


class Demo(unittest.TestCase):
    def test_all_bars_met_is_passed(self):
        tree = compare()
        self.assertEqual([], tree["missed"])
        self.assertTrue(tree["passed"])
        self.assertTrue(demo.verdict(tree).startswith("PASSED"))

    def test_the_network_of_the_detector_is_told(self):
        said = {"ssd: detection": (0, "", {"model": "net"})}
        self.assertEqual(report.network(said), "net")
        said["ssd: detection"][2]["stands in"] = "small stands in for net"
        self.assertEqual(report.network(said), "small stands in for net")
        self.assertIsNone(report.network({}))
        self.assertIn("detector: net", list(demo.notes(compare())))

    def test_a_bar_is_judged_by_the_figure_that_is_shown(self):
        for value, text, met in ((19.96, "20.0 /s", True), (19.94, "19.9 /s", False)):
            shown = row(compare(ours=[run(pairs_hz=value)]), "stereo pairs into localisation")["figures"][0]
            self.assertEqual((text, met), (shown["text"], shown["met"]))

    def test_each_bar_can_be_missed(self):
        slow = {"/odometry": topic(190.0, 7.0, 20.0), "/detections": topic(9.0, 80.0, 120.0)}
        bad = run(pairs_hz=None, topics=slow, commands=[{"accepted": True, "latency": 0.6}], vehicle_cores=1.45,
                  errors=[("/ssd", "broken")])
        driven = drive(action=None, stops=[{"braking_s": None}], errors=[[0.0, "/vio", "broken"]],
                       commands=[{"accepted": True, "latency": 0.3, "text": "left"}], collisions=[1], standstills=[{"cause": None}],
                       sightings={"box": {"reported": 0, "in_view": 9, "first_s": None}})
        tree = compare(driven, ours=[bad])
        bars = [one for one in tree["function"] + tree["speed"] if one["bar"]]
        self.assertEqual([one["what"] for one in bars], tree["missed"])
        self.assertFalse(tree["passed"])

    def test_a_word_that_was_heard_as_another_is_not_heard(self):
        heard = [{"accepted": True, "latency": 0.3, "text": text} for text in ("go", "stop")]
        tree = compare(drive(commands=heard))
        self.assertEqual(["commands heard of those said", "commands heard that nobody said"], tree["missed"])
        self.assertEqual("1 of 2", next(one["figure"]["text"] for one in tree["function"]
                                        if one["what"] == "commands heard of those said"))

    def test_a_word_that_was_not_heard_misses_the_bar(self):
        tree = compare(ours=[run(said=2)])
        self.assertEqual(["spoken command, p95 from the end of the word"], tree["missed"])

    def test_a_drive_that_failed_is_not_passed_whatever_the_bars(self):
        tree = compare(drive(failures=["B was not reached"]))
        self.assertFalse(tree["passed"])
        self.assertIn("B was not reached", demo.verdict(tree))

    def test_speed_is_not_judged_while_others_take_the_computer(self):
        tree = compare(ours=[run(pairs_hz=9.0, others_share=0.6)])
        self.assertTrue(tree["passed"])
        self.assertIn("60 %", demo.verdict(tree))
        self.assertNotIn("9.0 /s !", screen_of(tree))

    def test_a_run_that_failed_loses_its_own_column_only(self):
        tree = compare(theirs=[], reasons=("", "no drive: vio ended"))
        self.assertTrue(tree["passed"])
        self.assertEqual(["20.0 /s", "-"], [one["text"] for one in row(tree, "stereo pairs into localisation")["figures"]])
        self.assertIn("over TCPROS: no figures: no drive: vio ended", screen_of(tree))
        tree = compare(ours=[], reasons=("no drive: vio ended", ""))
        self.assertFalse(tree["passed"])
        tree = compare(alone="no drive: ssd ended")
        self.assertFalse(tree["passed"])
        self.assertIn("not in one process: no drive: ssd ended", screen_of(tree))

    def test_figures_are_medians_and_ratios_are_theirs_by_ours_with_their_spread(self):
        ours = [run(vehicle_cores=cores) for cores in (0.5, 0.6, 0.9)]
        theirs = [run(vehicle_cores=cores) for cores in (1.0, 0.6, 0.9)]
        one = row(compare(ours=ours, theirs=theirs), "processor, whole vehicle")
        self.assertEqual(["60 %", "90 %"], [value["text"] for value in one["figures"]])
        self.assertEqual({"median": 1.0, "least": 1.0, "greatest": 2.0}, one["ratio"])

    def test_watts_give_the_hours_of_the_battery_and_their_source(self):
        tree = compare(ours=[run(watts=6.0)], theirs=[run(watts=None)])
        one = row(tree, "hours of the computer on 2.2 Ah at 11.1 V (model)")
        self.assertEqual(["4.1 h", "-"], [value["text"] for value in one["figures"]])

    def test_screen_page_and_file_have_the_same_figures(self):
        tree = compare(ours=[run(watts=None)])
        with tempfile.TemporaryDirectory() as folder:
            written = json.loads(demo.write(tree, Path(folder)).read_text(encoding="utf-8"))
            text = page.write(tree, [(Path(folder) / "none.png", "not there")], Path(folder) / "index.html").read_text(
                encoding="utf-8")
        screen = screen_of(tree)
        self.assertIn(written["verdict"], screen)
        self.assertIn(written["verdict"], text)
        self.assertNotIn("<img", text)
        for one in written["speed"]:
            line = next(line for line in screen.splitlines() if line.strip().startswith(one["what"]))
            for value in one["figures"]:
                self.assertIn(value["text"], line)
                self.assertIn(value["text"], text)


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
        self.assertAlmostEqual(50.0 / 3.0, report.pairs_hz(records.pairs, 5.0, 13.0))  # 20, 10, 20 in three seconds
        self.assertIsNone(report.pairs_hz(records.pairs, 12.5, 14.0))


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


class TextsInPlots(unittest.TestCase):
    def test_none_covers_another_or_a_mark(self):
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot
        figure, axes = pyplot.subplots(figsize=(8, 6))
        axes.set(xlim=(0, 640), ylim=(480, 0))
        labels = plots.Labels(axes)
        marks = [(100, 200), (112, 194), (300, 300)]
        labels.keep_clear(marks)
        for place in marks + [(104, 204), (300, 300), (310, 296)]:
            labels.add("stood 4 s", place, "black")
        renderer = figure.canvas.get_renderer()
        boxes = [text.get_window_extent(renderer) for text in axes.texts]
        self.assertEqual(len(boxes), 6)
        for number, box in enumerate(boxes):
            self.assertFalse(any(box.overlaps(other) for other in boxes[:number]), number)
            self.assertFalse(any(box.contains(*axes.transData.transform(mark)) for mark in marks), number)
        pyplot.close(figure)


if __name__ == "__main__":
    unittest.main()
