"""What SLAM, speech and detection take of the computer, alone and together, local and offloaded: figures 14 to 16 of
the paper as a table of this computer, each figure with the rate at which the service worked.

SLAM gets a EuRoC recording in real time, detection a video, speech recorded commands; all nodes are preloaded with
π-OS. Offloaded, an edge_server does the work: it runs on this computer too, and is not counted. Watts are those of the
model of config/power.yaml (equation 4), calibrated on the paper's TX1, with the radio's joules as the coordinator
reports them: they are no measurement of this computer. Hours are those of a battery that drives the computer alone.
"""

import argparse
import json
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from first_drive import measuring, processes  # beside the script that starts this
from first_drive.errors import DemoError
from first_drive.localisation import convert
from first_drive.program import PREFIX, positive
from first_drive.report import table

from pi_bringup import battery as batteries

RECORDING = Path("slam") / "mh01_first10s"
VIDEO = Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi")
TEST_SOUNDS = Path("/usr/share/pocketsphinx/test/data/cards")
WORDS = ("go", "stop", "left", "right", "yes", "no")
READY_S = 120.0
PAPER = {"slam": "28 %", "speech": "22 % (20 %)", "detection": "24 % (25 %) + 70 % GPU", "all": "60 % + 72 % GPU, 11 W",
         "speech offloaded": "5 %", "detection offloaded": "12 %", "slam, others offloaded": "5 W"}


@dataclass
class Row:
    name: str
    slam: bool = False
    detection: str = "none"   # none, local or offloaded
    speech: str = "none"

    @property
    def offloads(self):
        return "offloaded" in (self.detection, self.speech)


ROWS = [Row("slam", slam=True), Row("speech", speech="local"), Row("detection", detection="local"),
        Row("all", slam=True, detection="local", speech="local"), Row("speech offloaded", speech="offloaded"),
        Row("detection offloaded", detection="offloaded"),
        Row("slam, others offloaded", slam=True, detection="offloaded", speech="offloaded")]

# Whose processes count for which service; those of the offloading coordinator hold the vehicle's own detector as well.
SERVICE_OF = {"vio": "slam", "ssd": "detection", "speech_manager": "speech", "offload_manager": "offloading"}
FEEDING = ("video", "video_recording", "sound_manager", "pose_listener", "player", "player_recording")


@dataclass
class Figures:
    row: Row
    seconds: float = 0.0
    cores: dict = field(default_factory=dict)    # by service
    memory: dict = field(default_factory=dict)   # [MB] by service
    feeding: float = 0.0                         # cores that stood in for sensors
    machine: float = 0.0                         # cores busy, of the whole computer
    rates: dict = field(default_factory=dict)
    load: float = 0.0
    radio_w: float = 0.0                         # by the coordinator's model

    @property
    def total(self):
        return sum(self.cores.values())


def read_model(folder):
    with open(Path(folder) / "config/power.yaml", encoding="utf-8") as file:
        return yaml.safe_load(file)["model"]


def watts(model, cores, radio_w=0.0):
    """(CPU, CPU with board and radio) by equation 4, as power_account.h has it."""
    cpu = model["idle_w"] + cores * model["beta_w_per_ghz3"] * model["frequency_ghz"] ** 3
    return cpu, cpu + model["board_w"] + radio_w


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def busy_seconds():
    with open("/proc/stat", encoding="ascii") as file:
        fields = [int(number) for number in file.readline().split()[1:8]]
    return (sum(fields) - fields[3] - fields[4]) / os.sysconf("SC_CLK_TCK")


# ------------------------------------------------------------------------------------------------------------ the graph

