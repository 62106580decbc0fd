"""The unit of systemd, what is said of readiness, and the program of the unit with a vehicle of a few nodes."""

import os
import pwd
import re
import shutil
import signal
import socket
import subprocess
import tempfile
import unittest
from pathlib import Path

from pi_bringup import service

SPACE = os.environ.get("SPACE", "")
USER = pwd.getpwuid(os.geteuid()).pw_name
LIMIT_S = 300.0


def free_port():
    with socket.socket() as one:
        one.bind(("localhost", 0))
        return one.getsockname()[1]


class Unit(unittest.TestCase):
    def text(self, launch=service.LAUNCH, given="", **environment):
        return service.unit_text(USER, launch, given, {"CMAKE_PREFIX_PATH": f"/nowhere:{SPACE}", **environment})

    def test_words_survive_systemd_and_the_shell(self):
        text = self.text(given="chassis_port:=usb-FTDI 'microphone_device:=USB PnP 100%' 'model:=a\"b$c'")
        command, = re.findall("^ExecStart=(.*)$", text, re.MULTILINE)
        words = [re.sub(r"\\(.)", r"\1", word).replace("%%", "%").replace("$$", "$")
                 for word in re.findall(r'"((?:[^"\\]|\\.)*)"', command)]
        self.assertEqual("/bin/sh -c", command.split('"')[0].strip())
        arguments = service.shlex.split(words[-1])
        for argument in ("chassis_port:=usb-FTDI", "microphone_device:=USB PnP 100%", 'model:=a"b$c', "rviz:=false",
                         "save_map:=true"):
            self.assertIn(argument, arguments)
        self.assertEqual(str(Path(SPACE).resolve() / "setup.sh"), words[1])

    def test_what_doctor_asks_for_is_granted(self):
        self.assertIn("\nLimitRTPRIO=16\nLimitNICE=-10\n", self.text())

    def test_what_the_user_gives_wins(self):
        arguments = service.launch_arguments(service.LAUNCH, "/home/x", "rviz:=true pose_file:=/p")
        self.assertEqual(["rviz:=true", "map_file:=/home/x/.ros/pi_edge/vehicle.map", "save_map:=true",
                          "pose_file:=/p"], arguments)
        self.assertEqual([], service.launch_arguments("my_vehicle my.launch", "/home/x", ""))

    def test_the_master_of_the_shell_is_that_of_the_unit(self):
        self.assertIn('Environment="ROS_HOSTNAME=vehicle"\n', self.text(ROS_HOSTNAME="vehicle"))
        self.assertNotIn("Environment", self.text())

    def test_wrong_command_lines_are_named(self):
        for arguments, part in ((("nobody here", service.LAUNCH, "", {}), "there is no such user"),
                                ((USER, "vehicle.launch", "", {}), "must be 'PACKAGE FILE'"),
                                ((USER, service.LAUNCH, "rviz", {}), "--args 'rviz', must be NAME:=VALUE"),
                                ((USER, service.LAUNCH, "", {}), "call: . install/setup.sh")):
            environment = {"CMAKE_PREFIX_PATH": SPACE} if "setup.sh" not in part else {}
            with self.subTest(part), self.assertRaisesRegex(service.ServiceError, re.escape(part)):
                service.unit_text(*arguments[:3], environment)

    def test_the_packages_unit_has_an_instance_per_user(self):
        """And its line of the shell starts run-service with files of that user and the arguments of the file."""
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "setup.sh").touch()
            rosrun = Path(folder) / "rosrun"
            rosrun.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n', encoding="utf-8")
            rosrun.chmod(0o755)
            text = service.packaged_unit(folder)
            self.assertIn("\nUser=%i\nWorkingDirectory=~\n", text)
            self.assertIn("\nEnvironmentFile=-/etc/pi_edge/vehicle.conf\n", text)
            line = re.search(r'^ExecStart=/bin/sh -c "(.*)"$', text, re.MULTILINE).group(1)
            words = subprocess.run(
                ["/bin/sh", "-c", re.sub(r"\\(.)", r"\1", line).replace("$$", "$")], capture_output=True, text=True,
                check=True, env={"PATH": f"{folder}:/usr/bin:/bin", "HOME": "/home/alice", "PI_EDGE_ARGUMENTS": "web:=false"})
            self.assertEqual(["pi_bringup", "pi_edge", "run-service", "--args"], words.stdout.splitlines()[:4])
            self.assertEqual(
                service.launch_arguments(service.LAUNCH, "/home/alice", "web:=false"), words.stdout.splitlines()[4].split())

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
    def test_systemd_finds_nothing_wrong(self):
        with tempfile.TemporaryDirectory() as folder:
            unit = Path(folder) / service.UNIT
            unit.write_text(self.text(given="'microphone_device:=USB PnP 100%'", ROS_HOSTNAME="vehicle"),
                            encoding="utf-8")
            checked = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], stdin=subprocess.DEVNULL,
                                     capture_output=True, text=True, timeout=60, check=False)
            self.assertEqual((0, ""), (checked.returncode, checked.stdout + checked.stderr))
            unit.write_text(self.text().replace("KillMode=mixed", "KillMode=never"), encoding="utf-8")
            wrong = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], stdin=subprocess.DEVNULL,
                                   capture_output=True, text=True, timeout=60, check=False)
            self.assertIn("kill mode", wrong.stderr, "it would have been found")


