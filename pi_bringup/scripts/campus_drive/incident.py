"""The report of an incident: that of a drive, from a bag of the recorder. What a bag does not hold is left out, with a
line that says so."""

import bisect
import math
import tempfile
from pathlib import Path
from types import SimpleNamespace

from first_drive.errors import DemoError
from first_drive.report import number
from pi_bringup.incidents import errors_of_bags, triggers_in

from . import judge, page, plots
from .observer import Observer

STATES_APART_S = 0.05         # as those of the simulator
WAYPOINTS_APART_M = 2.0       # of the route that is drawn
PICTURES_AT_S = (-3.0, 0.0, 3.0)
PICTURE_TOPIC = "/left/image_raw/compressed"
ROUTE_TOPIC = "/route"
# What comes steadily on a vehicle: topic, what is missing without it.
STEADY = [("/odometry", "the pose"), ("/tf", "the pose in the map: poses are those of odometry"),
          ("/vehicle_state", "speed and mode of the vehicle"), ("/motion", "the commanded speed"),
          ("/arbiter/state", "who drove, and the reasons of standstills"), ("/obstacles", "the obstacles"),
          (PICTURE_TOPIC, "pictures"), ("/diagnostics", "diagnostics")]


class BagGraph:
    """A bag in place of the graph. Messages go to those who subscribed, in the order of the bag."""

    def __init__(self):
        self.now = 0.0
        self.notes = []
        self._callbacks = {}

    def subscribe(self, topic, kind, callback, **_):
        self._callbacks[topic] = (kind, callback)
        return SimpleNamespace(unregister=lambda: None)

    def play(self, bag):
        import genpy
        left_out = {}
        for topic, (datatype, data, md5sum, _, _), stamp in bag.read_messages(list(self._callbacks), raw=True):
            kind, callback = self._callbacks[topic]
            self.now = stamp.to_sec()
            message = kind()
            if kind._md5sum == "*":  # rospy.AnyMsg
                message._buff = data
            elif kind._md5sum != md5sum:
                left_out[topic] = "%s of another version" % datatype
                continue
            else:
                message.deserialize(data)
            try:
                callback(message)
            except genpy.DeserializationError as error:
                left_out[topic] = str(error)
        self.notes += ["%s is left out: %s" % one for one in sorted(left_out.items())]


def states_of(records, obstacles, begin):
    """What a drive has of the simulator, as measured: by the pose, with the speed of the wheels and what was seen."""
    arrivals = [one[0] for one in records.states]
    seen = [one[0] for one in obstacles]
    states = []
    for stamp, x, y, heading in records.estimates:
        if states and 0.0 <= stamp - states[-1]["stamp"] < STATES_APART_S:
            continue
        index = bisect.bisect_right(arrivals, stamp) - 1
        state = {"stamp": stamp, "t": stamp - begin, "pose": [x, y, heading],
                 "speed": records.states[index][1] if index >= 0 else 0.0}
        index = bisect.bisect_right(seen, stamp) - 1
        if index >= 0 and stamp - seen[index] < 1.0 and obstacles[index][1]:
            place = min(obstacles[index][1], key=lambda one: math.hypot(*one))
            state["nearest"] = state["nearest_actor"] = {
                "distance": math.hypot(*place), "position": place, "actor": "obstacle", "class": "obstacle", "id": 0}
        states.append(state)
    return states


def waypoints_of(bag):
    """Points of the last route, some metres apart."""
    points = []
    for _, message, _ in bag.read_messages([ROUTE_TOPIC]):
        points = [] if message.poses else points  # an empty one ends a route
        for one in message.poses:
            place = (one.pose.position.x, one.pose.position.y)
            if not points or math.dist(points[-1], place) >= WAYPOINTS_APART_M:
                points.append(place)
    return points


def tree_of(records, states, triggers, begin, end):
    """As judge.judge() has it, without what only the simulator knows."""
    collisions = [{"t": stamp - begin, "with": text} for stamp, cause, text in triggers if cause == "collision"]
    standstills = judge.standstills(states, records.arbiter)
    return {"measured": True, "seconds": end - begin,
            "incidents": [{"stamp": stamp, "cause": cause, "text": text} for stamp, cause, text in triggers],
            "losses": [one for one in records.validity if not one[1]], "met": judge.obstacles_met(states),
            "sightings": {}, "collisions": collisions, "standstills": standstills, "stops": [],
            "commands": records.commands, "offloading": judge.offloaded(records.decisions, begin, end),
            "reactions": records.reactions, "kills": [], "no_gantt": "", "errors": records.errors, "unplugs": [],
            "played": [], "said": [], "triggers": [], "hardest_braking": judge.hardest_braking(states),
            "nearest_m": judge.nearest(states), "max_speed": max((one["speed"] for one in states), default=None)}


