"""The vehicle on a recorded drive in real time, measured: what it takes, and how soon it answers."""

import os
import subprocess
import time

from first_drive import measuring
from first_drive.errors import DemoError

from pi_bringup import battery as batteries

from . import protection, report, words
from .cpu import CpuAccount, group_of
from .observer import VIO_INPUTS, VIO_STATUS, power_figures
from .protection import Disturbance

MONITORED = ["/imu/data", "/left/image_raw", "/right/image_raw", "/audio_stamped", "/odometry", "/detections",
             "/obstacles", "/command", "/motion/reaction", "/motion", "/power"]
SAID = ("stop", "go") * 3
SAID_FROM_S, SAID_EVERY_S = 3.0, 2.5  # of the recording; nothing moves
OF_PICTURES = ("/obstacles", "/detections")
OF_STREAMS = ("unit", "priority", "period_s", "deadline_s", "wcet_s", "jobs", "missed", "p50_s", "p99_s", "max_s")
BUSY = 0.15  # share of the computer that others may take while speed is judged


def processor_times():
    """(busy, all) of the computer [ticks of its cores, since its start]"""
    with open("/proc/stat", encoding="ascii") as file:
        ticks = [int(word) for word in file.readline().split()[1:9]]
    return sum(ticks) - ticks[3] - ticks[4], sum(ticks)


