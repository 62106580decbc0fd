#!/usr/bin/python3
"""Judge of diagnostics.test."""

import threading
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

OK, WARN, ERROR, STALE = 0, 1, 2, 3
TIMEOUT_S = 60.0
PERIOD_S = 0.5
# Status as its node names it, and where it must be in the tree.
TREE = {
    "left_camera: driver": "/Vehicle/Sensors/left_camera: driver",
    "imu: driver": "/Vehicle/Sensors/imu: driver",
    "microphone: microphone": "/Vehicle/Sensors/microphone: microphone",
    "joystick: joystick": "/Vehicle/Sensors/joystick: joystick",
    "vio: odometry": "/Vehicle/Localisation/odometry",
    "vio: map": "/Vehicle/Localisation/map",
    "ssd: detection": "/Vehicle/Perception/ssd: detection",
    "obstacles: obstacles": "/Vehicle/Perception/obstacles: obstacles",
    "runtime: scheduler": "/Vehicle/Perception/runtime: scheduler",
    "recognizer: recognition": "/Vehicle/Speech/recognition",
    "navigation: navigation": "/Vehicle/Decision/navigation: navigation",
    "reaction: reaction": "/Vehicle/Decision/reaction: reaction",
    "command: command": "/Vehicle/Decision/command: command",
    "arbiter: arbiter": "/Vehicle/Decision/arbiter: arbiter",
    "arbiter: sources": "/Vehicle/Decision/arbiter: sources",
    "chassis: chassis": "/Vehicle/Chassis/chassis",
    "chassis: line": "/Vehicle/Chassis/line",
    "chassis: battery": "/Vehicle/Chassis/battery",
    "coordinator: offloading": "/Vehicle/Edge/coordinator: offloading",
    "edge_server_gate: edge server": "/Vehicle/Edge/edge_server_gate: edge server",
    "recorder: recorder": "/Vehicle/Recording/recorder",
    "power: services": "/Vehicle/Power/services",
    "web_view: clients": "/Vehicle/Web/clients",
    "pi_os_bridge: peers": "/Vehicle/Transport/pi_os_bridge: peers",
    "stranger: part": "/Vehicle/Other/stranger: part",
}
GROUPS = {path.rsplit("/", 1)[0] for path in TREE.values()}


def level(status):
    """As a number, whatever the version of the messages makes of a byte."""
    return status.level[0] if isinstance(status.level, bytes) else status.level


class Diagnostics(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.tree, cls.top, cls.levels = {}, None, {}
        cls.publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)
        cls.subscribers = [rospy.Subscriber("/diagnostics_agg", DiagnosticArray, cls.on_tree),
                           rospy.Subscriber("/diagnostics_toplevel_state", DiagnosticStatus, cls.on_top)]
        cls.timer = rospy.Timer(rospy.Duration(PERIOD_S), cls.publish)

    @classmethod
    def publish(cls, _):
        with cls.changed:
            levels = dict(cls.levels)
        message = DiagnosticArray(status=[DiagnosticStatus(name=name, level=value, message="from the test")
                                          for name, value in levels.items()])
        message.header.stamp = rospy.Time.now()
        cls.publisher.publish(message)

    @classmethod
    def on_tree(cls, message):
        with cls.changed:
            cls.tree = {status.name: level(status) for status in message.status}
            cls.changed.notify_all()

    @classmethod
    def on_top(cls, message):
        with cls.changed:
            cls.top = level(message)
            cls.changed.notify_all()

    def say(self, levels):
        with self.changed:
            type(self).levels = levels

    def await_tree(self, fits, what):
        with self.changed:
            self.assertTrue(self.changed.wait_for(lambda: fits(self.tree), TIMEOUT_S),
                            "%s; the tree: %s, top: %s" % (what, self.tree, self.top))

    def test_1_expected_statuses_that_never_came_are_stale(self):
        self.say({"power: services": OK})
        self.await_tree(lambda tree: tree.get("/Vehicle/Chassis/line") == STALE
                        and tree.get("/Vehicle/Localisation/odometry") == STALE
                        and tree.get("/Vehicle/Localisation") == STALE, "what is expected is stale")

    def test_2_every_status_is_in_its_group(self):
        self.say(dict.fromkeys(TREE, OK))
        self.await_tree(lambda tree: all(tree.get(path) == OK for path in TREE.values()), "all are there")
        self.await_tree(lambda tree: all(tree.get(group) == OK for group in GROUPS), "all groups are well")
        self.await_tree(lambda _: self.top == OK, "the vehicle is well")

    def test_3_the_worst_counts(self):
        self.say(dict(dict.fromkeys(TREE, OK), **{"power: services": WARN}))
        self.await_tree(lambda tree: tree.get("/Vehicle/Power") == WARN and self.top == WARN, "a warning")
        self.say(dict(dict.fromkeys(TREE, OK), **{"ssd: detection": ERROR}))
        self.await_tree(lambda tree: tree.get("/Vehicle/Perception") == ERROR and tree.get("/Vehicle/Power") == OK
                        and self.top == ERROR, "an error")

    def test_4_what_ceases_is_an_error(self):
        self.say(dict.fromkeys(TREE, OK))
        self.await_tree(lambda tree: self.top == OK, "the vehicle is well")
        self.say({name: OK for name in TREE if name != "ssd: detection"})
        self.await_tree(lambda tree: tree.get("/Vehicle/Perception/ssd: detection") == STALE
                        and tree.get("/Vehicle/Perception") == ERROR and self.top == ERROR, "stale")


if __name__ == "__main__":
    rospy.init_node("diagnostics_test")
    rostest.rosrun("pi_bringup", "diagnostics", Diagnostics)
