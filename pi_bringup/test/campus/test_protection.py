"""The report of drive_campus --protection, and its disturbance."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from campus_drive import protection  # noqa: E402  (found through the line above)


class Started:
    """Counts what would run."""

    def __init__(self):
        self.running = []

    def start(self, command, _log):
        self.running.append(command)
        return command

    def stop(self, process):
        self.running.remove(process)


def tree(late_pairs, latencies):
    return {"odometry": {"pairs": 1200, "late_pairs": late_pairs, "dropped_pairs": 0, "late_poses": 2,
                         "longest_gap_ms": 23.4},
            "latency_ms": {"/detections": {"p50": 40.0, "p99": 80.0}, "/obstacles": {}}, "said": 6,
            "player_late_ms": {"mean": 0.1, "max": 1.5},
            "commands": [{"text": "stop", "latency": latency} for latency in latencies] + [{"text": "go", "latency": 9}],
            "vehicle_cores": 0.5}


class Protection(unittest.TestCase):

    def test_what_became_of_pairs_and_poses_is_counted_from_the_first_report(self):
        every = [{"pairs used": "100", protection.LATE_PAIRS: "3", protection.LATE_POSES: "9", protection.LONGEST: "400.0"},
                 {protection.DROPPED: "5"},
                 {"pairs used": "400", protection.LATE_PAIRS: "4", protection.LATE_POSES: "9", protection.LONGEST: "6.2"},
                 {protection.DROPPED: "7"}]
        self.assertEqual({"pairs": 300, "late_pairs": 1, "dropped_pairs": 2, "late_poses": 0, "longest_gap_ms": 6.2},
                         protection.odometry(every))
        self.assertEqual({None}, set(protection.odometry([]).values()))

    def test_the_table_has_median_and_spread_and_counts_words_that_were_not_heard(self):
        text = protection.table({"runtime": [tree(0, [0.4, 0.5, 0.6]), tree(2, [0.3]), tree(1, [])]})
        rows = {line[:38].strip(): line[38:].strip() for line in text.splitlines()}
        self.assertEqual("1 (0 to 2)", rows["pairs that took longer than a frame"])
        self.assertEqual("-", rows["picture to obstacles, p99 [ms]"])
        self.assertEqual("40 (40 to 40)", rows["picture to detection, p50 [ms]"])
        self.assertEqual("2 (2 to 2)", rows["latest message of the recording [ms]"])
        self.assertEqual("-2 (-3 to 0)", rows['"stop" heard, of those said'])
        self.assertEqual("0.30 (0.30 to 0.60)", rows['slowest "stop" [s]'])

    def test_a_batch_job_comes_and_goes_beside_the_busy_loops(self):
        started = Started()
        disturbance = protection.Disturbance(started, None)
        loops = len(started.running)
        self.assertGreater(loops, 0)
        counts = []
        for now in (1.0, 5.9, 6.0, 9.9, 10.0, 16.5):
            disturbance.tick(now)
            counts.append(len(started.running) // loops)
        self.assertEqual([1, 1, 2, 2, 1, 2], counts)
        disturbance.end()
        self.assertEqual([], started.running)


if __name__ == "__main__":
    unittest.main()
