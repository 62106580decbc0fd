"""Properties of the pictures of draw_gantt."""

import importlib.machinery
import importlib.util
import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

import numpy

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts/draw_gantt"
loader = importlib.machinery.SourceFileLoader("draw_gantt", str(SCRIPT))
gantt = importlib.util.module_from_spec(importlib.util.spec_from_loader("draw_gantt", loader))
loader.exec_module(gantt)

MS = 1_000_000
ORIGIN = 123_456_789_012_345  # as a steady clock may say
FIRST, SECOND = gantt.PALETTE[:2]  # of the busiest codelet and the next


def make_task(unit, start_ms, end_ms, codelet="detect", **fields):
    times = {"started_ns": ORIGIN + int(start_ms * MS), "finished_ns": ORIGIN + int(end_ms * MS)}
    return gantt.Task(codelet=codelet, unit=unit, **{**times, **fields})


def draw(tasks, units=(), **options):
    return gantt.Gantt(tasks, list(units), **options).pixels


def count(pixels, colour):
    return int((pixels == colour).all(axis=2).sum())


def longest_line(pixels, colour):
    """Pixels of a colour in the line that has most of it, and where the first is."""
    there = (pixels == colour).all(axis=2)
    row = there[there.sum(axis=1).argmax()]
    return int(row.sum()), int(row.argmax())


class Utilisation(unittest.TestCase):
    def test_is_the_union_of_transfers_and_runs(self):
        tasks = [make_task(0, 0, 10), make_task(0, 5, 12), make_task(0, 20, 30, transfer_ns=5 * MS),
                 make_task(2, 90, 200)]
        busy = gantt.utilisation(tasks, 4, ORIGIN, ORIGIN + 100 * MS)
        self.assertEqual(4, len(busy))
        self.assertAlmostEqual(0.27, busy[0])
        self.assertEqual(0, busy[1])
        self.assertAlmostEqual(0.1, busy[2], msg="cut at the end of the time asked for")
        self.assertEqual(3, len(gantt.utilisation(tasks, 0, ORIGIN, ORIGIN + MS)), "records may name more units")

    def test_of_no_time_or_no_run_is_zero(self):
        never = make_task(0, 0, 10, started_ns=0)
        self.assertEqual([0], gantt.utilisation([never], 1, ORIGIN, ORIGIN + MS))
        self.assertEqual([0], gantt.utilisation([make_task(0, 0, 10)], 1, ORIGIN, ORIGIN))


