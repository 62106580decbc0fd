"""The image of the vehicle: what it holds, and its page in a container that runc starts.

The container's space lies on this machine's file system in place of packages: that takes seconds and no network. `make
image` makes the one of Debian packages. PI_EDGE_SPACE names another install space than the one of "make build".
"""

import fnmatch
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import unittest
import urllib.request
from pathlib import Path

from pi_offload import edge_image
from pi_offload.errors import ToolError

ROOT = Path(__file__).resolve().parents[2]
CONTROL = ROOT / "debian/control"
SPACE = Path(os.environ.get("PI_EDGE_SPACE", ROOT / "install"))
LIMIT_S = 120
SYSTEM = ("usr", "etc")  # of this machine, in the container


class VehicleImage(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.folder.chmod(0o755)

    def test_packages_are_those_that_the_debian_packages_need_to_run(self):
        names = edge_image.run_time_packages(CONTROL)
        for name in ("rviz", "python3-opencv", "pocl-opencl-icd", "nats-server", "ros-robot-state-publisher"):
            self.assertIn(name, names)
        self.assertEqual(1, len({"qt6-svg-plugins", "libqt5svg5"} & set(names)))
        for name in ("pi-node", "opencl-icd", "libceres-dev", "${shlibs", "debhelper-compat"):
            self.assertNotIn(name, names)

    def test_what_links_kernels_is_not_left_out(self):
        """PoCL links by the compiler's driver. dpkg's patterns match as fnmatch does, the last one that does counts."""
        for name in ("libgcc.a", "libc_nonshared.a"):
            path = os.path.realpath(subprocess.run(["gcc", "-print-file-name=" + name], check=True, text=True,
                                                   stdout=subprocess.PIPE).stdout.strip())
            self.assertTrue(any(fnmatch.fnmatchcase(path, pattern) for pattern in edge_image.NEEDED), path)
        self.assertFalse(any(fnmatch.fnmatchcase("/usr/lib/x86_64-linux-gnu/libc.a", pattern)
                             for pattern in edge_image.NEEDED))

    def test_what_is_missing_is_named(self):
        with self.assertRaisesRegex(ToolError, "setup.sh is missing: call make build"):
            edge_image.Vehicle(self.folder, CONTROL)
        with self.assertRaisesRegex(ToolError, "none: No such file.*; it must be the suite's debian/control"):
            edge_image.run_time_packages(self.folder / "none")
        (self.folder / "control").write_text("Source: pi-edge\n")
        with self.assertRaisesRegex(ToolError, "names no package that the suite needs at run time"):
            edge_image.run_time_packages(self.folder / "control")

    @unittest.skipUnless(os.geteuid() == 0, "only root mounts")
    def test_nothing_stays_of_one_that_is_interrupted(self):
        """mmdebstrap mounts /proc and parts of /dev in the root: nobody else may see that, least of all who removes it."""
        begun = self.folder / "begun"
        os.mkfifo(begun)
        program = self.folder / "bin/mmdebstrap"
        edge_image.write_script(program, 'for word; do case "$word" in */root) root=$word ;; esac; done\n'
                                         'mkdir "$root/proc" && mount -t tmpfs none "$root/proc" && touch "$root/proc/it"\n'
                                         f'echo $root >{begun}\nexec sleep 1000\n')
        code = ("import sys, types\nfrom pi_offload import edge_image\n"
                "edge_image.Vehicle = lambda *_: types.SimpleNamespace(system=[], packages=['it'], output='it.tar')\n"
                "sys.exit(edge_image.main())\n")
        for number in (signal.SIGTERM, signal.SIGINT):
            with self.subTest(signal=number):
                output = self.folder / f"output{number}"
                output.mkdir()
                words = ["--prefix", self.folder, "--target", "vehicle", "--control", CONTROL, "--output", output]
                with subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True,
                                      env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}"}) as image:
                    root = begun.read_text().strip()  # waits for it
                    self.assertTrue(root.startswith(str(output)))
                    self.assertNotIn(str(output), Path("/proc/mounts").read_text())
                    image.send_signal(number)
                    self.assertEqual((130, ""), (image.wait(LIMIT_S), image.stderr.read()))
                self.assertEqual([], list(output.iterdir()))

    def test_the_copy_of_a_space_names_its_new_folder(self):
        space = self.folder / "space"
        (space / "lib/pi_node").mkdir(parents=True)
        (space / "include").mkdir()
        (space / "share/pi_node/cmake").mkdir(parents=True)
        (space / "setup.sh").write_text(f"space={space}\n")
        (space / "include/header.h").write_text("")
        (space / "share/pi_node/package.xml").write_text("<version>1.2.3</version>")
        shutil.copy2("/bin/true", space / "lib/pi_node/node")
        vehicle = edge_image.Vehicle(space, CONTROL)
        self.assertIn("libc6", edge_image.packages(vehicle.system))
        root = self.folder / "root"
        vehicle.copy_to(root)
        copy = root / "opt/pi_edge"
        self.assertEqual("space=/opt/pi_edge\n", (copy / "setup.sh").read_text())
        self.assertEqual((space / "lib/pi_node/node").read_bytes(), (copy / "lib/pi_node/node").read_bytes())
        self.assertEqual({"pi_node"}, {path.name for path in (copy / "share").iterdir()} - {"pi_detect"})
        self.assertFalse((copy / "include").exists() or (copy / "share/pi_node/cmake").exists())
        self.assertTrue(os.access(root / "usr/bin/pi_edge", os.X_OK))

    def bundle(self, words):
        """What runc starts: the vehicle's space with its user, on the network of this machine."""
        vehicle = edge_image.Vehicle(SPACE, CONTROL)
        root = self.folder / "root"
        vehicle.copy_to(root)
        for name in SYSTEM:
            shutil.rmtree(root / name)
        os.chown(root / vehicle.home[1:], edge_image.USER, edge_image.USER)
        for name in ("bin", "lib", "lib64", "sbin"):
            (root / name).symlink_to(f"usr/{name}")
        subprocess.run(["runc", "spec"], cwd=self.folder, check=True)
        spec = json.loads((self.folder / "config.json").read_text())
        described = edge_image.configuration(vehicle, "", "")["config"]
        user, group = (int(number) for number in described["User"].split(":"))
        spec["root"] = {"path": str(root), "readonly": False}
        spec["process"].update(terminal=False, user={"uid": user, "gid": group}, env=described["Env"], cwd="/",
                               args=described["Entrypoint"] + words, capabilities={})
        spec["linux"]["namespaces"] = [one for one in spec["linux"]["namespaces"] if one["type"] != "network"]
        spec["mounts"] = [one for one in spec["mounts"] if one["destination"] != "/sys" and one["type"] != "cgroup"] + [
            {"destination": "/tmp", "type": "tmpfs", "source": "tmpfs", "options": ["nosuid", "nodev", "mode=1777"]}]
        spec["mounts"] += [{"destination": f"/{name}", "type": "bind", "source": f"/{name}", "options": ["rbind", "ro"]}
                           for name in SYSTEM]
        (self.folder / "config.json").write_text(json.dumps(spec))

    def test_a_container_shows_the_page(self):
        if not (SPACE / "setup.sh").is_file():
            self.skipTest("%s is no install space: make build" % SPACE)
        if shutil.which("runc") is None:
            self.skipTest("runc is not installed: apt-get install runc")
        if os.geteuid() != 0:
            self.skipTest("runc needs root here")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            master = free.getsockname()[1]
        self.bundle(["roslaunch", "--port", str(master), "pi_web", "web_view.launch", "port:=0"])
        name, runc = f"vehicle_image_{os.getpid()}", ["runc", "--root", self.folder / "runc"]
        process = subprocess.Popen([*runc, "run", "--bundle", self.folder, name], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(subprocess.run, [*runc, "delete", "--force", name], stderr=subprocess.DEVNULL, check=False)
        end = threading.Timer(LIMIT_S, process.kill)
        self.addCleanup(end.cancel)
        end.start()
        said = []
        for line in process.stdout:
            said.append(line)
            if found := re.search(r"the vehicle is at (http://[^\s\x1b]+)", line):
                with urllib.request.urlopen(found[1], timeout=LIMIT_S) as answer:
                    self.assertIn("<title>", answer.read().decode())
                break
        else:
            if any("operation not permitted" in line.lower() or "cgroup" in line.lower() for line in said):
                self.skipTest("runc cannot start a container here: " + said[-1].strip())
            self.fail("the container ended: " + "".join(said[-20:]))
        done = subprocess.run([*runc, "exec", name, *edge_image.Vehicle.entry_point, "rosrun", "pi_bringup",
                               "pi_edge", "demo", "--help"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False)
        self.assertEqual(0, done.returncode, done.stdout)
        self.assertIn("--scenario", done.stdout)


if __name__ == "__main__":
    unittest.main()
