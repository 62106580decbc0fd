"""Checks of a graph that runs: rates and stamps of the sensors' topics, tf, diagnostics, the vehicle's description."""

import struct
import threading
import time
from dataclasses import dataclass, field

import numpy

from pi_bringup import vehicle as description
from pi_bringup.doctor import vehicle
from pi_bringup.doctor.result import fail, ok, warn

LISTEN_S = 3.0
MOST_AGE_S = 1.0      # of a stamp
SLOW = 0.8            # of the rate that is expected
# What the vehicle's sensors publish [Hz]; the least that the services work well with.
RATES = {"left/image_raw": 15.0, "right/image_raw": 15.0, "imu/data": 150.0, "audio_stamped": 5.0, "odometry": 100.0,
         "vehicle_state": 25.0}
FRAMES = ("map", "odom", "base_link", "left_optical", "right_optical", "imu_link")
ERROR = 2             # of diagnostic_msgs/DiagnosticStatus


@dataclass
class Heard:
    """Of a topic."""
    published: bool = False
    messages: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    ages: list = field(default_factory=list)  # arrival - stamp [s]; none for types without header

    @property
    def rate(self):
        spent = self.last_s - self.first_s
        return (self.messages - 1) / spent if self.messages > 1 and spent > 0.0 else 0.0


def stamp_of(buffer):
    """Stamp [s] of a message that begins with a header: seq, secs, nsecs."""
    _, seconds, nanoseconds = struct.unpack_from("<III", buffer)
    return seconds + 1e-9 * nanoseconds


