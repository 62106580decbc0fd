"""Pictures during a drive: the screen, what the detector sees, when the runtime ran what."""

import json
import subprocess
import threading

from . import plots

PERSON = "person"
LEAST_HEIGHT_PX = 55     # of a person that is near
AHEAD = (0.3, 0.7)       # part of the picture's width, of people on the road
FAST, SLOW = 1.0, 0.3    # [m/s] between them the vehicle brakes
KEPT = 3
LOOKS_S = 1.5            # from then on
APART_S = 4.0            # from one look to the next
PICTURES = 40            # that wait for their detections
VIRTUAL_FRAME_RATE = 2   # [Hz] nobody looks at a virtual screen, but drawing takes processor time from the drive
NICE = 15
CHART_S = 2.0            # longer, and single runs are not seen


def start_rviz(started, screen, package, output, preload):
    """rviz on the screen, at low priority; on a virtual one it draws seldom. @return process"""
    config = package / "rviz" / "vehicle.rviz"
    if screen.virtual:
        text = config.read_text(encoding="utf-8")
        lines = ["    Frame Rate: %d" % VIRTUAL_FRAME_RATE if line.startswith("    Frame Rate:") else line
                 for line in text.splitlines()]
        config = output / "rviz.rviz"
        config.write_text("\n".join(lines) + "\n", encoding="utf-8")
    environment = ["DISPLAY=%s" % screen.rviz_display, "QT_QPA_PLATFORM=xcb"]
    if preload:
        environment.append("LD_PRELOAD=%s" % preload)
    return started.start(["env", *environment, "nice", "-n", NICE, "rviz", "-d", config, "__name:=rviz"],
                         output / "log" / "rviz.log")


class SeenAhead:
    """Keeps pictures of the left camera with what was detected in them, of the moments when a person is on the road
    ahead or the vehicle comes to stand. The pictures are subscribed only then. Callbacks are those of rospy's
    threads."""

    def __init__(self, rospy):
        # Here, not above: they need the environment of the suite.
        from pi_detect.msg import Detection2DArray, LabelArray
        from sensor_msgs.msg import Image
        self.kept = []          # (stamp, sensor_msgs/Image, [(name, score, left, top, width, height)])
        self.width = 640        # of the pictures [px]; known better with the first one
        self.begun = 0          # moments
        self._rospy = rospy
        self._image = Image
        self._detections = Detection2DArray
        self._labels = {}
        self._lock = threading.Lock()
        self._pictures = {}     # stamp: message
        self._best = None       # of this moment, as those kept
        self._link = None       # to the pictures
        self._until = self._next = 0.0
        self._was_fast = False
        self._links = [rospy.Subscriber(topic, LabelArray, self._on_labels) for topic in ("/labels", "/local/labels")]
        # A topic has one type in a process: the observer's.
        self._links.append(rospy.Subscriber("/detections", rospy.AnyMsg, self._on_detections))

    def close(self):
        for link in self._links:
            link.unregister()
        with self._lock:
            self._end()

    def speed(self, value, now):
        """@param value  of the vehicle [m/s], at each message of it."""
        with self._lock:
            if self._link is not None and now > self._until:
                self._end()
            if value > FAST:
                self._was_fast = True
            elif value < SLOW and self._was_fast:
                self._was_fast = False
                self._look(now)

    def _look(self, now):
        if self._link is None and self.begun < KEPT and now >= self._next:
            self.begun += 1
            self._until, self._next = now + LOOKS_S, now + APART_S
            self._link = self._rospy.Subscriber("/left/image_raw", self._image, self._on_picture)

    def _end(self):
        if self._link is not None:
            self._link.unregister()
            self._link = None
        if self._best is not None:
            self.kept.append(self._best)
            self._best = None
        self._pictures.clear()

    def _on_labels(self, message):
        self._labels = dict(zip(message.ids, message.names))

    def _on_picture(self, message):
        with self._lock:
            self._pictures[message.header.stamp] = message
            self.width = message.width
            if len(self._pictures) > PICTURES:
                del self._pictures[min(self._pictures)]

    def _on_detections(self, buffer):
        message = self._detections().deserialize(buffer._buff)
        with self._lock:
            boxes = [(self._labels.get(one.results[0].id, "?"), one.results[0].score,
                      one.bbox.center.x - one.bbox.size_x / 2, one.bbox.center.y - one.bbox.size_y / 2,
                      one.bbox.size_x, one.bbox.size_y) for one in message.detections]
            if any(self._on_road(box) for box in boxes):
                self._look(self._rospy.get_time())
            picture = self._pictures.get(message.header.stamp)
            if picture is not None and (self._best is None or self._worth(boxes) > self._worth(self._best[2])):
                self._best = (message.header.stamp.to_sec(), picture, boxes)

    def _on_road(self, box):
        name, _, left, _, width, height = box
        return (name == PERSON and height >= LEAST_HEIGHT_PX and
                AHEAD[0] * self.width <= left + width / 2 <= AHEAD[1] * self.width)

    def _worth(self, boxes):
        return sum(box[1] * (3 if self._on_road(box) else 1) for box in boxes)

    def draw(self, path, began):
        """@return paths of the pictures: one, or none if the vehicle never stood."""
        with self._lock:
            self._end()
        if not self.kept:
            return []
        plots.detections(path, [(stamp - began, picture, boxes) for stamp, picture, boxes in self.kept])
        return [path]


def save_gantt(traces, output):
    """Who computed when on which unit: the traces of all processes as trace.json for ui.perfetto.dev, and the middle of
    them as a chart.
    @return (paths, why there is none)"""
    merged, path = output / "trace.json", output / "gantt.png"
    problem = _tool("merge_traces", traces, merged)
    if not merged.is_file():
        return [], problem
    runs = [event["ts"] for event in json.loads(merged.read_text(encoding="utf-8"))["traceEvents"]
            if event.get("cat") == "run"]
    if not runs:
        return [], "no stage ran on a unit"
    middle_s = 0.5e-6 * (max(runs) - min(runs))
    problem = problem or _tool("draw_gantt", "--from", max(middle_s - 0.5 * CHART_S, 0.0), "--to",
                               middle_s + 0.5 * CHART_S, merged, path)
    return ([path], "") if not problem else ([], problem)


def _tool(name, *arguments):
    """A program of pi_runtime. @return what it complains about; empty: nothing"""
    ended = subprocess.run(["rosrun", "pi_runtime", name, *map(str, arguments)], capture_output=True, text=True,
                           check=False)
    return "" if ended.returncode == 0 else ended.stderr.strip() or "%s ended with %d" % (name, ended.returncode)
