"""One closed-loop drive: from the start of the nodes to their end."""

import contextlib
import json
import math
import re
import shutil
import threading
import time
import uuid

from first_drive import measuring
from first_drive.errors import DemoError
from first_drive.processes import log_excerpt

from . import pictures
from .faults import RunnerFaults
from .kills import Killer
from .observer import Observer
from .recording import SensorRecording
from .speaker import Speaker
from .unplugs import WORD, Unplugger, sequence

READY_S = 180.0  # software rendering and loading of models on a loaded machine
FIRST_ODOMETRY = 20
CHASSIS_READY = (0, 1)  # READY, DRIVING of VehicleState
AGREEMENT_M = 0.5
LOOK_PERIOD_S = 0.5     # for processes of the nodes: those that died have new ones
SHOT_AT = 0.45          # of the way
UNPLUG_S = 15.0         # longer, for each device that is unplugged
REFUSING = ("simulator", "chassis", "arbiter", "navigation")  # what a vehicle that has to refuse needs for it


class CampusDrive:
    """options: those of the command line; after run() what was seen."""

    def __init__(self, options, scenario, package, output):
        """@param package  folder of pi_bringup"""
        self.options = options
        self.package = package
        self.scenario = scenario
        self.output = output
        self.simulator_log = output / "simulator.jsonl"
        self.facts = {}        # of the simulator's topic scenario
        self.readiness = {}    # what: seconds until it was there
        self.result = None     # of the action
        self.end = ""          # why the drive ended
        self.links = []
        self.pictures = []
        self.no_gantt = ""     # why there is none
        self.kills = []
        self.unplugs = []
        self.not_unplugged = []  # names of devices
        self.faults = []       # of the scenario, done by the runner
        self.observer = None
        self._pids = {}        # node: process
        self.began = self.ended = 0.0  # of the way, simulated
        self._shot = None      # thread
        self._seen = None      # pictures.SeenAhead
        self._faults = None    # RunnerFaults
        self._recording = SensorRecording(output / "sensors.bag", options.record) if options.record else None

    # -------------------------------------------------------------------------------------------------------- nodes

    def run(self, started, events, screen, edge):
        """@param screen  None: without rviz. @throws DemoError"""
        log = self.output / "log" / "roslaunch.log"
        for old in (self.simulator_log, log, *self.output.glob("*.png")):
            old.unlink(missing_ok=True)
        options = self.options
        arguments = {
            "scenario": self.scenario.path, "seed": options.seed, "base": options.base, "vehicle": self.scenario.vehicle,
            "link": self.output / "chassis", "log": self.simulator_log, "recordings": self.output / "recordings",
            "preload": options.preload or "", "together": options.together,
            "offload": bool(edge), "edge_nodes": edge.map_file if edge else "", "rviz": False,
            "frame_rate": options.frame_rate, "output": "screen", **self._background()}
        traces = self.output / "traces"  # of the runtimes of all processes, written as they end
        shutil.rmtree(traces, ignore_errors=True)
        traces.mkdir()
        started.environment["PI_RUNTIME_TRACE"] = str(traces)
        print("  starting the nodes")
        launch = started.launch(["pi_bringup", "simulation.launch"] +
                                ["%s:=%s" % (key, str(value).lower() if isinstance(value, bool) else value)
                                 for key, value in arguments.items()], log)
        with contextlib.ExitStack() as ends:
            ends.callback(started.stop, launch)
            ends.callback(self._close)
            if self._recording is not None:
                ends.callback(self._recording.end, started)
            events.follow(launch)
            for name, process in (edge.processes if edge else {}).items():
                events.watch(process, "edge server " + name)
            self.observer = Observer(events)
            self._await_ready(events, launch, edge)
            if screen is not None:
                pictures.start_rviz(started, screen, self.package, self.output, options.preload)
                self._seen = pictures.SeenAhead(events.rospy)
            self._say_where(events)
            self._drive(events, launch, started, screen, edge)
        gantt, self.no_gantt = pictures.save_gantt(traces, self.output)
        self.pictures += gantt

    def _close(self):
        if self._faults is not None:
            self._faults.end()
        for one in (self.observer, self._seen):
            if one is not None:
                one.close()

    def _background(self):
        """Arguments of the launch file."""
        names = {"sound": "background", "level_dbfs": "background_level"}
        return {names[key]: value for key, value in self.scenario.background.items() if key in names}

    # -------------------------------------------------------------------------------------------------------- ready

    def _missing(self, edge):
        """{what does not work yet: why}"""
        records, seen = self.observer.records, self.observer.records.arrivals
        missing = {}

        def need(what, holds, why):
            if holds:
                self.readiness.setdefault(what, time.monotonic() - self.began)
            else:
                missing[what] = why

        def status(name, default="says nothing in /diagnostics"):
            return records.statuses.get(name, (None, default, {}))

        need("simulator", bool(self.facts) and self.observer.now() > 0.0, "nothing on /scenario or /clock")
        state = records.states[-1] if records.states else None
        need("chassis", state is not None and state[2] in CHASSIS_READY,
             "nothing on /vehicle_state" if state is None else state[3])
        need("localisation", len(records.estimates) >= FIRST_ODOMETRY // 10 + 1, status("vio: odometry")[1])
        need("obstacles", "/obstacles" in seen, status("obstacles: obstacles")[1])
        need("detection", "/detections" in seen, status("ssd: detection")[1])
        recognizer = status("recognizer: recognition")
        need("speech", recognizer[2].get("state") == "listening", recognizer[1])
        need("arbiter", bool(records.arbiter) and "/motion" in seen, status("arbiter: arbiter")[1])
        need("navigation", "/drive/status" in seen and "/motion/navigation" in seen,
             status("navigation: navigation")[1])
        if edge:
            nodes = status("coordinator: nodes")
            silent = [name for name in edge.processes
                      if not re.search(", (connected|not connected: not in range), ", nodes[2].get(name, ""))]
            need("edge nodes", not silent, "; ".join("%s: %s" % (name, nodes[2].get(name, nodes[1]))
                                                     for name in silent))
        if self._refuses():
            return {what: why for what, why in missing.items() if what in REFUSING}
        return missing

    def _refuses(self):
        return self.facts.get("expect") == "refuse"

    def _await_ready(self, events, launch, edge):
        """@throws DemoError naming what did not come."""
        self.began = time.monotonic()
        deadline = self.began + READY_S
        while True:
            kind, content = events.next(lambda *_: True, "the simulator")
            if kind == "scenario":
                self.facts = json.loads(content)
            missing = self._missing(edge)
            if not missing:
                break
            if time.monotonic() > deadline:
                raise DemoError("not ready after %d s: %s; from the log:\n%s" % (
                    READY_S, "; ".join("%s (%s)" % pair for pair in missing.items()), log_excerpt(launch.log_path)))
        print("  ready after %.0f s: %s" % (time.monotonic() - self.began, ", ".join(
            "%s %.0f" % pair for pair in sorted(self.readiness.items(), key=lambda pair: pair[1]))))

    def _say_where(self, events):
        """Publishes where the vehicle begins, if anybody wants to know, and checks that localisation agrees.
        @throws DemoError"""
        from geometry_msgs.msg import PoseWithCovarianceStamped
        rospy = events.rospy
        x, y, heading = self.facts["start"]
        listeners = {node for topic, nodes in rospy.get_master().getSystemState()[2][1] if topic == "/initialpose"
                     for node in nodes}
        if listeners:
            publisher = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1, latch=True)
            pose = PoseWithCovarianceStamped()
            pose.header.frame_id = "map"
            pose.header.stamp = rospy.Time.now()
            pose.pose.pose.position.x, pose.pose.pose.position.y = x, y
            pose.pose.pose.orientation.z, pose.pose.pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)
            pose.pose.covariance[0] = pose.pose.covariance[7] = 0.01
            pose.pose.covariance[35] = 0.001
            publisher.publish(pose)
        deadline = time.monotonic() + READY_S
        while True:
            events.next(lambda kind, _: kind == "truth", "the vehicle's true pose")
            estimate, truth = self.observer.estimate, self.observer.truth
            if self._refuses():
                return
            error = math.hypot(estimate[1] - truth[1], estimate[2] - truth[2])
            if error < AGREEMENT_M:
                return
            if time.monotonic() > deadline:
                raise DemoError("localisation begins %.2f m beside the vehicle: at (%.2f, %.2f) in the map, not at "
                                "(%.2f, %.2f)%s" % (error, *estimate[1:3], *truth[1:3],
                                                    "" if listeners else "; nobody subscribes initialpose"))

    # -------------------------------------------------------------------------------------------------------- drive

    def _goal(self, rospy, points):
        from geometry_msgs.msg import PoseStamped
        from pi_vehicle.msg import DriveActionGoal
        goal = DriveActionGoal()
        goal.header.stamp = goal.goal_id.stamp = rospy.Time.now()
        goal.goal_id.id = "drive_campus-%s" % uuid.uuid4().hex[:8]
        for point in points:
            pose = PoseStamped()
            pose.header.frame_id = "map"
            pose.pose.position.x, pose.pose.position.y = point[0], point[1]
            if len(point) > 2:
                pose.pose.orientation.z, pose.pose.orientation.w = math.sin(point[2] / 2), math.cos(point[2] / 2)
            goal.goal.waypoints.append(pose)
        return goal

    def _drive(self, events, launch, started, screen, edge):
        rospy = events.rospy
        from actionlib_msgs.msg import GoalStatusArray
        from pi_vehicle.msg import DriveActionGoal
        from std_msgs.msg import String
        goals = rospy.Publisher("/drive/goal", DriveActionGoal, queue_size=1)
        mouth = rospy.Publisher("/microphone/play", String, queue_size=10)
        servers = set()  # the recorder, too, subscribes goals: it is the one who tells their status that must be there
        status = rospy.Subscriber("/drive/status", GoalStatusArray,
                                  lambda message: servers.add(message._connection_header["callerid"]))
        limit = time.monotonic() + READY_S
        while not (any(goals.impl.has_connection(one) for one in list(servers)) and mouth.get_num_connections()):
            events.next(lambda kind, _: kind == "truth", "navigation and microphone to connect")
            if time.monotonic() > limit:
                raise DemoError("navigation does not subscribe drive/goal, or nobody microphone/play")
        status.unregister()
        speaker = Speaker(self.facts["spoken"], self.output, self.observer.records,
                          lambda path: mouth.publish(String(data=str(path))))
        ways = [self.facts["waypoints"] + [self.facts["goal"]]] + [[one] for one in self.facts["further_goals"]]
        goal = self._goal(rospy, ways.pop(0))
        self._pids = measuring.node_processes(launch.pid)
        self._faults = RunnerFaults(self.simulator_log, lambda: self._pids,
                                    list((edge.processes if edge else {}).values()))
        self.faults = self._faults.done
        killer = Killer(self.options.kill, self.options.seed, self.observer)
        unplugger = Unplugger(sequence(self.options.unplug, self.options.seed), self.observer, self._commander(rospy))
        if self._recording is not None:
            self._recording.begin(started, events, self.options.preload)
        self.began = rospy.get_time()
        goals.publish(goal)
        killer.begin(self.began)
        unplugger.begin(self.began)
        print("  driving to (%.1f, %.1f) in the map" % tuple(self.facts["goal"][:2]))
        usual_s = self.scenario.duration_s
        if self.facts["expect"] == "reach":
            usual_s = 3.0 * usual_s + 30.0 + 8.0 * self.options.kill
        limit_s = self.options.limit or usual_s + UNPLUG_S * len(unplugger.left)
        next_look, looked = 0.0, self.began
        while self.result is None:
            kind, content = events.next(lambda *_: True, "the drive")
            now = rospy.get_time()
            if kind == "result" and content["goal"] == goal.goal_id.id:
                if content["success"] and ways:
                    goal = self._goal(rospy, ways.pop(0))
                    goals.publish(goal)
                else:
                    self.result = content
            elif kind == "back":
                killer.came_back(content)
            elif kind == "truth":
                if self._seen is not None:
                    self._seen.speed(content[4], now)
                speaker.notice(content[1], content[2], now - self.began, now)
                if unplugger.busy:
                    speaker.hold(now - looked)
                elif speaker.speak(now):
                    unplugger.word_said(now)
                looked = now
                goal_x, goal_y = self.facts["goal"][:2]
                if unplugger.tick(now, content[4], math.hypot(content[1] - goal_x, content[2] - goal_y),
                                  speaker.waits()):
                    speaker.prove(WORD, now)
                killer.tick(now, self._pids, content[4])
                self._faults.tick()
                if self._recording is not None:
                    self._recording.tick(started, now)
                if now >= next_look:
                    next_look = now + LOOK_PERIOD_S
                    self._pids = measuring.node_processes(launch.pid)
                self._shoot(screen, started)
                if now - self.began > limit_s:
                    self.end = "time is over: %.0f s" % limit_s
                    break
            elif kind == "command":
                print("  heard \"%s\"%s" % (content["text"], "" if content["accepted"] else ", rejected"))
        self.ended = rospy.get_time()
        self.kills = killer.kills
        self.unplugs, self.not_unplugged = unplugger.unplugs, unplugger.left
        if self.result is not None:
            self.end = self.result["message"] or ("arrived" if self.result["success"] else "given up")
        self._shoot(screen, started, last=True)
        if self._seen is not None:
            self.pictures += self._seen.draw(self.output / "campus_detections.png", self.began)
        print("  %s, after %.1f s" % (self.end, self.ended - self.began))

    @staticmethod
    def _commander(rospy):
        from pi_simulation.srv import SimulatorCommand

        def command(service, line):
            """@throws DemoError"""
            try:
                answer = rospy.ServiceProxy(service, SimulatorCommand)(line)
            except rospy.ServiceException as error:
                raise DemoError("%s: \"%s\" was not executed: %s" % (service, line, error)) from error
            if not answer.success:
                raise DemoError("%s: %s" % (service, answer.message))
            print("  %s: %s" % (service.split("/")[1], line))
        return command

    def _shoot(self, screen, started, last=False):
        """Links and the screen, once on the way: where it brakes for the first time, or for a person, else in the
        middle, and not before rviz is there. Beside the drive: it takes seconds."""
        progress = self.observer.records.feedback[-1][1] if self.observer.records.feedback else 0.0
        brakes = self._seen is not None and self._seen.begun > 0
        due = brakes or progress >= SHOT_AT
        if self._shot is None and (last or (due and (screen is None or screen.shows_rviz()))):
            self._shot = threading.Thread(target=self._look, args=(screen, started.environment["ROS_MASTER_URI"]))
            self._shot.start()
        if last:
            self._shot.join()

    def _look(self, screen, master_uri):
        self.links = measuring.all_links(master_uri)
        if screen is not None:
            self.pictures = screen.shoot("campus", only="rviz")