def as_sensors():
    """@return what lets a program wait for no other, as sensors and instruments do; empty where that is not granted"""
    prefix = ["chrt", "--fifo", "20"]
    granted = subprocess.run(prefix + ["true"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode == 0
    return " ".join(prefix) if granted else ""


class SpeedRun:
    """@param bag  of SensorRecording. @param use_runtime  heavy stages are jobs of pi_runtime.
    @param disturb  beside busy loops. @param real_time  what plays and what measures waits for no other program."""

    def __init__(self, bag, preload, output, use_runtime=True, disturb=False, real_time=False):
        self._bag = bag
        self._prefix = as_sensors() if real_time else ""
        self._use_runtime = use_runtime
        self._disturb = disturb
        self._odometry = []  # diagnostics of it
        self._streams = {}   # name: figures
        self._preload = preload
        self._output = output
        self._power, self._commands, self._pairs, self._errors = [], [], [], []
        self._mouth = None
        self._sounds = {word: str(words.sound_of(word, output)) for word in sorted(set(SAID))}

    def run(self, started, events):
        """@return the tree for JSON. @throws DemoError"""
        log = self._output / "log" / "roslaunch.log"
        monitor_report = self._output / "monitor.json"
        for old in (log, monitor_report):
            old.unlink(missing_ok=True)
        self._subscribe(events)
        print("  starting the nodes")
        launch = started.launch(["pi_bringup", "speed.launch", "bag:=%s" % self._bag,
                                 "preload:=%s" % (self._preload or ""), "prefix:=%s" % self._prefix,
                                 "use_runtime:=%s" % str(self._use_runtime).lower(),
                                 "recordings:=%s" % (self._output / "recordings")], log)
        monitor = None
        try:
            events.follow(launch)
            events.rospy.set_param("/topic_monitor", {"topics": MONITORED, "report": str(monitor_report),
                                                      "print_table": False, "tcp_nodelay": True})
            prefix = self._prefix.split() + (["env", "LD_PRELOAD=%s" % self._preload] if self._preload else [])
            monitor = started.start(prefix + ["rosrun", "pi_os_transport", "topic_monitor"],
                                    self._output / "log" / "monitor.log")
            events.watch(monitor, "topic_monitor")
            events.next(lambda kind, event: kind == "player" and event["state"] == "playing",
                        "the vehicle to subscribe to the recording")
            return self._measure(events, started, launch, monitor)
        finally:
            if monitor is not None:
                started.stop(monitor)
            started.stop(launch)

    def _subscribe(self, events):
        from diagnostic_msgs.msg import DiagnosticArray
        from pi_runtime.msg import RuntimeStatus
        from pi_speech.msg import VoiceCommand
        from pi_vehicle.msg import PowerState
        from rosgraph_msgs.msg import Log
        from std_msgs.msg import String
        events.subscribe("/command", VoiceCommand, lambda message: self._commands.append(
            {"text": message.text, "accepted": True, "latency": message.latency.to_sec()}))
        events.subscribe("/power", PowerState, lambda message: self._power.append(power_figures(message)))
        events.subscribe("/diagnostics", DiagnosticArray, self._on_diagnostics)
        events.subscribe("/runtime/status", RuntimeStatus, self._on_streams)
        self._mouth = events.rospy.Publisher("/microphone/play", String, queue_size=10)
        events.subscribe("/rosout_agg", Log, lambda message: message.level >= Log.ERROR and self._errors.append(
            (message.name, message.msg)) or None)

    def _say(self, since_begin, said):
        """@return words said so far"""
        if said < len(SAID) and since_begin >= SAID_FROM_S + SAID_EVERY_S * said:
            self._mouth.publish(self._sounds[SAID[said]])
            said += 1
        return said

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name.strip("/") in (VIO_STATUS, VIO_INPUTS):
                values = {pair.key: pair.value for pair in status.values}
                self._odometry.append(values)
                if "pairs used" in values:
                    self._pairs.append((message.header.stamp.to_sec(), int(values["pairs used"])))
        return "diagnostics", None

    def _on_streams(self, message):
        for stream in message.streams:
            self._streams[stream.name] = {key: getattr(stream, key) for key in OF_STREAMS}

    def _measure(self, events, started, launch, monitor):
        print("  playing")
        cpu = CpuAccount(launch.pid, {"topic_monitor": monitor.pid, "drive_campus": os.getpid(), **started.core})
        begin, before = time.time(), processor_times()
        links, said, late = [], 0, {}
        disturbance = Disturbance(started, self._output / "log" / "busy.log") if self._disturb else None
        while True:
            kind, event = events.next(lambda *_: True, "the recording to end")
            if kind == "player" and event["state"] == "finished":
                late = event["lateness_ms"]
                break
            if kind == "diagnostics":
                cpu.update()
                said = self._say(time.time() - begin, said)
                if disturbance is not None:
                    disturbance.tick(time.time() - begin)
                links = links if links or time.time() - begin < 5.0 else measuring.all_links(
                    started.environment["ROS_MASTER_URI"])
        cpu.update()
        end, after = time.time(), processor_times()
        if disturbance is not None:
            disturbance.end()
        cpu.measure_memory()
        _, figures = events.next(lambda kind, _: kind == "monitor", "the monitor's report")
        groups = {}
        for node, cores in cpu.cores().items():
            groups.setdefault(group_of(node, ()), {})[node] = cores
        used = sum(sum(nodes.values()) for nodes in groups.values())
        others = (after[0] - before[0]) - used * cpu.seconds * os.sysconf("SC_CLK_TCK")
        power = self._power
        import roslib.packages
        battery = batteries.read(roslib.packages.get_pkg_dir("pi_vehicle"))
        if not figures["topics"].get("/odometry", {}).get("messages"):
            raise DemoError("no odometry came of the recording")
        return {
            "transport": "π-OS" if self._preload else "TCPROS", "seconds": end - begin, "topics": figures["topics"],
            "pairs_hz": report.pairs_hz(self._pairs, begin, end), "commands": self._commands, "said": said,
            # From the picture's stamp, which is that of the recording moved to now.
            "latency_ms": {topic: figures["topics"].get(topic, {}).get("latency_ms") or {} for topic in OF_PICTURES},
            "cpu_cores": groups, "vehicle_cores": sum(groups.get("vehicle", {}).values()), "memory_mb": cpu.memory,
            "services": report.services(power), "others_share": max(0.0, others) / max(1, after[1] - before[1]),
            "watts": sum(one["total_watts"] for one in power) / len(power) if power else None,
            "watts_source": power[-1]["source"] if power else None, "battery": str(battery),
            "battery_wh": battery.watt_hours, "errors": self._errors,
            "transports": report.transports(links), "use_runtime": self._use_runtime, "disturbed": self._disturb,
            "player_late_ms": late,
            "odometry": protection.odometry(self._odometry), "streams": self._streams}