def after_trigger(records, trigger):
    """Seconds from the trigger until the vehicle stands; None: it does not."""
    return next((one[0] - trigger for one in records.states if one[0] >= trigger and
                 abs(one[1]) <= judge.STANDSTILL), None)


def table_of(tree, records):
    rows = [["what", ""]]
    rows += [["trigger after %.1f s" % (one["stamp"] - tree["begin"]), "%s: %s" % (one["cause"], one["text"])]
             for one in tree["incidents"]]
    stands = after_trigger(records, tree["incidents"][0]["stamp"]) if tree["incidents"] and records.states else None
    rows += [["speed, most", number(tree["max_speed"], 2) + " m/s"],
             ["hardest braking, by the wheels", number(tree["hardest_braking"], 1) + " m/s²"],
             ["from the first trigger until it stands", judge.seconds(stands)],
             ["nearest obstacle, from the vehicle's origin", number(tree["nearest_m"], 2) + " m"],
             ["errors in the log", str(len(tree["errors"]))]]
    return page.rows_of(rows)


def notes_of(bag, graph):
    topics = bag.get_type_and_topic_info().topics
    notes = ["not in the bag: %s (no %s)" % (what, topic) for topic, what in STEADY if topic not in topics]
    notes.append("A bag does not hold the truth: collisions are those that were reported, distances those that were "
                 "seen, and causes of standstills are not judged. Rates, latencies, processor and transports are not "
                 "recorded.")
    return notes + graph.notes


def save_pictures(bag, triggers, begin, folder):
    """Pictures of the left camera around the first trigger. @return [(path, caption)]"""
    middle = triggers[0][0] if triggers else begin
    found = {}
    for _, message, stamp in bag.read_messages([PICTURE_TOPIC]):
        for wanted in PICTURES_AT_S:
            error = abs(stamp.to_sec() - middle - wanted)
            if wanted not in found or error < found[wanted][0]:
                found[wanted] = (error, stamp.to_sec(), message.data)
    saved = {}
    for _, stamp, data in found.values():
        path = folder / ("left_%.3f.jpg" % stamp)
        path.write_bytes(data)
        saved[path] = "Left camera %.1f s %s the first trigger" % (abs(stamp - middle),
                                                                 "after" if stamp >= middle else "before")
    return sorted(saved.items())


def write_report(file, output):
    """@param file  a bag. @param output  the HTML page. @return its path. @throws DemoError"""
    import rosbag
    try:
        bag = rosbag.Bag(str(file))
    except errors_of_bags() as error:
        raise DemoError("%s is not readable as a bag: %s" % (file, error)) from error
    with bag, tempfile.TemporaryDirectory() as folder:
        if not bag.get_message_count():
            raise DemoError("%s holds no messages" % file)
        begin, end = bag.get_start_time(), bag.get_end_time()
        graph = BagGraph()
        events = SimpleNamespace(put=lambda *_: None)
        observer = Observer(events, subscribe=graph.subscribe, now=lambda: graph.now, odometry_every=1)
        observer.map_odom = (0.0, 0.0, 0.0)  # until the bag tells
        graph.play(bag)
        records, triggers = observer.records, triggers_in(bag)
        states = states_of(records, observer.reported_obstacles(), begin)
        tree = {**tree_of(records, states, triggers, begin, end), "begin": begin}
        waypoints = waypoints_of(bag)
        facts = {"waypoints": waypoints[:-1], "further_goals": [], **({"goal": waypoints[-1]} if waypoints else {})}
        drive = SimpleNamespace(began=begin, ended=end, facts=facts, observer=observer)
        title = "Incident: %s" % (", ".join(dict.fromkeys(cause for _, cause, _ in triggers)) or "none in this bag")
        parts = [table_of(tree, records)]
        parts += ["<p>%s</p>" % page.html.escape(note) for note in notes_of(bag, graph)]
        parts += ["<h2>Pictures</h2>"]
        drawn = plots.draw_way(drive, tree, states, title, Path(folder)) if states else []
        parts += [page.picture(*one) for one in zip(drawn, ("Where it drove", "Speed and incidents"))]
        parts += [page.picture(*one) for one in save_pictures(bag, triggers, begin, Path(folder))]
        parts += [page.happened(tree)]
        verdict = "; ".join("%s: %s" % one[1:] for one in triggers) or "No trigger in this bag"
        try:
            return page.document(title, "%s, %.0f s" % (file.name, end - begin), verdict, not tree["collisions"], parts,
                                 output)
        except OSError as error:
            raise DemoError("%s cannot be written: %s; choose another --output" % (output, error.strerror)) from error
