"""bench_power without a graph: model, table, what it says when something is missing."""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))  # the helpers of drive_demo
from pi_bringup import battery, bench_power  # noqa: E402


class BenchPower(unittest.TestCase):
    def setUp(self):
        self.model = bench_power.read_model(PACKAGE.with_name("pi_vehicle"))
        self.battery = battery.read(PACKAGE.with_name("pi_vehicle"))

    def test_the_model_has_the_papers_tx1(self):
        cpu, all_of_it = bench_power.watts(self.model, 2.4)  # 60 % of four cores
        self.assertAlmostEqual(4.2, cpu, delta=0.01)
        self.assertAlmostEqual(7.5, all_of_it, delta=0.01)  # the paper's 11 W without the GPU's 3.5 W
        self.assertAlmostEqual(self.model["idle_w"], bench_power.watts(self.model, 0.0)[0])

    def test_every_row_has_its_figure_of_the_paper(self):
        self.assertEqual({row.name for row in bench_power.ROWS}, set(bench_power.PAPER))
        self.assertEqual(["speech offloaded", "detection offloaded", "slam, others offloaded"],
                         [row.name for row in bench_power.ROWS if row.offloads])

    def test_table(self):
        figures = [bench_power.Figures(bench_power.ROWS[0], 10.0, {"slam": 0.5}, {"slam": 80.0},
                                       rates={"SLAM": "20 FPS"}),
                   bench_power.Figures(bench_power.ROWS[4], 10.0, {"speech": 0.1, "offloading": 0.15})]
        lines = bench_power.report(figures, self.model, 4, self.battery).partition("\n\n")[0].splitlines()
        self.assertEqual(3, len(lines))
        self.assertRegex(lines[1], r"slam +50 % +- +- +- +50 % +12 % +80 +1\.7 +5\.0 +4\.9 +SLAM 20 FPS")
        self.assertRegex(lines[2], r"speech offloaded +- +- +10 % +15 % +25 % +6 %")
        self.assertAlmostEqual(0.25, figures[1].total)

    def test_the_radio_counts_beside_the_board(self):
        self.assertAlmostEqual(bench_power.watts(self.model, 1.0)[1] + 0.3, bench_power.watts(self.model, 1.0, 0.3)[1])
        one = bench_power.as_dict(bench_power.Figures(bench_power.ROWS[5], 10.0, {"offloading": 0.05}, radio_w=0.3),
                                  self.model, self.battery)
        self.assertAlmostEqual(self.battery.watt_hours / one["watts"], one["hours"])

    def test_a_battery_gives_hours(self):
        self.assertAlmostEqual(24.42, self.battery.watt_hours)
        self.assertAlmostEqual(4.884, self.battery.hours(5.0))  # the paper's five hours, if it had three cells
        self.assertAlmostEqual(2.22, self.battery.hours(11.0))
        self.assertIsNone(self.battery.hours(None))
        self.assertAlmostEqual(20.0, battery.read(PACKAGE.with_name("pi_vehicle"), 10.0, 20.0).hours(10.0))
        for given, name in (((0.0, 11.1), "capacity_ah = 0"), ((2.2, float("nan")), "nominal_voltage = nan")):
            with self.assertRaisesRegex(ValueError, name):
                battery.Battery(*given)

    def test_figure_16_has_the_papers_numbers_beside_ours_and_their_kind(self):
        cores = {"speech": 0.08, "speech offloaded": 0.02, "detection": 0.2, "detection offloaded": 0.05}
        rows = {row[0]: row[1:] for row in battery.figure_16(cores, {"all": 6.0, "slam, others offloaded": 4.0},
                                                             self.battery)}
        self.assertEqual(["0.80 cores (measured)", "0.08 cores (measured)"], rows["CPU, speech"])
        self.assertEqual(["0.48 cores (measured)", "0.05 cores (measured)"], rows["CPU, detection offloaded"])
        self.assertEqual(["2.1 (from its numbers)", "4.0 (measured)"], rows["CPU, detection: times less"])
        self.assertEqual(["5.0 W (measured)", "4.0 W (model)"], rows["power, slam, others offloaded"])
        self.assertEqual(["4.9 h (from its numbers)", "6.1 h (model)"],
                         rows["battery of 2.2 Ah at 11.1 V, slam, others offloaded"])
        self.assertEqual(["2.5 (claim), 2.2 (from its numbers)", "1.5 (model)"], rows["times longer by offloading"])
        self.assertEqual("-", {row[0]: row for row in battery.figure_16({}, {}, self.battery)}["power, all"][2])

    def test_the_computer_is_busy(self):
        before = bench_power.busy_seconds()
        while bench_power.busy_seconds() == before:
            sum(range(100000))
        self.assertGreater(bench_power.busy_seconds(), before)

    def test_what_is_missing_is_named(self):
        with tempfile.TemporaryDirectory() as folder:
            environment = {key: value for key, value in os.environ.items() if key != "PI_EDGE_DATA"}
            run = ("import sys; sys.path.insert(0, %r); sys.argv[0] = %r; from pi_bringup.bench_power import main; "
                   "main()" % (str(PACKAGE / "scripts"), folder + "/lib/pi_bringup/bench_power"))
            for arguments, status, part in ((["--only", "slam"], 1, "no EuRoC recording"),
                                            (["--only", "detection", "--video", "/no/such/file"], 1, "no such file"),
                                            (["--only", "speech", "--sounds", "/no/such/file"], 1, "no such file"),
                                            (["--duration", "0"], 2, "must be above 0"),
                                            (["--battery-ah", "-1"], 2, "must be above 0"),
                                            (["--only", "flying"], 2, "invalid choice")):
                with self.subTest(arguments):
                    answer = subprocess.run([sys.executable, "-c", run, *arguments], env=environment, timeout=300,
                                            stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
                    self.assertEqual(status, answer.returncode, answer.stdout + answer.stderr)
                    self.assertIn(part, answer.stderr)


if __name__ == "__main__":
    unittest.main()
