"""Starts the vehicle with the computer, by a unit of systemd; says when all of it works, or what does not.

install-service writes the unit, uninstall-service removes it, run-service is what it runs."""

import os
import pwd
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from pi_bringup.doctor.computer import WANTED_NICE, WANTED_PRIORITY

UNIT = "pi-edge.service"
UNIT_FOLDER = Path("/etc/systemd/system")
LAUNCH = "pi_bringup vehicle.launch"
STATE = ".ros/pi_edge"         # below the user's home
NODES_END_S = 60               # for nodes to save what they have, after SIGINT
LAUNCH_ENDS_S = NODES_END_S + 20
READY_S = 120.0                # after the start, by when it says what is missing
STEADY_S = 3.0                 # for so long all must be well
LISTENED_S = 10.0              # for somebody to hear what is said
SENT_S = 1.0                   # for what is said to leave this process
MOST_REASONS = 3               # that are spoken
PASSED_ON = ("ROS_MASTER_URI", "ROS_HOSTNAME", "ROS_IP", "PI_EDGE_DATA")
WARN, ERROR, STALE = 1, 2, 3   # of diagnostic_msgs/DiagnosticStatus
ODOMETRY = "/Localisation/odometry"  # warns until it knows the pose; other warnings do not stop the vehicle
INSTALLED = 'Written by "pi_edge install-service", which also renews it. systemctl status pi-edge; journalctl -u pi-edge'
# Of the package: an instance per user. Arguments of vehicle.launch in the file are split at spaces.
PACKAGED = """\
systemctl enable pi-edge@USER; further arguments in /etc/pi_edge/vehicle.conf: PI_EDGE_ARGUMENTS=chassis_port:=/dev/ttyUSB0
# "pi_edge install-service" writes a unit with launch file, arguments and network of the calling shell in its place."""
TEMPLATE = """\
# {origin}
[Unit]
Description=π-Edge: {launch}
Wants=network-online.target time-sync.target
After=network-online.target time-sync.target sound.target
StartLimitIntervalSec=300
StartLimitBurst=5

[Service]
User={user}
WorkingDirectory={home}
LimitRTPRIO={priority}
LimitNICE={nice}
{environment}ExecStart={command}
Restart=on-failure
RestartSec=5
# As Ctrl-C: map, pose and recordings are saved. Only the first process gets it, which ends the others in order.
KillSignal=SIGINT
KillMode=mixed
TimeoutStopSec={stop_s}

[Install]
WantedBy=multi-user.target
"""


class ServiceError(Exception):
    """What is wrong, and the way out."""


def add_to(commands):
    """Adds the commands to pi_edge."""
    install = commands.add_parser("install-service", help="starts the vehicle with the computer: a unit of systemd",
                                  description=__doc__)
    install.add_argument("--user", help="that the vehicle runs as; default: who calls this")
    install.add_argument("--launch", default=LAUNCH, metavar="'PACKAGE FILE'", help="or a path; default: %(default)s")
    install.add_argument("--args", default="", metavar="'NAME:=VALUE ...'", help="further arguments of the launch file")
    install.add_argument("--dry-run", action="store_true", help="prints the unit and writes nothing")
    commands.add_parser("uninstall-service", help="ends the vehicle and removes its unit")
    run = commands.add_parser("run-service", help="what the unit runs: roslaunch, and an announcement when all works")
    run.add_argument("--launch", default=LAUNCH, metavar="'PACKAGE FILE'", help="or a path; default: %(default)s")
    run.add_argument("--args", default="", metavar="'NAME:=VALUE ...'", help="of the launch file")
    run.add_argument("--ready-limit", type=float, default=READY_S, metavar="SECONDS",
                     help="after which it says what is missing; default: %(default)g")


def main(options):
    """@return the exit status"""
    work = {"install-service": install, "uninstall-service": uninstall, "run-service": run}[options.command]
    try:
        return work(options)
    except ServiceError as error:
        print(f"pi_edge {options.command}: {error}", file=sys.stderr)
        return 1


# ---------------------------------------------------------------------------------------------------------------- unit

def quoted(word):
    """A word of systemd's ExecStart."""
    word = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$").replace("\n", "\\n")
    return f'"{word}"'


def launch_arguments(launch, home, given):
    """Those of vehicle.launch that a vehicle without a screen needs, and those of the user, which win."""
    state = Path(home) / STATE
    chosen = {} if launch != LAUNCH else {
        "rviz": "false", "map_file": str(state / "vehicle.map"), "save_map": "true",
        "pose_file": str(state / "vehicle.pose")}
    for word in shlex.split(given):
        name, separator, value = word.partition(":=")
        if not separator or not name:
            raise ServiceError(f"--args {word!r}, must be NAME:=VALUE")
        chosen[name] = value
    return [f"{name}:={value}" for name, value in chosen.items()]


