"""Kills services at random during a drive, and sees how they come back."""

import os
import random
import signal
import time

# The topic that tells that a service works again; where offloading is on, detections are the coordinator's.
TOPICS = {"vio": "/odometry", "obstacles": "/obstacles", "ssd": "/detections", "coordinator": "/detections",
          "tracker": "/tracks", "navigation": "/motion/navigation", "reaction": "/motion/reaction",
          "command": "/motion/command", "arbiter": "/motion", "chassis": "/vehicle_state", "power": "/power",
          "recognizer": "/diagnostics", "vehicle_manager": "/motion"}
SETTLING_S = 0.15  # what a killed process sent has arrived by then; no process is started again sooner
FIRST_S = 4.0      # after the begin of the drive
LEAST_S, MOST_S = 3.0, 6.0
LOST_S = 20.0      # not back for so long


class Killer:
    def __init__(self, count, seed, observer):
        self._left = count
        self._random = random.Random(seed)
        self._observer = observer
        self._due = None
        self._open = None
        self._killed_at = 0.0
        self.kills = []

    @property
    def done(self):
        return self._left == 0 and self._open is None

    def begin(self, now):
        self._due = now + FIRST_S

    def tick(self, now, pids, speed):
        """@param pids  {node: pid} as they are now."""
        if self._open is not None:
            # The recogniser has no steady topic: it listens again, as its diagnostics say.
            listens = self._open["node"] == "recognizer" and self._recognizer_listens(now)
            if listens:
                self.came_back(("/diagnostics", 0.0, self._open, now))
            elif now - self._open["time"] > LOST_S:
                self._close(now)
            return
        if self._left == 0 or self._due is None or now < self._due:
            return
        candidates = sorted(name for name in pids if name in TOPICS)
        if not candidates:
            return
        node = self._random.choice(candidates)
        kill = {"node": node, "time": now, "speed": speed, "back_s": None, "stopped": False}
        self._open = kill
        self._killed_at = time.monotonic()  # a process takes its time on the wall to start, simulated time may wait
        self._left -= 1
        self.kills.append(kill)
        self._observer.records.statuses.pop("recognizer: recognition", None)
        if node != "recognizer":
            self._observer.await_message(TOPICS[node], now + SETTLING_S, kill)
        try:
            os.kill(pids[node], signal.SIGKILL)
        except ProcessLookupError:
            kill["note"] = "had ended already"

    def _recognizer_listens(self, now):
        status = self._observer.records.statuses.get("recognizer: recognition")
        return now - self._open["time"] > SETTLING_S and status is not None and status[2].get("state") == "listening"

    def came_back(self, event):
        _, _, kill, arrival = event
        if kill is self._open:
            kill["back_s"] = time.monotonic() - self._killed_at
            self._close(arrival)

    def _close(self, now):
        self._open = None
        self._due = now + self._random.uniform(LEAST_S, MOST_S)


def finish(kills, states):
    """Adds whether the vehicle stopped within 3 s of each kill. @param states  of the simulator: stamp and speed."""
    for kill in kills:
        after = [state["speed"] for state in states if kill["time"] <= state["stamp"] <= kill["time"] + 3.0]
        kill["stopped"] = bool(after) and kill["speed"] > 0.1 and min(after) < 0.05
        kill["least_speed"] = min(after) if after else None
    return kills

