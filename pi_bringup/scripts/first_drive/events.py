"""What player and monitor tell while a drive runs."""

import json
import os
import queue
import select
import threading
import time

from first_drive.errors import DemoError
from first_drive.processes import log_excerpt

SILENCE_LIMIT_S = 90  # software rendering on a loaded machine starts slowly


class Events:
    """Listens as a rospy node to the player's status and the monitor's reports, on the master in `environment`."""

    def __init__(self, environment):
        os.environ.update({key: environment[key]
                           for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_LOG_DIR", "ROS_PACKAGE_PATH")})
        # Here, not above: rospy reads the environment when it is imported, and takes a second.
        import rospy
        from diagnostic_msgs.msg import DiagnosticStatus
        from std_msgs.msg import String
        rospy.init_node("drive_demo", disable_signals=True)
        self._rospy = rospy
        self._events = queue.Queue()
        self._launch = None
        self._subscribers = [
            rospy.Subscriber("/player/status", DiagnosticStatus, self._on_player),
            rospy.Subscriber("/topic_monitor/report", String,
                             lambda message: self._events.put(("monitor", json.loads(message.data))))]

    def _on_player(self, message):
        values = {pair.key: pair.value for pair in message.values}
        self._events.put(("player", {
            "state": message.message,
            "published": {key.split(" ", 1)[1]: int(value) for key, value in values.items()
                          if key.startswith("published ")},
            "lateness": {key: float(value) for key, value in values.items() if "late" in key}}))

    def follow(self, launch):
        """From now on, events are those of the nodes of this roslaunch process, which next() watches too."""
        self._launch = launch
        self._events = queue.Queue()
        threading.Thread(target=self._await_end, args=(self._events, os.pidfd_open(launch.pid)), daemon=True).start()

    @staticmethod
    def _await_end(events, descriptor):
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        poll.poll()
        os.close(descriptor)
        events.put(("launch", None))

    def next(self, condition, purpose):
        """The next event (kind, content) that meets condition(kind, content), kind being "player" or "monitor".
        @throws DemoError if roslaunch ends, or if for SILENCE_LIMIT_S no message reached the monitor either."""
        seen = None
        deadline = time.monotonic() + SILENCE_LIMIT_S
        while True:
            try:
                kind, content = self._events.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise DemoError("waited %d s for %s; from the log:\n%s" %
                                (SILENCE_LIMIT_S, purpose, log_excerpt(self._launch.log_path))) from None
            if kind == "launch":
                raise DemoError("the nodes ended while waiting for %s; from the log:\n%s" %
                                (purpose, log_excerpt(self._launch.log_path)))
            if condition(kind, content):
                return kind, content
            if kind == "monitor":
                counts = {name: topic["messages"] for name, topic in content["topics"].items()}
                if counts != seen:
                    seen = counts
                    deadline = time.monotonic() + SILENCE_LIMIT_S

    def close(self):
        self._rospy.signal_shutdown("drive_demo ends")