def find_space(environment):
    """The install or devel space with this program: the folder of its setup.sh."""
    for folder in environment.get("CMAKE_PREFIX_PATH", "").split(":"):
        if folder and (Path(folder) / "setup.sh").is_file() and (Path(folder) / "lib/pi_bringup").is_dir():
            return Path(folder).resolve()
    raise ServiceError("no install space is set up here; call: . install/setup.sh")


def unit_text(user, launch, given, environment):
    try:
        account = pwd.getpwnam(user)
    except KeyError:
        raise ServiceError(f"--user {user}: there is no such user") from None
    if len(launch.split()) != 2 and not Path(launch).is_absolute():
        raise ServiceError(f"--launch {launch!r}, must be 'PACKAGE FILE', or the absolute path of a launch file")
    script = '. "$0" && exec rosrun pi_bringup pi_edge run-service "$@"'
    words = [find_space(environment) / "setup.sh", "--launch", launch,
             "--args", shlex.join(launch_arguments(launch, account.pw_dir, given))]
    return TEMPLATE.format(
        origin=INSTALLED, launch=launch, user=user, home=account.pw_dir, stop_s=LAUNCH_ENDS_S + 10,
        priority=WANTED_PRIORITY, nice=WANTED_NICE,
        environment="".join(f"Environment={quoted(name + '=' + environment[name])}\n" for name in PASSED_ON
                            if environment.get(name)),
        command=" ".join(["/bin/sh", "-c", *(quoted(str(word)) for word in (script, *words))]))


def packaged_unit(space):
    """The unit of the packages, whose user is its instance, as pi-edge@alice. @param space  their install space"""
    script = (f'. {space}/setup.sh && exec rosrun pi_bringup pi_edge run-service --args '
              f'"{" ".join(launch_arguments(LAUNCH, "$HOME", ""))} $PI_EDGE_ARGUMENTS"')
    return TEMPLATE.format(
        origin=PACKAGED, launch=LAUNCH, user="%i", home="~", stop_s=LAUNCH_ENDS_S + 10,
        priority=WANTED_PRIORITY, nice=WANTED_NICE, environment="EnvironmentFile=-/etc/pi_edge/vehicle.conf\n",
        command="/bin/sh -c " + quoted(script))


def as_root(*command):
    """@throws ServiceError"""
    words = [*([] if os.geteuid() == 0 else ["sudo"]), *(str(word) for word in command)]
    try:
        ended = subprocess.run(words, stdin=None, check=False)
    except OSError as error:
        raise ServiceError(f"{words[0]}: {error.strerror}; call this as root, or take --dry-run") from None
    if ended.returncode != 0:
        raise ServiceError(f"{shlex.join(words)} ended with status {ended.returncode}")


def install(options):
    user = options.user or pwd.getpwuid(os.geteuid()).pw_name
    if user == "root" and not options.user:
        raise ServiceError("give --user NAME: the vehicle needs no rights of root, but the groups video, audio, "
                           "dialout")
    text = unit_text(user, options.launch, options.args, os.environ)
    if options.dry_run:
        print(text, end="")
        return 0
    with tempfile.NamedTemporaryFile("w", suffix=UNIT, encoding="utf-8") as file:
        file.write(text)
        file.flush()
        as_root("install", "-m", "644", file.name, UNIT_FOLDER / UNIT)
    as_root("systemctl", "daemon-reload")
    as_root("systemctl", "enable", UNIT)
    print(f"{UNIT_FOLDER / UNIT} is written; the vehicle starts with the computer, or now: systemctl start pi-edge")
    return 0


def uninstall(_):
    if not (UNIT_FOLDER / UNIT).exists():
        raise ServiceError(f"there is no {UNIT_FOLDER / UNIT}")
    as_root("systemctl", "disable", "--now", UNIT)
    as_root("rm", UNIT_FOLDER / UNIT)
    as_root("systemctl", "daemon-reload")
    return 0


# ----------------------------------------------------------------------------------------------------------- readiness

def leaves(statuses):
    """{name: (level, message)} of a tree of diagnostic_aggregator, "/Vehicle/GROUP/STATUS", without its groups: those
    without any status, as Edge without edge nodes, count as stale there."""
    return {name: found for name, found in statuses.items() if name.count("/") >= 3}


def reasons(statuses, missing_nodes):
    """Why the vehicle is not ready, in words; [] if it is."""
    found = [f"{node.strip('/')} does not run" for node in sorted(missing_nodes)]
    bad = sorted((name, level, message) for name, (level, message) in leaves(statuses).items()
                 if level >= (WARN if name.endswith(ODOMETRY) else ERROR))
    found += [f"{name.rsplit('/', 1)[-1]}: {'says nothing' if level == STALE else message}"
              for name, level, message in bad]
    if not found and not leaves(statuses):
        found.append("nothing in the diagnostics")
    return found


