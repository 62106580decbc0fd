import contextlib
import importlib.machinery
import importlib.util
import io
from pathlib import Path
import tempfile
import unittest
from unittest import mock

PROGRAM = str(Path(__file__).resolve().parents[2] / "scripts" / "benchmark_suite")
loader = importlib.machinery.SourceFileLoader("benchmark_suite", PROGRAM)
suite = importlib.util.module_from_spec(importlib.util.spec_from_loader("benchmark_suite", loader))
loader.exec_module(suite)

# As evaluate_sequence prints it.
REPORT = """drive: 200 pairs in 9.95 s
pairs        199 processed, 1 skipped, 40 keyframes, 0 with less work than asked for, 0 resets
start        initialised 1.00 s after the first pair
time per processed pair [ms]  mean      p50      p99      max   pairs
  front end                  1.20     1.10     2.30     3.10     199
  total                      2.10     1.80     5.20     7.70     199
  total, CPU                 2.60     2.40     7.60     8.00     199
map          38 keyframes, 7000 landmarks, 2.1 MB, 3 loops closed
odometry after each pair: 180 poses with ground truth, path 81.50 m
             position [mm] rmse   mean   median      max  rotation [deg] rmse  mean   median      max
  ATE SE3            58.00    50.00    48.00   140.00        0.300    0.200    0.200    0.500  0.071 % of the path
  ATE yaw only       60.00    50.00    48.00   140.00        0.300    0.200    0.200    0.500  0.073 % of the path
keyframes in the map: 38 poses with ground truth, path 80.00 m
             position [mm] rmse   mean   median      max  rotation [deg] rmse  mean   median      max
  ATE SE3            34.00    30.00    28.00    70.00        0.300    0.200    0.200    0.500  0.043 % of the path
"""


