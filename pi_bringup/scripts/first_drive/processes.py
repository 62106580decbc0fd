"""Starting and ending everything that the demo runs."""

import ctypes
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
import uuid
import xmlrpc.client
from pathlib import Path

from first_drive.errors import DemoError

DEBIAN_PACKAGES = {"roslaunch": "python3-roslaunch", "rosmaster": "python3-rosmaster", "rosbag": "python3-rosbag",
                   "rviz": "rviz", "import": "imagemagick", "xwininfo": "x11-utils", "Xvfb": "xvfb"}
PR_SET_PDEATHSIG = 1


def check_programs(names=tuple(DEBIAN_PACKAGES)):
    """@throws DemoError naming the programs that are missing and the packages that bring them."""
    missing = [name for name in names
               if shutil.which(name) is None and not (name == "Xvfb" and os.environ.get("DISPLAY"))]
    if missing:
        raise DemoError("not installed: %s; run: apt-get install %s" %
                        (", ".join(missing), " ".join(sorted({DEBIAN_PACKAGES[name] for name in missing}))))


def ros_environment(prefix, log_folder):
    """The environment that setup.sh of `prefix` gives, whatever the shell of the user has or has not sourced."""
    environment = {key: value for key, value in os.environ.items()
                   if not key.startswith(("ROS_", "PI_OS_"))
                   and key not in ("LD_PRELOAD", "PYTHONPATH", "CMAKE_PREFIX_PATH")}
    result = subprocess.run(["sh", "-c", '. "$1" && exec env -0', "sh", str(prefix / "setup.sh")], env=environment,
                            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if result.returncode != 0:
        raise DemoError("%s cannot be sourced: %s" % (prefix / "setup.sh", result.stderr.decode().strip()))
    environment = dict(entry.split("=", 1) for entry in result.stdout.decode().split("\0") if "=" in entry)
    environment.update({"ROS_HOSTNAME": "localhost", "ROS_LOG_DIR": str(log_folder), "PYTHONUNBUFFERED": "1"})
    return environment


def package_folder(environment):
    """Of pi_bringup, with config and launch."""
    result = subprocess.run(["rospack", "find", "pi_bringup"], env=environment, stdin=subprocess.DEVNULL,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=60)
    if result.returncode != 0:
        raise DemoError("pi_bringup is not found: %s" % result.stderr.strip())
    return Path(result.stdout.strip())


def log_excerpt(path, lines=10):
    """What a log says went wrong first, else its end; indented and without the colours and titles meant for a terminal.
    Errors are those that nodes log, or else what a process said last before roslaunch found it dead."""
    try:
        text = Path(path).read_text(errors="replace")
    except OSError as error:
        return "    %s: %s" % (path, error.strerror)
    text = re.sub(r"\x1b(\[[0-9;]*m|\][^\x07]*\x07)", "", text)
    all_lines = text.splitlines()
    told = [line for line in all_lines if line.strip() and not re.match(r"\[ *(INFO|DEBUG)\]|process\[.*started", line)]
    death = next((index for index, line in enumerate(told) if re.search(r"process.*has died", line)), len(told))
    found = [line for line in told[:death] if re.match(r"\[ *(FATAL|ERROR)\]", line)]
    if not found and death < len(told):
        found = told[max(0, death - 1):death + 2]
    return "\n".join("    " + line for line in (found[:lines] or all_lines[-lines:]) + ["(all of it: %s)" % path])


def await_end(descriptors, timeout_s):
    """Waits until the processes behind all pid descriptors have ended. @return False when the time is over first."""
    deadline = time.monotonic() + timeout_s
    poll = select.poll()
    for descriptor in descriptors:
        poll.register(descriptor, select.POLLIN)
    left = set(descriptors)
    while left:
        ended = poll.poll(max(0.0, deadline - time.monotonic()) * 1000)
        if not ended:
            return False
        for descriptor, _ in ended:
            poll.unregister(descriptor)
            left.discard(descriptor)
    return True


class Processes:
    """Everything the demo starts. Each process leads a session of its own, so that Ctrl-C on the terminal reaches
    only the demo, which then ends them in order; all their descendants carry a mark in their environment."""

    MARK = "PI_BRINGUP_DRIVE_DEMO"

    def __init__(self, environment):
        self.mark = uuid.uuid4().hex
        self.environment = dict(environment)
        self.environment[self.MARK] = self.mark
        self.running = []
        self.core = {}  # name: pid of the ROS master, see start_master()

    def start(self, command, log_path, pass_fds=()):
        """Appends what the process prints to `log_path`. Main thread only: the process ends with the thread that
        started it, so that nothing stays even if the demo is killed."""
        libc = ctypes.CDLL(None)
        with open(log_path, "ab") as log:
            process = subprocess.Popen([str(word) for word in command], env=self.environment,
                                       stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                                       start_new_session=True, pass_fds=pass_fds,
                                       preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM))
        process.log_path = log_path
        self.running.append(process)
        return process

    def launch(self, arguments, log_path):
        """roslaunch with these arguments; as start()."""
        # -P: the modules beside it are none of roslaunch's.
        return self.start([sys.executable, "-P", Path(__file__).with_name("launcher.py"), *arguments], log_path)

    def start_announced(self, name, command, log_path):
        """Starts a program that gets the number of a descriptor as its last argument and writes a line to it once it
        is ready. @return that line. @throws DemoError if the program ended before."""
        read_end, write_end = os.pipe()
        with os.fdopen(read_end) as pipe:
            try:
                process = self.start([*command, write_end], log_path, pass_fds=(write_end,))
            finally:
                os.close(write_end)
            line = pipe.readline().strip()
        if not line:
            self.stop(process)
            raise DemoError("%s did not start:\n%s" % (name, log_excerpt(log_path)))
        return line

    def stop(self, process):
        """SIGINT, and what is stronger if that does not help."""
        if process.poll() is None:
            descriptor = os.pidfd_open(process.pid)
            try:
                # roslaunch itself allows its nodes 15 s before it becomes firmer.
                for number, patience_s in ((signal.SIGINT, 30), (signal.SIGTERM, 5), (signal.SIGKILL, 5)):
                    process.send_signal(number)
                    if await_end([descriptor], patience_s):
                        process.wait()
                        break
            finally:
                os.close(descriptor)
        if process in self.running:
            self.running.remove(process)

    def marked(self):
        """{pid descriptor: process id} of all descendants, whoever their parent is now. The caller closes them."""
        found = {}
        mark = (self.MARK + "=" + self.mark).encode()
        for entry in os.listdir("/proc"):
            if entry.isdigit() and int(entry) != os.getpid():
                try:
                    descriptor = os.pidfd_open(int(entry))
                except OSError:
                    continue  # ended, or a thread
                try:
                    with open("/proc/%s/environ" % entry, "rb") as file:
                        if mark in file.read().split(b"\0"):
                            found[descriptor] = int(entry)
                except OSError:
                    pass  # ended, or another user's
                if descriptor not in found:
                    os.close(descriptor)
        return found

    def stop_all(self):
        for process in reversed(list(self.running)):
            self.stop(process)
        left = {}
        for number in (signal.SIGTERM, signal.SIGKILL):
            left = self.marked()
            for descriptor in left:
                try:
                    signal.pidfd_send_signal(descriptor, number)
                except ProcessLookupError:
                    pass
            ended = await_end(left, 5)
            for descriptor in left:
                os.close(descriptor)
            if ended:
                return
        print("warning: processes %s could not be ended" % sorted(left.values()), file=sys.stderr)


