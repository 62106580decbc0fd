"""Measures offloading with real processes: the vehicle's nodes and edge servers on devices of their own (network
namespaces of this machine, needs root), joined by radio links that follow the vehicle, and break.

  rosrun pi_offload bench_offload [--quick] [--only PHASE] [--json FILE]

Phases: `cpu` (processor time of the vehicle, all local and offloaded in turn, and response times over a LAN), `drive`
(along the route of a scenario's file, links as good as the distance allows), `kills` (SIGKILL of the node that serves,
and a restart, again and again), `cuts` (its link pulled out, or silent), `spikes` (all links 300 ms slower for 1 s).

Exit status: 0; 1 if a task did not get exactly one answer; 2 for a wrong command line; 3 if it cannot run here.
"""

import argparse
import dataclasses
import json
import os
import platform
import sys
import time
from pathlib import Path

import roslib.packages

from pi_offload import testbed_account as accounts
from pi_offload.errors import ToolError
from pi_offload.interrupts import end_by_signals
from pi_offload.testbed_road import load_road

PHASES = ("cpu", "drive", "kills", "cuts", "spikes")
LINK_PERIOD_S = 0.5
SPIKE_S = 0.3
PAPER = {"detection": (25, 12), "speech": (20, 5)}  # [%] of a processor: local, offloaded
RESPONSE_BAR_S = {"detection": 0.1, "speech": 0.2}
SOUND_TEST_DATA = Path("/usr/share/pocketsphinx/test/data/cards")
PICTURE_FILES = (".jpg", ".jpeg", ".png")
PICTURE_TEST_DATA = Path("/usr/share/doc/opencv-doc/examples/data")


@dataclasses.dataclass
class Plan:
    phases: tuple = PHASES
    rounds: int = 3          # of local and offloaded in turn
    pictures: int = 300      # in each
    drive_m: float = 1e9     # of the route at most
    kills: int = 50
    cuts: int = 10
    spikes: int = 10

    @classmethod
    def quick(cls):
        return cls(rounds=1, pictures=60, drive_m=60.0, kills=3, cuts=2, spikes=2)


class Bench:
    """Runs the phases on a bed. results: {phase: {kind: account}}."""

    def __init__(self, bed, plan, say):
        self._bed, self._plan, self._say = bed, plan, say
        self.results = {}
        self.failures = []
        self._policy = bed.judge("policy", name="")  # the default

    def run(self):
        for phase in self._plan.phases:
            self._bed.lan()
            self._bed.stand_between()
            self._bed.await_all()
            self._say(f"{phase} ...")
            getattr(self, phase)()

    def _count(self, phase, seen):
        """Adds what the vehicle saw to a phase's results."""
        for kind, account in (
                ("detection", accounts.detection_account(seen["pictures"], seen["results"], seen["decisions"])),
                ("speech", accounts.speech_account(seen["decisions"], seen["commands"]))):
            self.failures += accounts.violations(account, f"{phase}, {kind}")
            rows = self.results.setdefault(phase, {}).setdefault(kind, {"parts": []})
            rows["parts"].append(account)
            rows.update(accounts.add({name: value for name, value in rows.items() if name != "parts"}, account))
        self.results[phase].setdefault("decisions", []).extend(seen["decisions"])
        return seen

    def cpu(self):
        """Local and offloaded in turn, as what else the machine does changes."""
        for _ in range(self._plan.rounds):
            for phase, policy in (("local", "local"), ("offloaded", self._policy)):
                self._bed.judge("policy", name=policy)
                self._bed.judge("await_detections", count=20)
                self._bed.judge("begin")
                before, began = self._bed.cpu_seconds(), time.monotonic()
                self._bed.judge("await_pictures", count=self._plan.pictures)
                after, ended = self._bed.cpu_seconds(), time.monotonic()
                self._count(phase, self._bed.judge("end"))
                share = {name: (after[name] - before[name]) / (ended - began) for name in after}
                self.results[phase].setdefault("cpu", []).append(share)
                self._say(f"  {phase}: " + ", ".join(f"{name} {100 * value:.1f} %" for name, value in share.items()))
        self._bed.judge("policy", name=self._policy)

    def drive(self):
        length = min(self._bed.road.length_m, self._plan.drive_m)
        self._bed.drive_links(0.0)
        began = time.monotonic()
        self._bed.judge("drive", began=began)
        self._bed.judge("begin")
        while (time.monotonic() - began) * self._bed.road.speed < length:
            self._bed.drive_links((time.monotonic() - began) * self._bed.road.speed)
            time.sleep(LINK_PERIOD_S)
        self._count("drive", self._bed.judge("end"))

    def _faults(self, phase, count, fault):
        """One fault after the other, each once a node serves; `fault` gets that node and the number of the fault."""
        self._bed.judge("begin")
        for number in range(count):
            node = self._bed.judge("await_remote", count=5)
            fault(node, number)
            self._bed.await_all()
            if number % 10 == 9:
                self._say(f"  {number + 1} of {count}")
        self._bed.judge("await_remote", count=5)
        self._count(phase, self._bed.judge("end"))
        self.results[phase]["faults"] = count

    def kills(self):
        def kill(node, _):
            self._bed.kill_server(node)
            self._bed.judge("await_detections", count=10)
            self._bed.start_server(node)
        self._faults("kills", self._plan.kills, kill)

    def cuts(self):
        def cut(node, number):
            link = self._bed.links[node]
            if number % 2:
                link.set(100.0, 0.0, 1.0)
            else:
                link.up(False)
            self._bed.judge("await_detections", count=20)
            link.up(True)
            self._bed.lan()
        self._faults("cuts", self._plan.cuts, cut)

    def spikes(self):
        def spike(*_):
            for link in self._bed.links.values():
                link.set(100.0, SPIKE_S, 0.0)
            self._bed.judge("await_detections", count=10)
            self._bed.lan()
        self._faults("spikes", self._plan.spikes, spike)


