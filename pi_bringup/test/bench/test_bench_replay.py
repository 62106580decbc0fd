"""The verdict of bench_replay, without a graph, and what it counts as memory."""

import mmap
import os
import sys
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))  # the helpers of the drives
from first_drive import measuring  # noqa: E402
from pi_bringup import bench_replay  # noqa: E402


def memory(slope_mb_per_s, start=200.0, seconds=3600):
    """Grows fast while it settles, then by the slope."""
    return [(at, start - (30.0 if at < 60 else 0.0) + slope_mb_per_s * at) for at in range(0, seconds, 10)]


def window(p50, detection=30.0):
    figures = {topic: {"p50": p50, "p99": 2 * p50} for topic in bench_replay.TIMED}
    figures["/detections"] = {"p50": detection, "p99": 2 * detection}
    return figures


def good():
    return {"seconds": 3600.0, "settling_s": 300.0, "total_mb": memory(0.0), "memory_mb": {"vio": memory(0.0)},
            "windows": [window(5.0) for _ in range(9)], "restarted": [], "resets": 0, "pairs": 72000,
            "cores": {"vio": 0.2}, "failures": [], "before": {"/imu/data": 300, "/odometry": 150},
            "counted": {"/imu/data": {"messages": 720000, "lost": 0}, "/odometry": {"messages": 719840, "lost": 0},
                        **{topic: {"messages": 100, "lost": 0} for topic in bench_replay.WORKING}}}


class Judge(unittest.TestCase):
    def test_passes_what_stays(self):
        self.assertEqual([], bench_replay.judge(good()))

    def test_memory_that_grows(self):
        result = good()
        result["total_mb"] = memory(0.002)  # 6 MB in 50 minutes
        self.assertRegex(bench_replay.judge(result)[0], r"^memory grew by 3\.\d %, from 20\d to 20\d MB$")
        result["total_mb"] = memory(0.001)
        self.assertEqual([], bench_replay.judge(result))

    def test_too_short_for_memory(self):
        result = good()
        result["total_mb"] = memory(0.0, seconds=100)
        self.assertIn("too short to judge memory: 3600 s", bench_replay.judge(result))

    def test_lost_messages(self):
        result = good()
        result["counted"]["/imu/data"]["lost"] = 3
        self.assertEqual(["3 messages of /imu/data were lost"], bench_replay.judge(result))
        result["counted"]["/odometry"]["messages"] = 0
        self.assertIn("nothing came on /odometry", bench_replay.judge(result))

    def test_samples_without_a_pose(self):
        result = good()
        result["counted"]["/odometry"]["messages"] = 719000
        self.assertEqual(["718850 poses of 719700 IMU samples"], bench_replay.judge(result))

    def test_latency_that_drifts(self):
        result = good()
        result["windows"] = [window(5.0, 30.0 + i) for i in range(9)]
        self.assertEqual(["latency of /detections drifted from 31.0 to 37.0 ms"], bench_replay.judge(result))
        result["windows"] = [window(0.5 + 0.05 * i) for i in range(9)]  # less than a millisecond
        self.assertEqual([], bench_replay.judge(result))

    def test_deaths_and_resets(self):
        result = good()
        result["restarted"], result["resets"] = ["ssd"], 2
        self.assertEqual(["ssd ended and was started again", "localisation began anew 2 times"],
                         bench_replay.judge(result))

    def test_pages_of_files_are_no_memory_that_is_kept(self):
        size = 32 << 20
        before = measuring.memory_mb(os.getpid())
        with open(sys.executable, "rb") as file, mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as kept:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as pages:
                kept.write(b"x" * size)
                self.assertEqual(len(pages), len(pages[:]))  # all of them are read
                during = measuring.memory_mb(os.getpid())
        self.assertGreater(during["rss"] - before["rss"], 32.0)
        self.assertAlmostEqual(32.0, during["kept"] - before["kept"], delta=8.0)  # and what the test copies
        self.assertGreater(during["pss"], during["kept"])

    def test_report(self):
        text = bench_replay.report({**good(), "failures": ["nothing works"]})
        self.assertRegex(text, r"vio +200\.0 +200\.0 +\+0\.00 +20\.0")
        self.assertRegex(text, r"/odometry +5\.00 +5\.00 +\+0\.0")
        self.assertTrue(text.endswith("FAILED nothing works"))


if __name__ == "__main__":
    unittest.main()