def set_parameter(environment, name, value):
    """On the master of start_master(). @throws OSError"""
    with xmlrpc.client.ServerProxy(environment["ROS_MASTER_URI"]) as master:
        master.setParam("/drive", name, value)


def find_in_spaces(environment, path):
    """A file of the install or devel spaces of an environment, or None. @param path  below their lib/"""
    folders = [Path(folder) / "lib" for folder in environment.get("CMAKE_PREFIX_PATH", "").split(":") if folder]
    return next((folder / path for folder in folders if (folder / path).is_file()), None)


def find_library(environment, name="libpi_os_transport.so"):
    """A library in the install or devel spaces of an environment. @throws DemoError"""
    found = find_in_spaces(environment, name)
    if found is None:
        raise DemoError("%s is in no space of CMAKE_PREFIX_PATH; build and install pi_os_transport, or drive over TCPROS "
                        "(--tcpros)" % name)
    return found


def start_master(processes, log_folder, stock=False):
    """A master on a port nobody uses, known to all processes started from now on; returns its URI.
    @param stock  rosmaster, to compare with, and roslaunch adds rosout. Else pi_core, which is both.
    @throws DemoError"""
    if stock:
        name, command = "rosmaster", [sys.executable, Path(__file__).with_name("ros_master.py")]
    else:
        program = find_in_spaces(processes.environment, "pi_os_transport/pi_core")
        if program is None:
            raise DemoError("pi_core is in no space of CMAKE_PREFIX_PATH; build and install pi_os_transport")
        name, command = "pi_core", [program, "-p", "0", "--announce"]
    uri = processes.start_announced("the ROS master", command, log_folder / ("%s.log" % name))
    processes.core = {name: processes.running[-1].pid}
    processes.environment["ROS_MASTER_URI"] = uri
    return uri
