"""What the nodes tell while a part of the demo runs."""

import json
import os
import queue
import select
import sys
import threading
import time

from first_drive.errors import DemoError
from first_drive.processes import log_excerpt

SILENCE_LIMIT_S = 90  # software rendering on a loaded machine starts slowly


def player_event(message):
    return "player", json.loads(message.data)


class Events:
    """A rospy node on the master in `environment`. What it subscribes becomes events (kind, content) that wait in a
    queue; from the start it hears the status of a drive's player and the reports of the monitor."""

    def __init__(self, environment, name="drive_demo"):
        os.environ.update({key: environment[key]
                           for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_LOG_DIR", "ROS_PACKAGE_PATH")})
        # The suite's own messages, whatever the shell of the user has or has not sourced.
        sys.path[:0] = [folder for folder in environment.get("PYTHONPATH", "").split(os.pathsep) if folder]
        # Here, not above: rospy reads the environment when it is imported, and takes a second.
        import rospy
        from std_msgs.msg import String
        rospy.init_node(name, disable_signals=True)
        self.rospy = rospy
        self._events = queue.Queue()
        self._log_path = None
        self._subscribers = []
        self.subscribe("/player/status", String, player_event)
        self.subscribe("/topic_monitor/report", String, lambda message: ("monitor", json.loads(message.data)))

    def put(self, kind, content):
        """An event of another source; from any thread."""
        self._events.put((kind, content))

    def subscribe(self, topic, message_type, event):
        """@param event  makes an event (kind, content) of a message, or None of one that does not count; called on
        threads of rospy.
        @return rospy's subscriber"""
        def put(message):
            made = event(message)
            if made is not None:
                self._events.put(made)

        self._subscribers.append(self.rospy.Subscriber(topic, message_type, put))
        return self._subscribers[-1]

    def follow(self, process, name="roslaunch"):
        """From now on, events are those of this process, a node or roslaunch with its nodes, which next() watches
        too. @param name  of it, for the user."""
        self._events = queue.Queue()
        self._log_path = process.log_path
        self.watch(process, name)

    def watch(self, process, name):
        """From now on, next() watches this process too, which logs to the same file as the one followed."""
        threading.Thread(target=self._await_end, args=(self._events, (name, process), os.pidfd_open(process.pid)),
                         daemon=True).start()

    @staticmethod
    def _await_end(events, content, descriptor):
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        poll.poll()
        os.close(descriptor)
        events.put(("ended", content))

    def next(self, condition, purpose):
        """The next event (kind, content) that meets condition(kind, content).
        @throws DemoError if a process that is watched ends, or if nothing that meets the condition came for
        SILENCE_LIMIT_S and no message reached the monitor either."""
        seen = None
        deadline = time.monotonic() + SILENCE_LIMIT_S
        while True:
            try:
                kind, content = self._events.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise DemoError("waited %d s for %s; from the log:\n%s" %
                                (SILENCE_LIMIT_S, purpose, log_excerpt(self._log_path))) from None
            if kind == "ended":
                name, process = content
                status = process.wait()
                raise DemoError("%s ended, %s %d, while waiting for %s; from the log:\n%s" %
                                (name, "signal" if status < 0 else "status", abs(status), purpose,
                                 log_excerpt(self._log_path)))
            if condition(kind, content):
                return kind, content
            if kind == "monitor":
                counts = {name: topic["messages"] for name, topic in content["topics"].items()}
                if counts != seen:
                    seen = counts
                    deadline = time.monotonic() + SILENCE_LIMIT_S

    def close(self):
        self.rospy.signal_shutdown("the demo ends")