# ----------------------------------------------------------------------------------------------------------- the report

def _ms(value):
    return "-" if value is None or value != value else f"{1e3 * value:.0f}"


def _median(values):
    return accounts.quantile(values, 0.5)


def report(results):
    """Tables of Markdown."""
    lines = []
    if "offloaded" in results:
        managers = {"detection": "detection_manager", "speech": "speech_manager"}
        lines += ["| processor time of the vehicle, % of a core | local | offloaded | the paper's |",
                  "|---|---|---|---|"]
        for kind, manager in managers.items():
            shares = [[100 * share[manager] for share in results[phase]["cpu"] if manager in share]
                      for phase in ("local", "offloaded")]
            if shares[0]:
                local, offloaded = (f"{_median(values):.1f} ({min(values):.1f} to {max(values):.1f})"
                                    for values in shares)
                lines.append(f"| {kind} | {local} | {offloaded} | {PAPER[kind][0]} -> {PAPER[kind][1]} |")
        lines += ["", "| response time over the LAN [ms] | tasks | by nodes | p50 | p95 | p99 | bar |",
                  "|---|---|---|---|---|---|---|"]
        for kind, bar_s in RESPONSE_BAR_S.items():
            response = [decision["response_s"] for decision in results["offloaded"]["decisions"]
                        if decision["kind"] == kind and decision["how"] == "remote"]
            account = results["offloaded"][kind]
            if account["tasks"]:
                lines.append(f"| {kind} | {account['tasks']} | {account['remote']} | " + " | ".join(
                    _ms(accounts.quantile(response, share)) for share in (0.5, 0.95, 0.99)) + f" | {_ms(bar_s)} |")
        lines.append("")
    lines += ["| phase | tasks | faults | once | dropped | twice | never | by nodes | by the vehicle | fallbacks | "
              "given up | late | latest by [ms] | handovers |",
              "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"]
    for phase, result in results.items():
        for kind in ("detection", "speech"):
            account = result[kind]
            if not account["tasks"]:
                continue
            once = account["once"] if kind == "detection" else account["tasks"] - account["twice"]
            never = account["never"] if kind == "detection" else account["abandoned"]
            numbers = (account["tasks"], result.get("faults", "-"), once, account.get("dropped", 0), account["twice"],
                       never, account["remote"], account["local"], account["fallback"], account["abandoned"],
                       account["late"], _ms(account["latest_s"]), account["handovers"])
            lines.append(f"| {phase}, {kind} | " + " | ".join(str(number) for number in numbers) + " |")
    return "\n".join(lines)


def machine_text():
    model = platform.machine()
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        for line in file:
            if line.lower().startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    return (f"{model}, {len(os.sched_getaffinity(0))} core(s), Linux {platform.release()}, load average "
            f"{os.getloadavg()[0]:.1f}")


# ------------------------------------------------------------------------------------------------------------ the input

def find_pictures(folder):
    """Files of a folder, or those that there are. @throws ToolError"""
    recordings = os.environ.get("PI_EDGE_DATA")
    folders = [Path(folder)] if folder else ([Path(recordings) / "detect/images_dev"] if recordings else []) + [
        PICTURE_TEST_DATA]
    for candidate in folders:
        found = sorted(path.resolve() for path in candidate.glob("*") if path.suffix.lower() in PICTURE_FILES)
        if found:
            return found
    raise ToolError("no pictures (jpg, png) in " + ", ".join(str(path) for path in folders) +
                    ": name a folder with --pictures, or install opencv-doc")


