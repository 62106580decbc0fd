"""What the graph says during a drive: kept, and as events for the one who drives."""

import math
import struct
from dataclasses import dataclass, field

from .unplugs import text_of

ODOMETRY_EVERY = 10  # of 200 Hz
TRUTH_EVERY = 5      # of 50 Hz
MAP_FRAME = b"\x03\x00\x00\x00map"
TRANSFORM_BYTES = len(MAP_FRAME) + 4 + len("odom") + 7 * 8  # of a transform, from the parent's name on
ERROR_LEVEL = 8      # of rosgraph_msgs/Log
# rviz says this of its own shader when it shows its first nav_msgs/OccupancyGrid, and shows it right (ros2/rviz#463).
MAP_SHADER = ("rviz/glsl120/indexed_8bit_image.frag",
              "active samplers with a different type refer to the same texture image unit")
VIO_STATUS, VIO_INPUTS = "vio: odometry", "vio: inputs"


def is_of_map_shader(message):
    return message.name == "/rviz" and all(part in message.msg for part in MAP_SHADER)


@dataclass
class Records:
    """Lists in the order of arrival; times are simulated [s]."""

    estimates: list = field(default_factory=list)    # (stamp, x, y, heading) of base_link in the map
    corrections: list = field(default_factory=list)  # (time, x, y, heading) of odom in the map, when it changes
    validity: list = field(default_factory=list)     # (stamp, valid, reason) of the pose in the map
    motions: list = field(default_factory=list)      # (arrival, stamp, speed, source, reason)
    states: list = field(default_factory=list)       # (arrival, speed, mode, detail)
    commands: list = field(default_factory=list)     # dicts
    command_states: list = field(default_factory=list)
    arbiter: list = field(default_factory=list)      # (stamp, driver, limited_by, reason)
    feedback: list = field(default_factory=list)     # (arrival, progress, state, reason)
    reactions: list = field(default_factory=list)    # dicts
    played: list = field(default_factory=list)       # dicts
    decisions: list = field(default_factory=list)    # dicts
    power: list = field(default_factory=list)        # dicts
    obstacles: list = field(default_factory=list)    # messages as they came, see reported_obstacles()
    detections: list = field(default_factory=list)   # likewise, see reported_labels()
    labels: dict = field(default_factory=dict)       # class id: name
    pairs: list = field(default_factory=list)        # (time, pairs of pictures that localisation used so far)
    errors: list = field(default_factory=list)       # (time, node, text) of the log
    statuses: dict = field(default_factory=dict)     # name: (level, message, values), as last said
    reports: list = field(default_factory=list)      # dicts: what a status says, when its level or text changes
    arrivals: dict = field(default_factory=dict)     # topic: time of the last message


def heading_of(q):
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def compose(outer, inner):
    """Poses [x, y, heading]."""
    cosine, sine = math.cos(outer[2]), math.sin(outer[2])
    heading = outer[2] + inner[2]
    return (outer[0] + cosine * inner[0] - sine * inner[1], outer[1] + sine * inner[0] + cosine * inner[1],
            math.atan2(math.sin(heading), math.cos(heading)))


def power_figures(message):
    """Of pi_vehicle/PowerState."""
    def service(one):
        return {"cpu": one.cpu, "memory": one.memory, "watts": one.watts, "running": bool(one.running)}

    services = {one.name: service(one) for one in message.services}
    services["shared"] = service(message.shared)
    return {"services": services, "other_cpu": message.other.cpu, "total_watts": message.total_watts,
            "idle_watts": message.idle_watts, "measured": bool(message.measured), "source": message.source,
            "battery_watts": message.battery_watts, "cpu": message.cpu}