class Graph:
    """What the services answer, counted."""

    def __init__(self, environment):
        os.environ.update({key: environment[key]
                           for key in ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_LOG_DIR", "ROS_PACKAGE_PATH")})
        sys.path[:0] = [folder for folder in environment.get("PYTHONPATH", "").split(os.pathsep) if folder]
        import rospy  # reads the environment when it is imported
        from diagnostic_msgs.msg import DiagnosticArray
        from pi_detect.msg import Detection2DArray
        from pi_offload.msg import OffloadDecision
        from pi_speech.msg import VoiceCommand
        self._rospy = rospy
        rospy.init_node("bench_power", disable_signals=True)
        self._changed = threading.Condition()
        self.clear()
        for topic, kind, callback in (
                ("detections", Detection2DArray, lambda _: self._count("detections")),
                ("command", VoiceCommand, self._on_command),
                ("recognizer/rejected", VoiceCommand, self._on_command),
                ("coordinator/decisions", OffloadDecision, self._on_decision),
                ("/diagnostics", DiagnosticArray, self._on_diagnostics)):
            rospy.Subscriber(topic, kind, callback, queue_size=100)

    def clear(self):
        with self._changed:
            self.counts, self.values, self.latencies = {"radio": 0.0}, {}, []

    def _count(self, name, joules=0.0):
        with self._changed:
            self.counts[name] = self.counts.get(name, 0) + 1
            self.counts["radio"] += joules
            self._changed.notify_all()

    def _on_decision(self, message):
        # The energy of a task that a node did is the radio's.
        self._count("%s %s" % (message.kind, message.how), message.energy if message.how == "remote" else 0.0)

    def _on_command(self, message):
        with self._changed:
            self.latencies.append(message.latency.to_sec())
        self._count("utterances")

    def _on_diagnostics(self, message):
        with self._changed:
            for status in message.status:
                if status.name == "vio: odometry":
                    self.values.update({pair.key: pair.value for pair in status.values})
            self._changed.notify_all()

    def snapshot(self):
        with self._changed:
            return dict(self.counts), dict(self.values), list(self.latencies)

    def await_that(self, holds, what, process):
        """@throws DemoError if it does not come, or the nodes end before."""
        deadline = time.monotonic() + READY_S
        with self._changed:
            while not holds(self):
                if process.poll() is not None or time.monotonic() > deadline:
                    raise DemoError("%s did not come; from the log:\n%s" %
                                    (what, processes.log_excerpt(process.log_path)))
                self._changed.wait(0.5)

    def position(self):
        """Pairs of pictures that SLAM used."""
        return int(self.values.get("pairs used", 0))

    def await_node(self, name, process):
        """Until the master knows it."""
        import rosgraph
        master = rosgraph.Master("/bench_power")

        def known(_):
            try:
                return bool(master.lookupNode(name))
            except rosgraph.MasterError:
                return False

        self.await_that(known, "node " + name, process)

# ---------------------------------------------------------------------------------------------------------------- a row

class Bench:
    def __init__(self, started, graph, options, output):
        self._started, self._graph, self._options, self._output = started, graph, options, output

    def run(self, row):
        """@return Figures. @throws DemoError"""
        log = self._output / ("%s.log" % row.name.replace(", ", "_").replace(" ", "_"))
        nodes = []
        self._graph.clear()
        try:
            if row.offloads:
                nodes.append(self._edge_server(log))
            launch = self._started.launch(
                ["pi_bringup", "power_bench.launch", "slam:=%s" % ("local" if row.slam else "none"),
                 "detection:=" + row.detection, "speech:=" + row.speech, "video:=%s" % self._options.video,
                 "detection_hz:=%s" % self._options.detection_hz, "sounds:=%s" % self._options.sounds,
                 "preload:=%s" % (self._options.preload or "")], log)
            nodes.append(launch)
            return self._measure(row, launch, nodes)
        finally:
            for process in reversed(nodes):
                self._started.stop(process)

    def _edge_server(self, log):
        port, health = free_port(), free_port()
        server = self._started.launch(
            ["pi_offload", "edge_server.launch", "id:=bench", "address:=127.0.0.1:%d" % port,
             "port:=%d" % port, "health_port:=%d" % health, "workers:=1", "output:=log"], log)
        self._graph.await_node("/edge_server", server)
        return server

    def _measure(self, row, launch, nodes):
        graph = self._graph
        how = {"local": "detections", "offloaded": "detection remote"}.get(row.detection)
        if how:
            graph.await_that(lambda g: g.counts.get(how, 0) >= 5, "five " + how, launch)
        if row.speech != "none":
            graph.await_that(lambda g: g.counts.get("utterances", 0) >= 1, "an answer of the recogniser", launch)
        player = None
        if row.slam:
            graph.await_node("/vio", launch)
            player = self._started.launch(
                ["pi_bringup", "play.launch", "data:=%s" % self._bag(), "preload:=%s" % (self._options.preload or ""),
                 "wait_for_subscribers:=[left/image_raw /vio, right/image_raw /vio, imu/data /vio]"], launch.log_path)
            nodes.append(player)
            graph.await_that(lambda g: g.position() > 0, "odometry", player)
        pids = measuring.node_processes(launch.pid)
        if player:
            pids.update(measuring.node_processes(player.pid))
        return self._interval(row, pids, player)

    def _bag(self):
        """The recording, converted once."""
        bag = self._output / "recording.bag"
        return bag if bag.exists() else convert(self._started, PREFIX, self._options.recording, bag,
                                                "--start-at-first-image")

    def _interval(self, row, pids, player):
        counts, values, latencies = self._graph.snapshot()
        cpu = {node: measuring.cpu_seconds(pid) for node, pid in pids.items()}
        busy, began = busy_seconds(), time.monotonic()
        memory = {}
        # Until the time is over; with SLAM, until shortly before the recording is.
        seconds = self._options.duration if not player else min(self._options.duration, self._options.slam_s)
        threading.Event().wait(seconds)
        figures = Figures(row, time.monotonic() - began, load=os.getloadavg()[0])
        figures.machine = (busy_seconds() - busy) / figures.seconds
        for node, pid in pids.items():
            end = measuring.cpu_seconds(pid)
            if end is None or cpu[node] is None:
                if node in SERVICE_OF or node in FEEDING:
                    raise DemoError("node %s ended while it was measured" % node)
                continue
            cores = (end - cpu[node]) / figures.seconds
            memory[node] = (measuring.memory_mb(pid) or {}).get("pss", 0.0)
            if node in SERVICE_OF:
                # The loader of the detector, where that is the coordinator's neighbour.
                loader = node == "ssd" and row.detection == "offloaded"
                service = "offloading" if loader else SERVICE_OF[node]
                figures.cores[service] = figures.cores.get(service, 0.0) + cores
                figures.memory[service] = figures.memory.get(service, 0.0) + memory[node]
            elif node in FEEDING:
                figures.feeding += cores
        self._rates(figures, counts, values, len(latencies))
        return figures

    def _rates(self, figures, counts, values, before):
        now, at_end, latencies = self._graph.snapshot()
        if figures.row.slam:
            pairs = int(at_end.get("pairs used", 0)) - int(values.get("pairs used", 0))
            figures.rates["SLAM"] = "%.0f FPS, %s Hz pose" % (pairs / figures.seconds,
                                                              at_end.get("odometry [Hz]", "?").split(".")[0])
        done = {key: now[key] - counts.get(key, 0) for key in now}
        figures.radio_w = done["radio"] / figures.seconds
        if figures.row.detection != "none":
            text = "%.1f FPS" % (done.get("detections", 0) / figures.seconds)
            if figures.row.detection == "offloaded":
                remote = done.get("detection remote", 0)
                decided = sum(done.get("detection " + how, 0) for how in ("local", "remote", "fallback", "abandoned"))
                text += ", %.0f %% remote" % (100.0 * remote / decided if decided else 0.0)
            figures.rates["detection"] = text
        if figures.row.speech != "none":
            heard = latencies[before:]
            text = "%d utterances" % len(heard)
            if heard:
                text += ", %.0f ms" % (1000.0 * sorted(heard)[len(heard) // 2])
            if figures.row.speech == "offloaded":
                text += ", %d remote" % done.get("speech remote", 0)
            figures.rates["speech"] = text


# --------------------------------------------------------------------------------------------------------------- report

def report(figures, model, cores, battery):
    """The tables as text."""
    rows = [["", "SLAM", "detection", "speech", "offloading", "sum", "of all cores", "memory/MB", "CPU/W",
             "with board, radio/W", "hours", "rates", "paper (TX1)"]]
    for one in figures:
        cpu_w, all_w = watts(model, one.total, one.radio_w)
        cells = [("%.0f %%" % (100.0 * one.cores[key])) if key in one.cores else "-"
                 for key in ("slam", "detection", "speech", "offloading")]
        rows.append([one.row.name, *cells, "%.0f %%" % (100.0 * one.total), "%.0f %%" % (100.0 * one.total / cores),
                     "%.0f" % sum(one.memory.values()), "%.1f" % cpu_w, "%.1f" % all_w, "%.1f" % battery.hours(all_w),
                     "; ".join("%s %s" % pair for pair in one.rates.items()), PAPER[one.row.name]])
    beside = batteries.figure_16({one.row.name: one.total for one in figures},
                                 {one.row.name: watts(model, one.total, one.radio_w)[1] for one in figures}, battery)
    return table(rows, "<" + ">" * 10 + "<<") + "\n\n" + table(beside, "<<<")


def as_dict(one, model, battery):
    cpu_w, all_w = watts(model, one.total, one.radio_w)
    return {"row": one.row.name, "seconds": one.seconds, "cores": one.cores, "memory_mb": one.memory,
            "feeding_cores": one.feeding, "machine_cores": one.machine, "rates": one.rates, "cpu_watts": cpu_w,
            "radio_watts": one.radio_w,
            "watts": all_w, "hours": battery.hours(all_w), "load": one.load}


def parse(arguments):
    parser = argparse.ArgumentParser(prog="bench_power", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=positive, default=10.0, help="of each row [s]; default: %(default)s")
    parser.add_argument("--slam-duration", dest="slam_s", type=positive, default=7.0,
                        help="likewise with SLAM, shorter than the recording [s]; default: %(default)s")
    parser.add_argument("--data", dest="recording", type=Path, help="EuRoC recording; default: %s below $PI_EDGE_DATA" %
                        RECORDING)
    parser.add_argument("--video", type=Path, default=VIDEO, help="default: %(default)s")
    parser.add_argument("--detection-hz", type=positive, default=10.0, help="pictures per second; default: %(default)s")
    parser.add_argument("--sounds", type=Path, help="file, folder or list; default: commands of $PI_EDGE_DATA, "
                        "else those of pocketsphinx-testdata")
    parser.add_argument("--preload", type=Path, help="library of π-OS; default: that of this space")
    parser.add_argument("--tcpros", action="store_true", help="without π-OS")
    parser.add_argument("--only", action="append", choices=[row.name for row in ROWS], help="may be repeated")
    parser.add_argument("--battery-ah", type=positive, help="capacity [Ah]; default: that of pi_vehicle's power.yaml")
    parser.add_argument("--battery-v", type=positive, help="nominal voltage [V]; default likewise")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write everything measured there")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="keep the logs of the nodes there")
    return parser.parse_args([argument for argument in arguments if ":=" not in argument])


def complete(options, output):
    """Finds what was not given. @throws DemoError"""
    data = Path(os.environ["PI_EDGE_DATA"]).resolve() if os.environ.get("PI_EDGE_DATA") else None
    if options.recording is None and data:
        options.recording = data / RECORDING
    rows = [row for row in ROWS if not options.only or row.name in options.only]
    if any(row.slam for row in rows) and not (options.recording and (options.recording / "mav0").is_dir()):
        raise DemoError("no EuRoC recording (%s): name one with --data, set PI_EDGE_DATA, or choose rows without SLAM "
                        "with --only" % options.recording)
    if any(row.detection != "none" for row in rows) and not options.video.is_file():
        raise DemoError("--video %s: no such file; apt-get install opencv-doc, or name another" % options.video)
    if options.sounds is None:
        folder = data / "speech/commands" if data else None
        if folder and folder.is_dir():
            options.sounds = output / "sounds.txt"
            clips = [clip for word in WORDS for clip in sorted((folder / word).iterdir())[:2]]
            options.sounds.write_text("".join("%s\n" % clip for clip in clips), encoding="utf-8")
        else:
            options.sounds = TEST_SOUNDS
    if any(row.speech != "none" for row in rows) and not options.sounds.exists():
        raise DemoError("--sounds %s: no such file or folder; apt-get install pocketsphinx-testdata" % options.sounds)
    return rows


def measure(options, output):
    """@return (figures, model, battery)"""
    rows = complete(options, output)
    environment = processes.ros_environment(PREFIX, output)
    if not options.tcpros and options.preload is None:
        options.preload = processes.find_library(environment)
    started = processes.Processes(environment)
    figures = []
    try:
        processes.start_master(started, output, stock=options.tcpros)
        graph = Graph(started.environment)
        import roslib.packages
        vehicle = roslib.packages.get_pkg_dir("pi_vehicle")
        model, battery = read_model(vehicle), batteries.read(vehicle, options.battery_ah, options.battery_v)
        bench = Bench(started, graph, options, output)
        for number, row in enumerate(rows, 1):
            print("[%d/%d] %s" % (number, len(rows), row.name), file=sys.stderr, flush=True)
            figures.append(bench.run(row))
        return figures, model, battery
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the clean-up is bounded
        started.stop_all()


def main():
    def interrupt(*_):
        raise KeyboardInterrupt

    options = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, interrupt)
    facts = measuring.machine()
    status = 0
    with tempfile.TemporaryDirectory(prefix="bench_power_") as folder:
        output = options.logs.resolve() if options.logs else Path(folder)
        try:
            output.mkdir(parents=True, exist_ok=True)
            figures, model, battery = measure(options, output)
            print("%s, %d cores, Linux %s; load average %.1f at the start, %.1f at the end; %s" %
                  (facts["cpu"], facts["cores"], facts["kernel"], facts["load"], os.getloadavg()[0],
                   "TCPROS" if options.tcpros else "π-OS"))
            print("CPU in % of one core; feeding the sensors and the edge server are not counted\n")
            print(report(figures, model, facts["cores"], battery))
            print("\nNot counted: recordings in place of sensors, %s of a core; busy on the whole computer: %s cores" %
                  ("; ".join("%.0f %%" % (100 * one.feeding) for one in figures),
                   "; ".join("%.1f" % one.machine for one in figures)))
            if options.json:
                options.json.write_text(json.dumps({
                    "machine": facts, "model": model, "battery": vars(battery), "rows": [
                        as_dict(one, model, battery) for one in figures]}, indent=1), encoding="utf-8")
        except (DemoError, OSError, ValueError) as error:
            print("bench_power: %s" % error, file=sys.stderr)
            status = 1
        except KeyboardInterrupt:
            print("bench_power: interrupted", file=sys.stderr)
            status = 130
    sys.stdout.flush()
    os._exit(status)  # rospy leaves threads behind that would wait for nodes that are gone