class Gantt(unittest.TestCase):
    def test_bars_are_as_long_as_the_tasks(self):
        pixels = draw([make_task(0, 0, 750), make_task(1, 250, 500, "blur"), make_task(2, 990, 1000, "last")],
                      ["CPU 0", "CPU 1", "GPU"])
        blue, blue_at = longest_line(pixels, FIRST)
        orange, orange_at = longest_line(pixels, SECOND)
        outline = 2  # pixels of each bar
        self.assertAlmostEqual(3.0, (blue + outline) / (orange + outline), delta=0.02)
        self.assertAlmostEqual(orange + outline, orange_at - blue_at, delta=2, msg="the second starts at a quarter")

    def test_a_missed_deadline_is_red(self):
        end = ORIGIN + 100 * MS
        self.assertEqual(0, count(draw([make_task(0, 0, 100, deadline_ns=end)]), gantt.RED))
        pixels = draw([make_task(0, 0, 100, deadline_ns=end - 50 * MS)])
        self.assertAlmostEqual(0.5, longest_line(pixels, gantt.RED)[0] / longest_line(pixels, FIRST)[0], delta=0.02)

    def test_a_miss_shows_among_thousands_of_tasks(self):
        tasks = [make_task(0, index * 10, index * 10 + 1) for index in range(5000)]
        self.assertEqual(0, count(draw(tasks), gantt.RED))
        tasks[2500] = make_task(0, 25000, 25001, deadline_ns=ORIGIN + 25001 * MS - 1)
        self.assertGreater(count(draw(tasks), gantt.RED), 0)

    def test_transfers_and_failures_look_different(self):
        plain = draw([make_task(0, 0, 100)])
        transfer = draw([make_task(0, 50, 100, transfer_ns=50 * MS)])
        failed = draw([make_task(0, 0, 100, outcome="failed")])
        self.assertAlmostEqual(0.5, longest_line(transfer, FIRST)[0] / longest_line(plain, FIRST)[0], delta=0.2,
                               msg="the hatching has some pixels of the plain colour")
        self.assertFalse(numpy.array_equal(plain, failed[:plain.shape[0]]))

    def test_grows_with_the_units(self):
        two = draw([make_task(0, 0, 1)], ["CPU", "GPU"])
        four = draw([make_task(3, 0, 1)], ["CPU", "GPU"])
        self.assertEqual((1600, 3), two.shape[1:])
        self.assertGreater(four.shape[0], two.shape[0] + 40, "units that only records name have rows as well")

    def test_shows_the_time_asked_for_only(self):
        tasks = [make_task(0, 0, 100, "first"), make_task(0, 200, 250, "second")]
        pixels = draw(tasks, begin_s=0.15, end_s=0.25)
        whole = longest_line(draw([make_task(0, 0, 100)]), FIRST)[0]
        self.assertAlmostEqual(0.5, longest_line(pixels, SECOND)[0] / whole, delta=0.02,
                               msg="colours are those of the whole trace")
        # The legend names both; the plot has none of the first.
        self.assertLessEqual(longest_line(pixels, FIRST)[0], 30)

    def test_empty_and_tiny_traces_have_a_picture(self):
        self.assertGreater(draw([]).shape[0], 0)
        self.assertGreater(draw([], ["CPU"]).shape[0], 0)
        figure = gantt.Gantt([make_task(0, 5, 5)], [""]).figure()
        figure.canvas.draw()
        colours = numpy.unique(numpy.asarray(figure.canvas.buffer_rgba()).reshape(-1, 4), axis=0)
        self.assertGreater(len(colours), 10, "a task without duration")
        self.assertGreater(draw([make_task(0, 0, 1, started_ns=0)]).shape[0], 0)

    def test_takes_any_names_and_many_codelets(self):
        names = ["codelet of a $long_{ name \u96ea \ufffd\0%d" % index for index in range(60)]
        tasks = [make_task(0, index * 10, index * 10 + 10, name) for index, name in enumerate(names)]
        picture = gantt.Gantt(tasks, ["x" * 500])
        self.assertGreater(count(picture.pixels, gantt.OTHER), 1000, "codelets beyond the palette are grey")
        picture.figure().canvas.draw()

    def test_any_trace_is_drawn_inside_the_picture(self):
        source = random.Random(5)

        def any_time():
            return source.randrange(2_000_000_000) - 1_000_000_000

        for _ in range(200):
            tasks = [gantt.Task(codelet=source.choice("ab"), unit=source.randrange(3), started_ns=any_time(),
                                transfer_ns=any_time(), finished_ns=any_time(),  # before the start as well
                                deadline_ns=any_time(), outcome=source.choice(("ok", "failed", "cancelled")))
                     for _ in range(source.randint(1, 50))]
            self.assertEqual(600, draw(tasks, width=600, end_s=source.choice((1e-8, 10))).shape[1])

    def test_refuses_options_that_make_no_picture(self):
        def error(begin, end, width):
            try:
                draw([make_task(0, 0, 1000)], begin_s=begin, end_s=end, width=width)
            except ValueError as problem:
                return str(problem)
            return "no error"

        self.assertEqual("no error", error(0, math.inf, 600))
        self.assertEqual("width = 599, must be in [600, 20000]", error(0, math.inf, 599))
        self.assertIn("from_s = -1", error(-1, math.inf, 600))
        self.assertIn("from_s = nan", error(math.nan, math.inf, 600))
        self.assertIn("to_s = 1, must be greater than from_s = 2", error(2, 1, 600))
        self.assertIn("to_s = nan", error(0, math.nan, 600))
        self.assertIn("from_s = 5 is not before the end", error(5, math.inf, 600))
        self.assertEqual("no error", error(0, 1e300, 600))

    def test_writes_a_png_or_says_why_not(self):
        figure = gantt.Gantt([make_task(0, 0, 1)], ["CPU"]).figure()
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "picture.png")
            gantt.save(figure, str(path))
            self.assertEqual(b"\x89PNG\r\n\x1a\n", path.read_bytes()[:8])
            for wrong in (folder + "/missing/picture.png", folder + "/picture.unknown"):
                with self.assertRaises(ValueError) as caught:
                    gantt.save(figure, wrong)
                self.assertIn(wrong, str(caught.exception))


class ReadTrace(unittest.TestCase):
    RECORD = {"task": 7, "codelet": "detect", "unit": 1, "started_ns": 5, "transfer_ns": 2, "finished_ns": 9,
              "deadline_ns": 8, "outcome": "failed", "implementation": "detect.cl"}

    def read(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder, "trace.json")
            path.write_text(text)
            return gantt.read_trace(str(path))

    def error(self, text):
        with self.assertRaises(ValueError) as caught:
            self.read(text)
        return str(caught.exception)

    def test_reads_tasks_and_units(self):
        events = [{"ph": "M", "name": "thread_name", "tid": 2, "args": {"name": "GPU"}},
                  {"ph": "X", "cat": "run", "args": self.RECORD}]
        (task,), units = self.read(json.dumps({"traceEvents": events}))
        self.assertEqual(["", "GPU"], units)
        self.assertEqual((7, "detect", 1, 5, 3, 9, "failed", True),
                         (task.number, task.codelet, task.unit, task.started, task.taken, task.finished, task.outcome,
                          task.late))

    def test_skips_events_of_others(self):
        tasks, units = self.read('{"traceEvents":[{"ph":"X","cat":"run","name":"x"},{"ph":"C"},{}]}')
        self.assertEqual(([], []), (tasks, units))

    def test_refuses_what_it_cannot_read(self):
        self.assertIn("not a trace of pi_runtime", self.error("{"))
        self.assertIn("traceEvents", self.error("{}"))
        self.assertIn("codelet", self.error('{"traceEvents":[{"cat":"run","args":{"task":1}}]}'))
        self.assertIn("tid 4000000000", self.error('{"traceEvents":[{"ph":"M","name":"thread_name","tid":4000000000}]}'))
        absurd = {"traceEvents": [{"cat": "run", "args": {**self.RECORD, "outcome": "absurd"}}]}
        self.assertIn('"absurd"', self.error(json.dumps(absurd)))

    def test_the_program_ends_with_one_line(self):
        end = subprocess.run([sys.executable, str(SCRIPT), "/nowhere/trace.json", "out.png"], capture_output=True,
                             text=True, check=False)
        self.assertEqual((1, "draw_gantt: /nowhere/trace.json cannot be opened: No such file or directory\n"),
                         (end.returncode, end.stderr))


if __name__ == "__main__":
    unittest.main()