def find_sounds(given):
    """Sound files or folders, or those that there are; none: no speech. @throws ToolError"""
    recordings = os.environ.get("PI_EDGE_DATA")
    if given:
        if not Path(given).exists():
            raise ToolError(f"--sounds {given}: there is no such file or folder")
        return [Path(given).resolve()]
    if recordings and (Path(recordings) / "speech/commands").is_dir():
        words = ("go", "stop", "left", "right", "yes", "no")
        return [(Path(recordings) / "speech/commands" / word).resolve() for word in words]
    return [SOUND_TEST_DATA] if list(SOUND_TEST_DATA.glob("*.wav")) else []


def positive(text):
    if not text.strip().isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}, must be a whole number of at least 1")
    return int(text)


def parse(arguments):
    parser = argparse.ArgumentParser(prog="bench_offload", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small subset, about 2 min")
    parser.add_argument("--only", action="append", choices=PHASES, help="may be given more than once")
    for name, text in (("rounds", "of local and offloaded in turn"), ("pictures", "in each round"),
                       ("kills", "of nodes"), ("cuts", "of links"), ("spikes", "of delay")):
        parser.add_argument("--" + name, type=positive, help=text)
    parser.add_argument("--scenario", metavar="FILE", help="of the road; default: config/scenarios/testbed.yaml")
    parser.add_argument("--pictures-from", metavar="FOLDER", help="default: detect/images_dev of $PI_EDGE_DATA, else "
                        "those of opencv-doc")
    parser.add_argument("--sounds", metavar="FOLDER", help="or file; default: commands of $PI_EDGE_DATA, else "
                        "pocketsphinx-testdata")
    parser.add_argument("--link", choices=("tun", "netem"), default="tun", help="what makes the links slow; netem "
                        "needs a kernel with sch_netem")
    parser.add_argument("--model", metavar="NETWORK", help="of the vehicle; default: that of config/ssd.yaml")
    parser.add_argument("--node-model", metavar="NETWORK", help="of the nodes; default: that of "
                        "config/edge_server.yaml")
    parser.add_argument("--json", metavar="FILE", help="write everything measured to FILE")
    # rosrun and roslaunch add remappings such as __name:=x.
    return parser.parse_args([argument for argument in arguments if ":=" not in argument])


def make_plan(options):
    plan = Plan.quick() if options.quick else Plan()
    for name in ("rounds", "pictures", "kills", "cuts", "spikes"):
        if getattr(options, name):
            setattr(plan, name, getattr(options, name))
    if options.only:
        plan.phases = tuple(phase for phase in PHASES if phase in options.only)
    return plan


def run(options, say):
    """@return (results, failures). @throws ToolError, testbed.Unsupported"""
    from pi_offload import testbed  # looks for programs of other packages
    scenario = options.scenario or Path(roslib.packages.get_pkg_dir("pi_offload")) / "config/scenarios/testbed.yaml"
    sounds = find_sounds(options.sounds)
    if not sounds:
        say("without speech: there are no sounds; set PI_EDGE_DATA or install pocketsphinx-testdata")
    try:
        with testbed.Bed(scenario, load_road(scenario), find_pictures(options.pictures_from), sounds,
                         options.link, model=options.model, node_model=options.node_model) as bed:
            bench = Bench(bed, make_plan(options), say)
            try:
                bench.run()
            except (ToolError, testbed.BenchError) as error:
                bench.failures.append(f"{error}\n{bed.describe()}")
            return bench.results, bench.failures
    except testbed.Unsupported:
        raise
    except testbed.BenchError as error:
        raise ToolError(str(error)) from error


def main():
    options = parse(sys.argv[1:])
    from pi_offload import testbed
    end_by_signals()
    machine, began = machine_text(), time.monotonic()
    try:
        if options.json and not os.access(Path(options.json).resolve().parent, os.W_OK):
            raise ToolError(f"--json {options.json}: its folder does not exist or is not writable")
        results, failures = run(options, lambda text: print(text, file=sys.stderr, flush=True))
    except (ToolError, testbed.BenchError) as error:
        print(f"bench_offload: {error}", file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        print("bench_offload: interrupted", file=sys.stderr)
        return 130
    print(f"{machine} at the start, {os.getloadavg()[0]:.1f} at the end; {time.monotonic() - began:.0f} s\n")
    print(report(results))
    if options.json:
        with open(options.json, "w", encoding="utf-8") as file:
            json.dump({"machine": machine, "results": results, "failures": failures}, file, indent=1)
    for failure in failures:
        print(f"bench_offload: FAILED: {failure}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