class Observer:
    """Subscribes by `events`; what drives the one who drives becomes events: truth, result, feedback, diagnostics,
    played, command. Its callbacks are those of rospy's threads."""

    def __init__(self, events, subscribe=None, now=None, odometry_every=ODOMETRY_EVERY):
        """@param subscribe  as rospy.Subscriber, for what does not come from the graph. @param now  its time [s]"""
        # Here, not above: they import rospy.
        import rospy
        from actionlib_msgs.msg import GoalStatusArray
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry
        from pi_detect.msg import LabelArray
        from pi_simulation.msg import PlayedSound
        from pi_vehicle.msg import (ArbiterState, CommandState, DriveActionFeedback,
                                    DriveActionResult, LocalisationState, MotionCommand, PowerState,
                                    ReactionEvent, VehicleState)
        from pi_speech.msg import VoiceCommand
        from rosgraph_msgs.msg import Log
        from std_msgs.msg import String
        from tf2_msgs.msg import TFMessage
        self.records = Records()
        self.map_odom = None
        self.truth = None       # (time, x, y, heading, speed)
        self.estimate = None
        self._events = events
        self.now = now or rospy.get_time
        subscribe = subscribe or rospy.Subscriber
        self._odometry_type, self._tf_type = Odometry, TFMessage
        self._counts = {}
        self._odometry_every = odometry_every
        self._map_transform = b""
        self._links = {}
        self._awaited = {}      # topic: (time, mark)
        self._said = {}         # name of a status: (level, text)
        any_message = rospy.AnyMsg
        for topic, kind, callback in (
                ("/odometry", any_message, self._on_odometry), ("/tf", any_message, self._on_tf),
                ("/ground_truth/odometry", any_message, self._on_truth),
                ("/localisation", LocalisationState, lambda m: self.records.validity.append(
                    (m.header.stamp.to_sec(), bool(m.valid), m.reason))),
                ("/obstacles", any_message, lambda m: self.records.obstacles.append(m._buff)),
                ("/detections", any_message, lambda m: self.records.detections.append(m._buff)),
                ("/labels", LabelArray, self._on_labels), ("/local/labels", LabelArray, self._on_labels),
                ("/tracks", any_message, None),
                ("/motion/navigation", any_message, None), ("/motion/reaction", any_message, None),
                ("/motion/command", any_message, None),
                ("/motion", MotionCommand, self._on_motion), ("/vehicle_state", VehicleState, self._on_state),
                ("/command", VoiceCommand, lambda m: self._on_command(m, True)),
                ("/recognizer/rejected", VoiceCommand, lambda m: self._on_command(m, False)),
                ("/command/state", CommandState, self._on_command_state),
                ("/arbiter/state", ArbiterState, self._on_arbiter),
                ("/reaction/events", ReactionEvent, self._on_reaction),
                ("/microphone/played", PlayedSound, self._on_played),
                ("/power", PowerState, self._on_power), ("/diagnostics", DiagnosticArray, self._on_diagnostics),
                ("/scenario", String, lambda m: events.put("scenario", m.data)),
                ("/drive/feedback", DriveActionFeedback, self._on_feedback),
                ("/drive/result", DriveActionResult, self._on_result),
                ("/drive/status", GoalStatusArray, None), ("/rosout_agg", Log, self._on_log)):
            self._links[topic] = subscribe(topic, kind, self._callback(topic, callback), tcp_nodelay=True)
        try:
            from pi_offload.msg import OffloadDecision
            self._links["/coordinator/decisions"] = subscribe(
                "/coordinator/decisions", OffloadDecision, self._callback("/coordinator/decisions", self._on_decision))
        except ImportError:
            pass  # without pi_offload nothing is offloaded

    def _callback(self, topic, callback):
        def take(message):
            now = self.now()
            self.records.arrivals[topic] = now
            awaited = self._awaited.get(topic)
            if awaited is not None and now > awaited[0]:
                del self._awaited[topic]
                self._events.put("back", (topic, *awaited, now))
            if callback is not None:
                callback(message)
        return take

    def await_message(self, topic, after, mark):
        """The first message on a topic later than a time becomes an event back: (topic, after, mark, arrival)."""
        self._awaited[topic] = (after, mark)

    def close(self):
        for link in self._links.values():
            link.unregister()

    def _every(self, name, count):
        self._counts[name] = self._counts.get(name, -1) + 1
        return self._counts[name] % count == 0

    # ------------------------------------------------------------------------------------------------- localisation

    def _on_odometry(self, message):
        if self.map_odom is None or not self._every("odometry", self._odometry_every):
            return
        odometry = self._odometry_type().deserialize(message._buff)
        p = odometry.pose.pose.position
        pose = compose(self.map_odom, (p.x, p.y, heading_of(odometry.pose.pose.orientation)))
        self.estimate = (odometry.header.stamp.to_sec(), *pose)
        self.records.estimates.append(self.estimate)

    def _on_tf(self, message):
        # Messages come at the rate of the IMU; map to odom is in some of them, and changes rarely: what is behind the
        # frame's name is compared before it is read.
        begin = message._buff.find(MAP_FRAME)
        content = message._buff[begin:begin + TRANSFORM_BYTES] if begin >= 0 else None
        if content is None or content == self._map_transform:
            return
        self._map_transform = content
        for one in self._tf_type().deserialize(message._buff).transforms:
            if one.header.frame_id.strip("/") == "map" and one.child_frame_id.strip("/") == "odom":
                t = one.transform
                pose = (t.translation.x, t.translation.y, heading_of(t.rotation))
                if pose != self.map_odom:
                    self.records.corrections.append((self.now(), *pose))
                self.map_odom = pose

    def _on_truth(self, message):
        if not self._every("truth", TRUTH_EVERY):
            return
        odometry = self._odometry_type().deserialize(message._buff)
        p = odometry.pose.pose.position
        self.truth = (odometry.header.stamp.to_sec(), p.x, p.y, heading_of(odometry.pose.pose.orientation),
                      odometry.twist.twist.linear.x)
        self._events.put("truth", self.truth)

    # ----------------------------------------------------------------------------------------------------- decision

    def _on_motion(self, message):
        self.records.motions.append((self.now(), message.header.stamp.to_sec(), message.speed, message.source,
                                     message.reason))

    def _on_state(self, message):
        self.records.states.append((self.now(), message.speed, message.mode, message.detail))

    def _on_command(self, message, accepted):
        command = {"arrival": self.now(), "text": message.text, "accepted": accepted,
                   "confidence": round(message.confidence, 3), "speech_end": message.speech_end.to_sec(),
                   "latency": message.latency.to_sec(), "fast": bool(message.fast)}
        self.records.commands.append(command)
        self._events.put("command", command)

    def _on_command_state(self, message):
        self.records.command_states.append(
            {"arrival": self.now(), "stamp": message.header.stamp.to_sec(), "stopped": bool(message.stopped),
             "text": message.text, "outcome": message.outcome, "reason": message.reason})

    def _on_arbiter(self, message):
        self.records.arbiter.append((message.header.stamp.to_sec(), message.driver, message.limited_by,
                                     message.reason))

    def _on_reaction(self, message):
        self.records.reactions.append({"stamp": message.header.stamp.to_sec(), "rule": message.rule,
                                       "action": message.action, "text": message.text, "label": message.label,
                                       "position": [round(message.position.x, 2), round(message.position.y, 2)]})

    def _on_feedback(self, message):
        f = message.feedback
        self.records.feedback.append((self.now(), f.progress, f.state, f.reason))

    def _on_result(self, message):
        self._events.put("result", {
            "status": message.status.status, "success": bool(message.result.success),
            "message": message.result.message or message.status.text, "distance": message.result.distance,
            "duration": message.result.duration.to_sec(), "goal": message.status.goal_id.id})

    # ------------------------------------------------------------------------------------------------------- others

    def _on_played(self, message):
        played = {"file": message.file, "begin": message.header.stamp.to_sec(),
                  "speech_end": message.speech_end.to_sec(), "end": message.end.to_sec()}
        self.records.played.append(played)
        self._events.put("played", played)

    def _on_decision(self, message):
        self.records.decisions.append({"stamp": message.header.stamp.to_sec(), "kind": message.kind,
                                       "node": message.node, "how": message.how, "reason": message.reason,
                                       "response_time": message.response_time, "by_deadline": bool(message.by_deadline),
                                       "energy": message.energy, "expected_time": message.expected_time,
                                       "expected_energy": message.expected_energy, "hedged": bool(message.hedged),
                                       "dropped": bool(message.dropped)})

    def _on_power(self, message):
        self.records.power.append({"time": self.now(), **power_figures(message)})

    def _on_diagnostics(self, message):
        for status in message.status:
            name = status.name.strip("/")
            level = struct.unpack("B", status.level)[0] if isinstance(status.level, bytes) else status.level
            values = {pair.key: pair.value for pair in status.values}
            self.records.statuses[name] = (level, status.message, values)
            said = (level, text_of(status.message, values) if level else "")
            if self._said.get(name, (0, "")) != said:
                self._said[name] = said
                self.records.reports.append({"arrival": self.now(), "name": name, "level": level, "text": said[1]})
            if status.name.strip("/") == VIO_STATUS:
                pairs = next((pair.value for pair in status.values if pair.key == "pairs used"), None)
                if pairs is not None:
                    self.records.pairs.append((message.header.stamp.to_sec(), int(pairs)))
        self._events.put("diagnostics", None)

    def reported_obstacles(self):
        """[(stamp, [(x, y)])] in base_link, by stamp."""
        from pi_detect.msg import ObstacleArray
        messages = (ObstacleArray().deserialize(one) for one in self.records.obstacles)
        return sorted((message.header.stamp.to_sec(), [(one.position.x, one.position.y) for one in message.obstacles])
                      for message in messages)

    def _on_labels(self, message):
        self.records.labels.update(zip(message.ids, message.names))

    def reported_labels(self):
        """[(stamp, [(name, score, left, right)])] in columns of the picture, by stamp."""
        from pi_detect.msg import Detection2DArray
        names = self.records.labels
        messages = (Detection2DArray().deserialize(one) for one in self.records.detections)
        return sorted((message.header.stamp.to_sec(),
                       [(names.get(one.results[0].id, "?"), one.results[0].score,
                         one.bbox.center.x - one.bbox.size_x / 2, one.bbox.center.x + one.bbox.size_x / 2)
                        for one in message.detections]) for message in messages)

    def _on_log(self, message):
        if message.level >= ERROR_LEVEL and not is_of_map_shader(message):
            self.records.errors.append((message.header.stamp.to_sec(), message.name, message.msg))
