"""Camera, odometry and judge of the test bed's vehicle: a process on the vehicle, steered by lines of JSON.

Each line {"do": NAME, ...} is answered by a line @{"value": ...} or @{"error": ...}.
"""

import itertools
import json
import math
import sys
import threading
import time

import nav_msgs.msg
import pi_detect.msg
import pi_offload.msg
import pi_offload.srv
import pi_speech.msg
import rospy
import sensor_msgs.msg
from PIL import Image, UnidentifiedImageError

from pi_offload.errors import ToolError
from pi_offload.testbed_road import load_road

PICTURE_HZ = 10.0
ODOMETRY_HZ = 20.0
SIZE = (640, 480)
MOST_PICTURES = 100
GRACE_S = 5.0  # after the last picture of a phase, until it counts as never answered
WAIT_S = 90.0
POLL_S = 0.1   # of services that tell a state


def read_pictures(paths):
    """The first of the pictures, as bytes of rgb8 of one size. @throws ToolError"""
    pictures = []
    for path in paths[:MOST_PICTURES]:
        try:
            with Image.open(path) as picture:
                pictures.append(picture.convert("RGB").resize(SIZE, Image.BILINEAR).tobytes())
        except (OSError, UnidentifiedImageError) as error:
            raise ToolError(f"{path}: {error}") from error
    if not pictures:
        raise ToolError("no picture is given")
    return pictures