def judge_topics(heard, expected):
    """@param heard  {topic: Heard}. @param expected  {topic: Hz}"""
    results = []
    for topic, rate in expected.items():
        name = f"topic {topic}"
        one = heard.get(topic, Heard())
        if one.messages == 0:
            state = "is published, but nothing came" if one.published else "is not published"
            results.append(warn(name, state, "start its driver, or look at its log; a vehicle without it needs none"))
            continue
        text = f"{one.rate:.1f} Hz"
        age = sorted(one.ages)[len(one.ages) // 2] if one.ages else None
        if one.messages == 1:
            results.append(warn(name, "a single message came", f"expected are {rate:g} Hz"))
        elif one.rate < SLOW * rate:
            results.append(warn(name, f"{text}, expected are {rate:g} Hz",
                                "look at the driver's rate, the USB port and the load of the computer"))
        elif age is not None and abs(age) > MOST_AGE_S:
            results.append(fail(name, f"{text}, stamps {age:+.1f} s old", "synchronise the clocks, or let the driver "
                                "stamp with ROS's time"))
        else:
            results.append(ok(name, text + (f", stamps {1000 * age:.0f} ms old" if age is not None else "")))
    return results


def judge_tf(edges, frames=FRAMES):
    """@param edges  {child: set of parents}"""
    name = "tf"
    doubled = {child: parents for child, parents in edges.items() if len(parents) > 1}
    if doubled:
        child, parents = sorted(doubled.items())[0]
        return fail(name, f"{child} has several parents: {', '.join(sorted(parents))}", "stop all but one of the nodes "
                    "that publish it")

    def root(frame):
        seen = set()
        while frame in edges and frame not in seen:
            seen.add(frame)
            frame = next(iter(edges[frame]))
        return frame

    known = set(edges) | {parent for parents in edges.values() for parent in parents}
    missing = [frame for frame in frames if frame not in known]
    if missing:
        return warn(name, f"there is no {', '.join(missing)}", "map and odom come from localisation, the others from "
                    "the mounts of the vehicle's description, by robot_state_publisher")
    roots = sorted({root(frame) for frame in frames})
    if len(roots) > 1:
        return fail(name, f"the tree is in {len(roots)} parts: {', '.join(roots)}",
                    "the transform between them is missing")
    return ok(name, f"{len(known)} frames below {roots[0]}")


def judge_diagnostics(levels):
    """@param levels  {name: (level, message)}"""
    name = "diagnostics"
    if not levels:
        return warn(name, "nobody reports", "start the nodes")
    bad = sorted(entry for entry, (level, _) in levels.items() if level >= ERROR)
    if bad:
        shown = "; ".join(f"{entry}: {levels[entry][1]}" for entry in bad[:3])
        more = f" and {len(bad) - 3} more" if len(bad) > 3 else ""
        return fail(name, f"{len(bad)} error(s): {shown}{more}", "do what they say")
    warned = sorted(entry for entry, (level, _) in levels.items() if level == 1)
    if warned:
        return warn(name, f"{len(warned)} warning(s), as {warned[0]}: {levels[warned[0]][1]}", "do what they say")
    return ok(name, f"{len(levels)} statuses, all are well")


def matrix_of(transform):
    """4x4 of a geometry_msgs/Transform."""
    x, y, z, w = transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w
    matrix = numpy.eye(4)
    matrix[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    matrix[:3, 3] = transform.translation.x, transform.translation.y, transform.translation.z
    return matrix


def poses_in(base, edges, transforms):
    """@param edges  as of judge_tf(). @param transforms  {child: 4x4 in its parent}
    @return {frame: 4x4 in base} of the frames below base"""
    poses = {}
    for frame in transforms:
        pose, above, seen = numpy.eye(4), frame, set()
        while above in transforms and above != base and above not in seen:
            seen.add(above)
            pose = transforms[above] @ pose
            above = next(iter(edges[above]))
        if above == base and frame != base:
            poses[frame] = pose
    return poses


class Listener:
    """Everything that is heard of a graph for a while. rospy's node of this process must be initialised."""

    def __init__(self, topics):
        import diagnostic_msgs.msg
        import rospy
        import sensor_msgs.msg
        import tf2_msgs.msg
        self._rospy = rospy
        self._lock = threading.Lock()
        self.heard = {topic: Heard() for topic in topics}
        self.edges, self.transforms, self.infos, self.levels = {}, {}, {}, {}
        published = {topic for topic, _ in rospy.get_published_topics()}
        for topic, one in self.heard.items():
            one.published = rospy.resolve_name(topic) in published
        self._subscribers = [rospy.Subscriber(topic, rospy.AnyMsg, self._on_message, topic, queue_size=1000,
                                              tcp_nodelay=True) for topic in topics]
        self._subscribers += [
            rospy.Subscriber("/tf", tf2_msgs.msg.TFMessage, self._on_tf),
            rospy.Subscriber("/tf_static", tf2_msgs.msg.TFMessage, self._on_tf),
            rospy.Subscriber("/diagnostics", diagnostic_msgs.msg.DiagnosticArray, self._on_diagnostics)]
        self._subscribers += [rospy.Subscriber(side + "/camera_info", sensor_msgs.msg.CameraInfo, self._on_info, side)
                              for side in ("left", "right")]

    def _on_message(self, message, topic):
        now, at = time.monotonic(), self._rospy.Time.now().to_sec()
        # The definition of the type came with the connection; a message that begins otherwise has no stamp.
        definition = (message._connection_header or {}).get("message_definition", "").splitlines()
        fields = [line.split("#")[0].split() for line in definition if line.split("#")[0].strip() and "=" not in line]
        stamped = bool(fields) and fields[0][0] in ("Header", "std_msgs/Header")
        with self._lock:
            one = self.heard[topic]
            one.first_s = one.first_s if one.messages else now
            one.last_s = now
            one.messages += 1
            if stamped and len(message._buff) >= 12:
                one.ages.append(at - stamp_of(message._buff))

    def _on_tf(self, message):
        with self._lock:
            for transform in message.transforms:
                child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
                self.edges.setdefault(child, set()).add(parent)
                self.transforms[child] = matrix_of(transform.transform)

    def _on_info(self, message, side):
        with self._lock:
            self.infos[side] = (message.width, message.height, message.P)

    def _on_diagnostics(self, message):
        with self._lock:
            for status in message.status:
                level = status.level[0] if isinstance(status.level, bytes) else status.level
                self.levels[status.name] = (level, status.message)

    def results(self, expected):
        with self._lock:
            found = [*judge_topics(self.heard, expected), judge_tf(self.edges), judge_diagnostics(self.levels)]
            try:
                about = description.check(self._rospy.get_param("vehicle", None))
            except description.VehicleError as error:
                return found + [fail("vehicle of the graph", f"parameter vehicle: {error}",
                                     "vehicle.launch loads the description; vehicle:=FILE names another one")]
            poses = poses_in("base_link", self.edges, self.transforms)
            return found + [vehicle.judge_mounts(about, poses), vehicle.judge_camera_info(about, self.infos)]


def join_graph():
    """Makes this process a node, once."""
    import rospy
    if not rospy.core.is_initialized():
        rospy.init_node("pi_edge_doctor", anonymous=True, disable_signals=True)


def check_live(expected=None, listen_s=LISTEN_S):
    """@param expected  {topic: Hz}"""
    from pi_bringup.doctor import software
    name = "live graph"
    master = software.check_master()
    if master.level != "OK":
        return fail(name, "there is none: the ROS master " + master.text, "start the vehicle first")
    join_graph()
    expected = RATES if expected is None else expected
    listener = Listener(expected)
    time.sleep(listen_s)  # how long it listens is what the rates are measured by
    return listener.results(expected)