class Ready(unittest.TestCase):
    TREE = {"/Vehicle": (2, "Error"), "/Vehicle/Sensors": (2, "Error"),
            "/Vehicle/Sensors/camera": (2, "camera /dev/video0 is not there"), "/Vehicle/Chassis": (3, "All Stale"),
            "/Vehicle/Chassis/line": (3, "Missing"), "/Vehicle/Edge": (3, "Stale"), "/Vehicle/Power/watts": (1, "a model")}

    def test_reasons(self):
        self.assertEqual(["line: says nothing", "camera: camera /dev/video0 is not there"],
                         service.reasons(self.TREE, set()))
        self.assertEqual(["vio does not run"], service.reasons({}, {"/vio"}))
        self.assertEqual(["odometry: no pictures yet"],
                         service.reasons({"/Vehicle/Localisation/odometry": (1, "no pictures yet")}, set()))
        self.assertEqual(["nothing in the diagnostics"], service.reasons({"/Vehicle": (3, "Stale")}, set()))
        self.assertEqual([], service.reasons({"/Vehicle": (2, "Error"), "/Vehicle/Edge": (3, "Stale"),
                                              "/Vehicle/Power/power: watts": (1, "a model")}, set()), "no edge nodes")

    def test_each_is_said_once(self):
        one = service.Readiness(limit_s=60.0, began_s=0.0)
        self.assertEqual((None, False), one.look(["a"], 59.0))
        self.assertEqual(("not ready: a; b; c; and 1 more", False), one.look(["a", "b", "c", "d"], 60.0))
        self.assertEqual((None, False), one.look(["a"], 61.0))
        self.assertEqual((None, False), one.look([], 62.0))
        self.assertEqual((None, False), one.look(["a"], 64.0), "not steady")
        self.assertEqual((None, False), one.look([], 65.0))
        self.assertEqual(("ready", True), one.look([], 68.0))


class Run(unittest.TestCase):
    """As the unit would run it, with a master of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.output = ""

    def start(self, launch, *arguments, ready_limit=90):
        # That of systemd is as empty.
        environment = {"PATH": "/usr/bin:/bin", "HOME": str(self.folder), "LANG": "C.UTF-8",
                       "ROS_HOSTNAME": "localhost", "ROS_MASTER_URI": f"http://localhost:{free_port()}",
                       "PYTHONUNBUFFERED": "1"}
        command = ['. "$0" && exec rosrun pi_bringup pi_edge run-service "$@"', f"{SPACE}/setup.sh", "--launch", launch,
                   "--args", service.shlex.join(arguments), "--ready-limit", str(ready_limit)]
        self.process = subprocess.Popen(["nice", "-n", "10", "/bin/sh", "-c", *command], env=environment,
                                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                        text=True, start_new_session=True)
        self.addCleanup(self.process.stdout.close)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        watchdog = service.threading.Timer(LIMIT_S, self.process.send_signal, [signal.SIGINT])
        watchdog.start()
        self.addCleanup(watchdog.cancel)

    def await_output(self, part):
        for line in self.process.stdout:
            self.output += line
            if part in line:
                return line
        self.fail(f"ended without {part!r}:\n{self.output}")

    def finish(self, number=signal.SIGINT):
        if number:
            self.process.send_signal(number)
        self.output += self.process.stdout.read()
        return self.process.wait()

    def own_launch_file(self, nodes):
        file = self.folder / "tiny.launch"
        file.write_text(f"<launch>{nodes}</launch>", encoding="utf-8")
        return str(file)

    def test_map_and_pose_are_saved_at_the_end(self):
        state = self.folder / "state"
        state.mkdir()
        self.start("pi_bringup simulation.launch", f"map_file:={state}/vehicle.map", "save_map:=true",
                   f"pose_file:={state}/vehicle.pose", f"link:={self.folder}/chassis", "detection:=false",
                   "obstacles:=false", "speech:=false", "power:=false", "record:=false", "runtime:=false",
                   "rviz:=false")
        self.await_output("pi_edge: ready")
        self.assertEqual(0, self.finish(), self.output)
        self.assertIn("the vehicle is shut down", self.output)
        self.assertEqual({"vehicle.map", "vehicle.pose"}, {path.name for path in state.iterdir()}, self.output)
        self.assertGreater((state / "vehicle.map").stat().st_size, 1000)

    def test_says_what_is_missing(self):
        self.start(self.own_launch_file('<node pkg="rostopic" type="rostopic" name="listener" args="echo /say" '
                                        'output="screen"/>'), ready_limit=2)
        # The computer may be so busy that the node takes longer.
        self.assertRegex(self.await_output("pi_edge: not ready"),
                         "not ready: (nothing in the diagnostics|listener does not run)$")
        self.await_output('data: "not ready: ')  # what the announcer would say
        self.assertEqual(0, self.finish(signal.SIGTERM), self.output)

    def test_a_vehicle_that_ends_by_itself_is_an_error(self):
        self.start(self.own_launch_file('<node pkg="tf2_ros" type="static_transform_publisher" name="mount" '
                                        'args="wrong" required="true"/>'))
        self.assertEqual(1, self.finish(None), self.output)
        self.assertIn("roslaunch has ended by itself", self.output)

    def test_a_launch_file_that_is_wrong_is_named(self):
        self.start("pi_bringup nowhere.launch")
        self.assertEqual(1, self.finish(None), self.output)
        self.assertIn("nowhere.launch", self.output)


if __name__ == "__main__":
    unittest.main()