class TestBenchmarkSuite(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_program(self, *arguments):
        """Exit status, standard output and standard error."""
        with contextlib.redirect_stderr(io.StringIO()) as errors, contextlib.redirect_stdout(io.StringIO()) as output:
            try:
                status = suite.main([str(argument) for argument in arguments])
            except SystemExit as error:
                status = error.code
        return status, output.getvalue(), errors.getvalue()

    def add(self, *files):
        for name in files:
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("")

    def test_reads_the_figures_of_a_report(self):
        figures = suite.read_report(REPORT)
        self.assertEqual(figures, {"pairs": 200, "processed": 199, "path": 81.5, "odometry": .058, "map": .034,
                                   "loops": 3, "cpu_ms": 2.6})
        without_map = suite.read_report(REPORT[:REPORT.index("map    ")])
        self.assertIsNone(without_map["map"])
        self.assertIsNone(without_map["odometry"])

    def test_tells_what_is_real_rendered_and_simulated(self):
        for name in ("MH_01_easy", "V2_01_easy/V2_01_easy"):
            self.add(name + "/mav0/cam0/data/1.png", name + "/mav0/cam0/sensor.yaml",
                     name + "/mav0/state_groundtruth_estimate0/data.csv")
        self.add("V1_01_easy/mav0/imu0/data.csv",
                 "V1_01_easy/mav0/state_groundtruth_estimate0/data.csv", "room1/mav0/mocap0/data.csv",
                 "notes.txt")
        jobs = {job.name: job for job in suite.recording_jobs(self.folder, None, Path("/work"))}
        self.assertEqual({name: (job.pictures, job.imu) for name, job in jobs.items()},
                         {"MH_01_easy": ("real", "real"), "V1_01_easy": ("rendered", "real"),
                          "room1": ("rendered", "simulated"), "V2_01_easy": ("real", "real")})
        self.assertEqual(jobs["V1_01_easy"].render[:2],
                         ("-t", str(self.folder / "V1_01_easy/mav0/state_groundtruth_estimate0/data.csv")))
        self.assertEqual(jobs["V2_01_easy"].recording, self.folder / "V2_01_easy" / "V2_01_easy")

    def test_a_folder_with_pictures_needs_calibration_and_truth(self):
        self.add("room1/mav0/cam0/data/1.png")
        with self.assertRaisesRegex(suite.SuiteError, "room1/mav0: has no ground truth"):
            suite.recording_jobs(self.folder, None, Path("/work"))
        self.add("room1/mav0/mocap0/data.csv")
        with self.assertRaisesRegex(suite.SuiteError, "has no cam0/sensor.yaml; give Kalibr's"):
            suite.recording_jobs(self.folder, None, Path("/work"))
        job, = suite.recording_jobs(self.folder, "camchain.yaml", Path("/work"))
        self.assertEqual(job.options, ("-c", "camchain.yaml", "-g", str(self.folder / "room1/mav0/mocap0/data.csv")))

    def test_a_bag_needs_calibration_and_truth(self):
        self.add("MH_03_medium.bag")
        with self.assertRaisesRegex(suite.SuiteError, "MH_03_medium.bag: a bag has no calibration.*--calibration"):
            suite.recording_jobs(self.folder, None, Path("/work"))
        with self.assertRaisesRegex(suite.SuiteError, "no ground truth; put MH_03_medium.txt"):
            suite.recording_jobs(self.folder, "/euroc/MH_01", Path("/work"))
        self.add("MH_03_medium.csv")
        job, = suite.recording_jobs(self.folder, "/euroc/MH_01", Path("/work"))
        self.assertEqual(job.options, ("-c", "/euroc/MH_01", "-g", str(self.folder / "MH_03_medium.csv")))

    def test_names_a_folder_without_recordings(self):
        status, _, errors = self.run_program("--recordings", self.folder, "--data", self.folder)
        self.assertEqual(status, 1)
        self.assertIn(f"{self.folder}: holds no recording; expected NAME/mav0 or NAME.bag", errors)
        status, _, errors = self.run_program("--recordings", "/nowhere")
        self.assertEqual(status, 2)
        self.assertIn("--recordings /nowhere: missing", errors)

    def test_lists_what_would_run(self):
        self.add("slam/mh01_first10s/mav0/cam0/data/1.png", "slam/trajectories/hall.txt")
        status, output, _ = self.run_program("--data", self.folder, "--list")
        self.assertEqual(status, 0)
        self.assertIn("MH_01, first 10 s: pictures real, IMU real\n", output)
        self.assertIn("hall: pictures rendered, IMU simulated\n", output)
        status, _, errors = self.run_program("--data", self.folder, "--list", "--only", "mars")
        self.assertEqual(status, 1)
        self.assertIn("--only mars: fits none of: MH_01, first 10 s; ", errors)

    def test_a_rendering_that_was_ended_is_not_taken_for_a_whole_one(self):
        job = suite.Job("hall", "rendered", "simulated", self.folder / "hall", ("-d", "1"))
        endings = [KeyboardInterrupt, None]

        def run(command):
            (Path(command[-1]) / "mav0").mkdir(parents=True)
            ending = endings.pop(0)
            if ending:
                raise ending

        with mock.patch.object(suite, "run", run), mock.patch.object(suite, "program", lambda *names: names[1]):
            with self.assertRaises(KeyboardInterrupt):
                suite.render(job)
            self.assertFalse(job.recording.exists())
            suite.render(job)
        self.assertEqual(["hall"], [path.name for path in self.folder.iterdir()])
        self.assertTrue((job.recording / "mav0").is_dir())

    def test_knows_the_columns_of_published_tables(self):
        for name, column in (("MH_01_easy", "MH_01"), ("mh01", "MH_01"), ("V2_03_difficult", "V2_03"),
                             ("MH_01, whole flight", "MH_01"), ("MH_01, first 10 s", None), ("MH_06", None),
                             ("room1", None)):
            self.assertEqual(suite.euroc_name(name), column, name)

    def test_puts_own_figures_beside_published_ones(self):
        figures = suite.read_report(REPORT)
        real = suite.Job("V1_01_easy", "real", "real", self.folder)
        rendered = suite.Job("MH_01, whole flight", "rendered", "real", self.folder)
        broken = suite.Job("V1_02", "real", "real", self.folder)
        results = [(real, figures), (rendered, figures), (broken, suite.SuiteError("no pictures"))]
        table = suite.euroc_table(results)
        self.assertEqual(table[2],
                         "| pi_slam, odometry, pictures real, IMU real |" + 5 * "  |" + " 0.058 |" + 5 * "  |")
        self.assertEqual(table[5], "| pi_slam, map, pictures rendered, IMU real | 0.034 |" + 10 * "  |")
        self.assertTrue(table[6].startswith("| ORB-SLAM3, loops [1] | 0.036 | 0.033 "))
        self.assertEqual({line.count("|") for line in table if line.startswith("|")}, {13})
        rows = suite.results_table(results)
        self.assertIn("| V1_01_easy | real | real | 82 | 199 of 200 | 0.058 | 0.071 | 0.034 (3) | 2.6 |", rows)
        self.assertIn("| V1_02 | real | real | failed: no pictures |||||||", rows)

    def test_published_rows_have_a_value_or_none_for_each_recording(self):
        for system, values in suite.PUBLISHED:
            self.assertEqual(len(values), len(suite.EUROC), system)


if __name__ == "__main__":
    unittest.main()
