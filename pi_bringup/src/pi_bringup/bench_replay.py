"""Long replay: whether memory and latency of the vehicle's services stay where they are, and no message is lost.

A rendered drive once around the campus, which ends where it began, is played round after round as cameras and IMU,
spoken commands as microphone, in real time, with localisation, detection, obstacles, speech, power and diagnostics of
vehicle.launch. Memory is proportional set size (PSS), so that what is shared counts once, without pages of files:
how much of those a process has depends on who else maps them.

Exit status: 0 if memory grew by less than 2 % after the first five minutes, no IMU message was lost and no latency
drifted; 1 if not, or if something is missing.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import time
from pathlib import Path

from campus_drive import words  # beside the script that starts this
from first_drive import measuring, processes
from first_drive.errors import DemoError
from first_drive.events import Events
from first_drive.localisation import convert
from first_drive.program import PREFIX, positive
from first_drive.report import table

SETTLING_S = 300.0      # before growth counts
SAMPLE_S = 10.0
SAMPLES_ON_THE_WAY = 20  # of the IMU, whose poses come later
WINDOW_S = 20.0         # of latency
GROWTH = 0.02           # of the memory of all services
DRIFT = 0.10            # of a median of latency, from the first third of the windows to the last
DRIFT_MS = 1.0          # less is none
READY_S = 180.0
BODY_HEIGHT_M = 1.0     # above the ground, of rendered drives
SAID = ("stop", "go", "left", "right", "yes", "no")
COUNTED = ["/imu/data", "/odometry"]  # all messages of the whole time
WORKING = ["/detections", "/obstacles", "/command"]  # likewise subscribed: without a subscriber nobody works
TIMED = ["/odometry", "/detections", "/obstacles", "/left/image_raw"]
SERVICES = {"vio", "ssd", "obstacles", "recognizer", "power", "runtime", "diagnostic_aggregator", "vehicle_manager"}


def parse(arguments):
    parser = argparse.ArgumentParser(prog="bench_replay", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=positive, default=60.0, help="default: %(default)s")
    parser.add_argument("--every", type=positive, default=3.0, metavar="MINUTES",
                        help="between two looks at latency; default: %(default)s")
    parser.add_argument("--recording", type=Path, help="EuRoC layout, should end where it begins; default: rendered")
    parser.add_argument("--output", type=Path, default=Path("report"), help="folder; default: %(default)s")
    parser.add_argument("--tcpros", action="store_true", help="without π-OS")
    parser.add_argument("--together", action="store_true", help="the nodelets in one process")
    return parser.parse_args([argument for argument in arguments if ":=" not in argument])


# ---------------------------------------------------------------------------------------------------------------- judge

def growth(samples, settling_s, end_share=0.1):
    """Relative growth from the minute behind `settling_s` to the last tenth of the time.
    @param samples  [(seconds, MB)]. @return (share, MB before, MB at the end); None with too few of them."""
    if not samples:
        return None
    last = samples[-1][0]
    before = [value for at, value in samples if settling_s <= at < settling_s + 60.0]
    behind = [value for at, value in samples if at >= last - end_share * (last - settling_s)]
    if not before or not behind or last < settling_s + 120.0:
        return None
    first, end = statistics.median(before), statistics.median(behind)
    return (end - first) / first, first, end


def drift(values):
    """From the first third to the last. @param values  medians of windows [ms]. @return (share, first, last) or None"""
    if len(values) < 3:
        return None
    part = max(1, len(values) // 3)
    first, last = statistics.median(values[:part]), statistics.median(values[-part:])
    return (last - first) / first if first > 0.0 else 0.0, first, last


def judge(result):
    """@return why it does not count as passed, as texts."""
    texts = []
    grown = growth(result["total_mb"], result["settling_s"])
    if grown is None:
        texts.append("too short to judge memory: %.0f s" % result["seconds"])
    elif grown[0] >= GROWTH:
        texts.append("memory grew by %.1f %%, from %.0f to %.0f MB" % (100 * grown[0], *grown[1:]))
    counted = result["counted"]
    for topic in COUNTED + WORKING:
        one = counted.get(topic) or {}
        if not one.get("messages"):
            texts.append("nothing came on %s" % topic)
        elif topic in COUNTED and one.get("lost"):
            texts.append("%d messages of %s were lost" % (one["lost"], topic))
    poses, samples = ((counted.get(topic) or {}).get("messages", 0) - result["before"].get(topic, 0)
                      for topic in ("/odometry", "/imu/data"))
    if samples and abs(samples - poses) > SAMPLES_ON_THE_WAY:
        texts.append("%d poses of %d IMU samples" % (poses, samples))
    for topic in TIMED:
        one = drift([window[topic]["p50"] for window in result["windows"] if topic in window])
        if one is None:
            texts.append("too few windows to judge the latency of %s" % topic)
        elif one[0] > DRIFT and one[2] - one[1] > DRIFT_MS:
            texts.append("latency of %s drifted from %.1f to %.1f ms" % (topic, *one[1:]))
    texts += ["%s ended and was started again" % name for name in result["restarted"]]
    if result["resets"]:
        texts.append("localisation began anew %d times" % result["resets"])
    return texts


# ---------------------------------------------------------------------------------------------------------------- bench

class Replay:
    def __init__(self, started, options, output):
        self._started, self._options, self._output = started, options, output
        self._preload = None if options.tcpros else processes.find_library(started.environment)
        self._log = output / "log" / "bench_replay.log"
        self._values = {}  # of vio: odometry

    def _preloaded(self):
        return ["env", "LD_PRELOAD=%s" % self._preload] if self._preload else []

    def _recording(self):
        """Rendered if none was given."""
        if self._options.recording:
            if not (self._options.recording / "mav0").is_dir():
                raise DemoError("--recording %s: no mav0 in it" % self._options.recording)
            return self._options.recording.resolve()
        folder = self._output / "recording"
        if not (folder / "mav0").is_dir():
            print("rendering a round", file=sys.stderr, flush=True)
            command = ["rosrun", "pi_simulation", "render_sequence", "--rounds", "1", "--start-standstill", "2",
                       "--end-standstill", "2", str(folder)]
            with open(self._log, "ab") as log:
                status = subprocess.run(command, env=self._started.environment, stdin=subprocess.DEVNULL, stdout=log,
                                        stderr=subprocess.STDOUT, check=False).returncode
            if status != 0:
                raise DemoError("no recording:\n%s" % processes.log_excerpt(self._log))
        return folder

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name == "vio: odometry":
                self._values = {pair.key: pair.value for pair in status.values}
                return "vio", self._values
        return None

    def _monitor(self, events, name, topics):
        report = self._output / ("%s.json" % name)
        report.unlink(missing_ok=True)
        events.rospy.set_param("/" + name, {"topics": topics, "report": str(report), "print_table": False,
                                            "tcp_nodelay": True})
        return self._started.start(self._preloaded() + ["rosrun", "pi_os_transport", "topic_monitor",
                                                        "__name:=" + name], self._log), report

    @staticmethod
    def _figures(report):
        """{topic: figures} of a monitor that has ended. @throws DemoError"""
        try:
            return json.loads(report.read_text(encoding="utf-8"))["topics"]
        except (OSError, ValueError, KeyError) as error:
            raise DemoError("%s is no report of topic_monitor: %s" % (report, error)) from error

    def run(self):
        """@return result as a tree for JSON. @throws DemoError"""
        options, started = self._options, self._started
        bag = convert(started, PREFIX, self._recording(), self._output / "recording.bag",
                      "--body-in-base=0 0 %s 0 0 0 1" % BODY_HEIGHT_M)
        sounds = [str(words.sound_of(word, self._output)) for word in SAID]
        processes.start_master(started, self._output / "log", stock=options.tcpros)
        events = Events(started.environment, "bench_replay")
        from diagnostic_msgs.msg import DiagnosticArray
        events.subscribe("/diagnostics", DiagnosticArray, self._on_diagnostics)
        launch = started.launch(
            ["pi_bringup", "vehicle.launch", "preload:=%s" % (self._preload or ""), "mounts:=false", "decision:=false",
             "chassis:=false", "microphone:=false", "rviz:=false", "web:=false", "announce:=false",
             "recordings:=%s" % (self._output / "recordings"),
             "together:=%s" % str(options.together).lower(), "output:=screen"], self._log)
        events.follow(launch)
        subscribers = ["imu/data /topic_monitor"] + ["%s %s" % pair for pair in (
            ("left/image_raw", "/vio"), ("right/image_raw", "/vio"), ("imu/data", "/vio"),
            ("left/image_raw", "/ssd"), ("left/image_raw", "/obstacles"))
            if not options.together] + (["left/image_raw /vehicle_manager"] if options.together else [])
        events.rospy.set_param("/sound", {"files": sounds, "loop": True, "gap_s": 8.0})
        monitor, counts = self._monitor(events, "topic_monitor", COUNTED + WORKING)
        player = started.launch(
            ["pi_bringup", "play.launch", "data:=%s" % bag, "loop:=true", "preload:=%s" % (self._preload or ""),
             "wait_for_subscribers:=%s" % subscribers], self._log)
        sound = started.start(self._preloaded() + ["rosrun", "nodelet", "nodelet", "standalone", "pi_speech/player",
                                                   "__name:=sound"], self._log)
        for name, process in (("topic_monitor", monitor), ("player", player), ("sound", sound)):
            events.watch(process, name)
        try:
            self._await_tracking(events)
            _, content = events.next(lambda kind, _: kind == "monitor", "a report of topic_monitor")
            before = {topic: content["topics"].get(topic, {}).get("messages", 0) for topic in COUNTED}
            result = self._measure(events, launch)
            result["before"] = before
        finally:
            events.close()
            for process in (sound, player, monitor):
                started.stop(process)
            started.stop(launch)
        result["counted"] = self._figures(counts)
        result["failures"] = judge(result)
        return result

    def _await_tracking(self, events):
        deadline = time.monotonic() + READY_S
        while True:
            kind, content = events.next(lambda *_: True, "localisation")
            if kind == "vio" and int(content.get("pairs used", 0)) > 100:
                return
            if time.monotonic() > deadline:
                raise DemoError("localisation does not track after %d s; from the log:\n%s" %
                                (READY_S, processes.log_excerpt(self._log)))

    def _measure(self, events, launch):
        options = self._options
        began = time.monotonic()
        first = measuring.node_processes(launch.pid)
        cpu = {name: measuring.cpu_seconds(pid) for name, pid in first.items()}
        memory, total, windows, restarted = {}, [], [], set()
        window, next_window, next_sample = None, 0.0, 0.0
        while True:
            events.next(lambda kind, _: kind == "vio", "diagnostics of localisation")  # once a second
            now = time.monotonic() - began
            if now >= next_sample:
                next_sample = now + SAMPLE_S
                pids = measuring.node_processes(launch.pid)
                restarted |= {name for name, pid in first.items() if pids.get(name) != pid}
                one = {name: (measuring.memory_mb(pid) or {}).get("kept") for name, pid in pids.items()
                       if name in SERVICES}
                for name, value in one.items():
                    if value is not None:
                        memory.setdefault(name, []).append((round(now, 1), round(value, 2)))
                total.append((round(now, 1), round(sum(value for value in one.values() if value is not None), 2)))
            if window is None and now >= next_window:
                next_window += 60.0 * options.every
                window = (*self._monitor(events, "window_monitor", TIMED), now)
            elif window is not None and now >= window[2] + WINDOW_S:
                self._started.stop(window[0])
                windows.append({topic: one["latency_ms"] for topic, one in self._figures(window[1]).items()
                                if one.get("messages") and one.get("latency_ms")})
                window = None
                self._tell(now, total[-1][1], windows[-1])
            if now >= 60.0 * options.minutes and window is None:
                break
        seconds = time.monotonic() - began
        return {"seconds": seconds, "settling_s": min(SETTLING_S, 0.25 * seconds), "memory_mb": memory,
                "total_mb": total, "windows": windows, "restarted": sorted(restarted),
                "resets": int(self._values.get("resets", 0)), "pairs": int(self._values.get("pairs used", 0)),
                "cores": {name: ((measuring.cpu_seconds(pid) or 0.0) - (cpu[name] or 0.0)) / seconds
                          for name, pid in first.items()}}

    @staticmethod
    def _tell(now, megabytes, window):
        print("%5.1f min: %.0f MB; p50/p99 [ms] %s" % (now / 60.0, megabytes, ", ".join(
            "%s %.1f/%.1f" % (topic, one["p50"], one["p99"]) for topic, one in sorted(window.items()))),
            file=sys.stderr, flush=True)


def report(result):
    """As text."""
    rows = [["service", "memory/MB", "at the end/MB", "growth %", "CPU %"]]
    lines = {**{name: result["memory_mb"][name] for name in sorted(result["memory_mb"])},
             "all": result["total_mb"]}
    for name, samples in lines.items():
        one = growth(samples, result["settling_s"])
        cores = sum(result["cores"][key] for key in result["memory_mb"]) if name == "all" else result["cores"].get(name)
        rows.append([name, "%.1f" % one[1] if one else "-", "%.1f" % one[2] if one else "-",
                     "%+.2f" % (100 * one[0]) if one else "-", "%.1f" % (100 * cores) if cores is not None else "-"])
    text = table(rows, "<>>>>")
    rows = [["topic", "p50/ms first third", "last third", "change %"]]
    for topic in TIMED:
        one = drift([window[topic]["p50"] for window in result["windows"] if topic in window])
        rows.append([topic, *(["%.2f" % one[1], "%.2f" % one[2], "%+.1f" % (100 * one[0])] if one else ["-"] * 3)])
    text += "\n\n" + table(rows, "<>>>") + "\n"
    for topic in COUNTED + WORKING:
        one = result["counted"].get(topic) or {}
        text += "\n%s: %s messages, %s lost" % (topic, one.get("messages", 0), one.get("lost", "?"))
    text += "\n%d pairs of pictures used" % result["pairs"]
    return text + "".join("\nFAILED %s" % one for one in result["failures"])


def main():
    def interrupt(*_):
        raise KeyboardInterrupt

    options = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, interrupt)
    facts = measuring.machine()
    output = options.output.resolve()
    started, status = None, 1
    try:
        (output / "log").mkdir(parents=True, exist_ok=True)
        (output / "log" / "bench_replay.log").unlink(missing_ok=True)
        started = processes.Processes(processes.ros_environment(PREFIX, output / "log"))
        result = {"machine": facts, "transport": "TCPROS" if options.tcpros else "π-OS",
                  **Replay(started, options, output).run()}
        (output / "bench_replay.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
        print("%s, %d cores, Linux %s; load average %.1f at the start, %.1f at the end; %s; %.1f min" %
              (facts["cpu"], facts["cores"], facts["kernel"], facts["load"], os.getloadavg()[0], result["transport"],
               result["seconds"] / 60.0))
        print(report(result))
        status = 1 if result["failures"] else 0
    except (DemoError, OSError) as error:
        print("bench_replay: %s" % error, file=sys.stderr)
    except KeyboardInterrupt:
        print("bench_replay: interrupted", file=sys.stderr)
        status = 130
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the clean-up is bounded
        if started is not None:
            started.stop_all()
    sys.stdout.flush()
    os._exit(status)  # rospy leaves threads behind that would wait for nodes that are gone