class Readiness:
    """Decides what is to be said, once each: that all works, or at the end of a time what does not."""

    def __init__(self, limit_s, began_s):
        self.limit_s, self.began_s = limit_s, began_s
        self._well_since = None
        self._complained = False

    def look(self, why_not, now_s):
        """@return (text or None, whether there is no more to say)"""
        if why_not:
            self._well_since = None
            if not self._complained and now_s - self.began_s >= self.limit_s:
                self._complained = True
                more = len(why_not) - MOST_REASONS
                told = why_not[:MOST_REASONS] + ([f"and {more} more"] if more > 0 else [])
                return "not ready: " + "; ".join(told), False
            return None, False
        self._well_since = now_s if self._well_since is None else self._well_since
        return ("ready", True) if now_s - self._well_since >= STEADY_S else (None, False)


class Announcer(threading.Thread):
    """Looks at the graph until the vehicle is ready, and says so: on the topic `say`, and in the log."""

    def __init__(self, nodes, limit_s):
        super().__init__(daemon=True)
        self._nodes, self._limit_s = nodes, limit_s
        self._lock = threading.Lock()
        self._statuses = {}

    def run(self):
        import rosgraph
        import rospy
        from diagnostic_msgs.msg import DiagnosticArray
        from std_msgs.msg import String
        readiness = Readiness(self._limit_s, time.monotonic())
        master = rosgraph.Master("/pi_edge_service")
        while not master.is_online():
            time.sleep(0.5)
        rospy.init_node("pi_edge_service", disable_signals=True)
        say = rospy.Publisher("say", String, queue_size=5, latch=True)
        rospy.Subscriber("/diagnostics_agg", DiagnosticArray, self._on_tree)
        done = False
        while not done:
            time.sleep(0.5)
            try:
                running = {node for topics in master.getSystemState() for _, names in topics for node in names}
            except (OSError, rosgraph.MasterException):
                continue  # ends, or begins again
            with self._lock:
                why_not = reasons(self._statuses, set(self._nodes) - running)
            text, done = readiness.look(why_not, time.monotonic())
            if text:
                print(f"pi_edge: {text}", flush=True)
                say.publish(String(text))
        deadline = time.monotonic() + LISTENED_S  # latched: who comes now hears it, too
        while say.get_num_connections() == 0 and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(SENT_S)
        rospy.signal_shutdown("all is said")  # an announcer that starts again later does not repeat it

    def _on_tree(self, message):
        with self._lock:
            self._statuses = {status.name: (ord(status.level) if isinstance(status.level, bytes) else status.level,
                                            status.message) for status in message.status}


# ----------------------------------------------------------------------------------------------------------------- run

def run(options):
    """@return 0 after SIGINT or SIGTERM, 1 if roslaunch ended by itself: systemd then starts it again"""
    import first_drive
    del sys.argv[1:]  # rospy would take the value of --args for a remapping
    words = [*([options.launch] if Path(options.launch).is_absolute() else options.launch.split()),
             *shlex.split(options.args)]
    (Path.home() / STATE).mkdir(parents=True, exist_ok=True)
    listed = subprocess.run(["roslaunch", "--nodes", *words], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                            check=False)
    if listed.returncode != 0:
        raise ServiceError(f"roslaunch {shlex.join(words)}: {listed.stderr.strip() or listed.stdout.strip()}")
    # A session of its own: Ctrl-C on a terminal reaches this process alone, as systemd's signal does.
    launch = subprocess.Popen([sys.executable, "-P", Path(first_drive.__file__).with_name("launcher.py"),
                               "--disable-title", f"--sigint-timeout={NODES_END_S}", *words], stdin=subprocess.DEVNULL,
                              start_new_session=True)
    stopping = False

    def stop(*_):  # takes no lock, whatever this thread was doing
        nonlocal stopping
        if not stopping:
            stopping = True
            launch.send_signal(signal.SIGINT)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    nodes = [line.strip() for line in listed.stdout.splitlines() if line.startswith("/")]
    Announcer(nodes, options.ready_limit).start()
    while not stopping and launch.poll() is None:
        time.sleep(0.2)
    if not stopping:
        print(f"pi_edge: roslaunch has ended by itself, with status {launch.returncode}", file=sys.stderr)
        return 1
    try:
        launch.wait(LAUNCH_ENDS_S)
    except subprocess.TimeoutExpired:
        launch.kill()
        print(f"pi_edge: roslaunch did not end within {LAUNCH_ENDS_S} s; it was killed", file=sys.stderr)
        return 1
    print("pi_edge: the vehicle is shut down", flush=True)
    return 0