class Vehicle:
    def __init__(self):
        self._changed = threading.Condition()
        self._road = None
        self._drive_began = None  # of CLOCK_MONOTONIC [s]; None: stands at _place
        self._place = (0.0, 0.0, 0.0)
        self._taken = []          # pictures of the phase, as stamps [ns]
        self._results = []
        self._decisions = []
        self._commands = []
        self._recording = False
        self._phase_ns = [0, 0]   # begin and end; what has another stamp is none of the phase's
        self._count = 0           # of detection decisions, ever
        self._remote_row = (None, 0)
        self._publishers = {}

    # ------------------------------------------------------------------------------------------------------- the graph

    @staticmethod
    def parameters(name, tree):
        """Sets those of a node."""
        rospy.set_param("/" + name, tree)

    def start(self, pictures, scenario):
        """Camera and odometry begin, and results are listened to."""
        frames = read_pictures(pictures)
        self._road = load_road(scenario)
        self._publishers = {"image": rospy.Publisher("image", sensor_msgs.msg.Image, queue_size=2),
                            "odometry": rospy.Publisher("odometry", nav_msgs.msg.Odometry, queue_size=2)}
        for topic, kind, callback in (
                ("coordinator/decisions", pi_offload.msg.OffloadDecision, self._on_decision),
                ("detections", pi_detect.msg.Detection2DArray, self._on_detections),
                ("command", pi_speech.msg.VoiceCommand, lambda message: self._on_command(message, True)),
                ("recognizer/rejected", pi_speech.msg.VoiceCommand, lambda message: self._on_command(message, False))):
            rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)
        for run in (lambda: self._run_camera(frames), self._run_odometry):
            threading.Thread(target=run, daemon=True).start()

    @staticmethod
    def _ticks(rate_hz):
        begin = time.monotonic()
        for i in itertools.count(1):
            yield
            time.sleep(max(begin + i / rate_hz - time.monotonic(), 0.0))

    def _run_camera(self, frames):
        for _, frame in zip(self._ticks(PICTURE_HZ), itertools.cycle(frames)):
            image = sensor_msgs.msg.Image(height=SIZE[1], width=SIZE[0], encoding="rgb8", step=3 * SIZE[0], data=frame)
            image.header.frame_id = "camera"
            with self._changed:
                image.header.stamp = rospy.Time.now()
                if self._recording and self._of_phase(image.header.stamp.to_nsec()):
                    self._taken.append(image.header.stamp.to_nsec())
                    self._changed.notify_all()
            self._publishers["image"].publish(image)

    def _run_odometry(self):
        for _ in self._ticks(ODOMETRY_HZ):
            x, y, yaw = self.position(time.monotonic())
            message = nav_msgs.msg.Odometry(child_frame_id="base_link")
            message.header.frame_id = "map"
            message.header.stamp = rospy.Time.now()
            message.pose.pose.position.x, message.pose.pose.position.y = x, y
            message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
            message.twist.twist.linear.x = self._road.speed if self._drive_began is not None else 0.0
            self._publishers["odometry"].publish(message)

    def position(self, now):
        began = self._drive_began
        return self._place if began is None else self._road.at((now - began) * self._road.speed)

    def _of_phase(self, stamp_ns):
        return self._phase_ns[0] <= stamp_ns <= self._phase_ns[1]

    def _on_decision(self, message):
        decision = {"kind": message.kind, "stamp": message.header.stamp.to_nsec(), "node": message.node,
                    "how": message.how, "reason": message.reason, "deadline_s": message.deadline,
                    "response_s": message.response_time}
        with self._changed:
            if self._recording and self._of_phase(decision["stamp"]):
                self._decisions.append(decision)
            if message.kind == "detection":
                self._count += 1
            if message.kind == "detection" and self._of_phase(decision["stamp"]):
                before, row = self._remote_row
                remote = message.node if message.how == "remote" else None
                self._remote_row = (remote, row + 1 if remote == before else 1)
            self._changed.notify_all()

    def _on_detections(self, message):
        now = rospy.Time.now()
        stamp = message.header.stamp.to_nsec()
        with self._changed:
            if self._recording and self._of_phase(stamp):
                self._results.append((stamp, 1e-9 * (now.to_nsec() - stamp)))
                self._changed.notify_all()

    def _on_command(self, message, accepted):
        with self._changed:
            if self._recording:
                self._commands.append((message.speech_start.to_nsec(), message.text, accepted,
                                       message.latency.to_sec()))

    # ------------------------------------------------------------------------------------------------------ the judge

    def _await(self, reached, what, timeout_s=WAIT_S):
        with self._changed:
            if not self._changed.wait_for(reached, timeout_s):
                raise ToolError(f"not within {timeout_s:.0f} s: {what}")

    def await_nodes(self, names):
        """Until the coordinator is connected to all of them."""
        rospy.wait_for_service("coordinator/nodes", WAIT_S)
        ask = rospy.ServiceProxy("coordinator/nodes", pi_offload.srv.Nodes)
        deadline = time.monotonic() + WAIT_S
        while True:
            missing = set(names) - {status.node.id for status in ask().nodes if status.connected}
            if not missing:
                return
            if time.monotonic() > deadline:
                raise ToolError(f"no connection to {', '.join(sorted(missing))} within {WAIT_S:.0f} s")
            time.sleep(POLL_S)

    def await_detections(self, count):
        """Until so many more pictures were decided on."""
        goal = self._count + count
        self._await(lambda: self._count >= goal, f"{count} detections")

    def await_remote(self, count):
        """Until the last so many pictures of the phase were done by one node. @return it"""
        self._await(lambda: self._remote_row[0] and self._remote_row[1] >= count,
                    f"{count} detections in a row by a node; the last decisions: {self._decisions[-3:]}")
        return self._remote_row[0]

    def policy(self, name):
        """@return that of before"""
        change = rospy.ServiceProxy("coordinator/set_policy", pi_offload.srv.SetPolicy)
        before = change(policy="", miss_cost=0.0).policy
        answer = change(policy=name, miss_cost=0.0)
        if not answer.success:
            raise ToolError(answer.message)
        return before

    def stand(self, x, y):
        self._place, self._drive_began = (x, y, 0.0), None

    def drive(self, began):
        """@param began  of CLOCK_MONOTONIC, when the vehicle was at the begin of the route [s]"""
        self._drive_began = began

    def begin(self):
        """A phase begins; pictures taken from now on are its own."""
        with self._changed:
            self._taken, self._results, self._decisions, self._commands = [], [], [], []
            self._recording, self._phase_ns = True, [rospy.Time.now().to_nsec(), sys.maxsize]
            self._remote_row = (None, 0)

    def await_pictures(self, count):
        """Until so many were taken in the phase."""
        self._await(lambda: len(self._taken) >= count, f"{count} pictures", WAIT_S + count / PICTURE_HZ)

    def end(self):
        """No more pictures for the phase; waits for results that are still missing. @return all of the phase"""
        with self._changed:
            self._phase_ns[1] = rospy.Time.now().to_nsec()
            taken = self._taken
            self._changed.wait_for(
                lambda: set(taken) <= {stamp for stamp, _ in self._results}
                and set(taken) <= {d["stamp"] for d in self._decisions}, GRACE_S)
            self._recording = False
            return {"pictures": taken, "results": self._results, "decisions": self._decisions,
                    "commands": self._commands}


def main():
    rospy.init_node("testbed_vehicle", disable_signals=True)
    vehicle = Vehicle()
    for line in sys.stdin:
        request = json.loads(line)
        try:
            answer = {"value": getattr(vehicle, request.pop("do"))(**request)}
        except (ToolError, rospy.ROSException, rospy.ServiceException) as error:
            answer = {"error": str(error)}
        print("@" + json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
