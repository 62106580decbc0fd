"""Whether the vehicle keeps its times beside other programs, with the runtime and without it."""

import os
import sys

from .judge import quantile

VARIANTS = {"runtime, disturbed": ["--disturb"], "plain, disturbed": ["--disturb", "--no-runtime"],
            "runtime, alone": [], "plain, alone": ["--no-runtime"]}
BATCH_S, BATCH_EVERY_S = 4.0, 10.0
BUSY = (sys.executable, "-c", "while True: pass")
LATE_PAIRS, LATE_POSES = "pairs that took longer than a frame", "times over 20 ms between two odometries"
LONGEST, DROPPED = "longest time between two odometries [ms]", "pairs dropped to keep up"


class Disturbance:
    """A busy loop per core, of the class and weight that any program has, and a batch job now and then: as many again.
    Each is a session of its own, as roslaunch's nodes are."""

    def __init__(self, started, log):
        self._started, self._log = started, log
        self._endless = self._begin()
        self._batch = []

    def _begin(self):
        return [self._started.start(BUSY, self._log) for _ in range(os.cpu_count())]

    def tick(self, since_begin):
        wanted = since_begin % BATCH_EVERY_S >= BATCH_EVERY_S - BATCH_S
        if wanted and not self._batch:
            self._batch = self._begin()
        elif not wanted and self._batch:
            self._batch = self._stop(self._batch)

    def _stop(self, processes):
        for process in processes:
            self._started.stop(process)
        return []

    def end(self):
        self._stop(self._endless + self._batch)


def odometry(every):
    """@param every  values of the diagnostics of odometry and inputs, oldest first. @return what became of pairs and
    poses between the first and the last"""
    def grown(key):
        counts = [int(values[key]) for values in every if key in values]
        return counts[-1] - counts[0] if counts else None
    longest = [float(values[LONGEST]) for values in every if LONGEST in values][1:]
    return {"pairs": grown("pairs used"), "late_pairs": grown(LATE_PAIRS), "dropped_pairs": grown(DROPPED),
            "late_poses": grown(LATE_POSES), "longest_gap_ms": max(longest, default=None)}


def stop_words(tree):
    """Seconds from the end of each "stop" to its command."""
    return [one["latency"] for one in tree["commands"] if one["text"] == "stop"]


def _middle(values, digits):
    """Median and spread of what is known, as text."""
    known = sorted(value for value in values if value is not None)
    if not known:
        return "-"
    return "%.*f (%.*f to %.*f)" % (digits, quantile(known, 0.5), digits, known[0], digits, known[-1])


def table(trees):
    """@param trees  variant: a tree per round. @return text: median, least and most of the rounds"""
    rows = {
        "pairs used": lambda tree: tree["odometry"]["pairs"],
        "pairs that took longer than a frame": lambda tree: tree["odometry"]["late_pairs"],
        "pairs dropped to keep up": lambda tree: tree["odometry"]["dropped_pairs"],
        "times over 20 ms between poses": lambda tree: tree["odometry"]["late_poses"],
        "longest time between poses [ms]": lambda tree: tree["odometry"]["longest_gap_ms"],
        "picture to detection, p99 [ms]": lambda tree: tree["latency_ms"]["/detections"].get("p99"),
        "picture to detection, p50 [ms]": lambda tree: tree["latency_ms"]["/detections"].get("p50"),
        "picture to obstacles, p50 [ms]": lambda tree: tree["latency_ms"]["/obstacles"].get("p50"),
        "picture to obstacles, p99 [ms]": lambda tree: tree["latency_ms"]["/obstacles"].get("p99"),
        "\"stop\" heard, of those said": lambda tree: len(stop_words(tree)) - tree["said"] // 2,
        "slowest \"stop\" [s]": lambda tree: max(stop_words(tree), default=None),
        "latest message of the recording [ms]": lambda tree: tree["player_late_ms"].get("max"),
        "CPU of the vehicle [cores]": lambda tree: tree["vehicle_cores"],
    }
    digits = {"CPU of the vehicle [cores]": 3, "slowest \"stop\" [s]": 2}
    lines = ["%-38s" % "median (least to most)" + "".join("%-26s" % variant for variant in trees)]
    for name, value in rows.items():
        lines.append("%-38s" % name + "".join(
            "%-26s" % _middle([value(tree) for tree in every], digits.get(name, 0)) for every in trees.values()))
    return "\n".join(lines)
