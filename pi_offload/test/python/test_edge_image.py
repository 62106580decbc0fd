"""The image of an edge node: its archive, and a container of it, started by runc, that answers a vehicle and drains.

The root file system has this machine's libraries in place of packages: that takes seconds and no network. `make image`
makes the one of Debian packages. EDGE_SERVER names the program."""

import gzip
import hashlib
import io
import json
import os
import shutil
import subprocess
import tarfile
import tempfile
import unittest
import urllib.request
from pathlib import Path

import yaml
from test_edge_server_process import LIMIT_S, Vehicle

from pi_offload import edge_image
from pi_offload.errors import ToolError

PACKAGE = Path(__file__).resolve().parents[2]
KUBERNETES = PACKAGE / "deploy/kubernetes"


class EdgeImage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        program = os.environ.get("EDGE_SERVER")
        if not program:
            raise unittest.SkipTest("EDGE_SERVER does not name the program")
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        shares = {name: PACKAGE.parent / name for name in edge_image.SHARES}
        cls.suite = edge_image.EdgeNode(Path(program).parents[1], shares)
        cls.root = cls.folder / "root"
        cls.root.mkdir(mode=0o755)
        edge_image.make_root(cls.root, cls.suite, of_this_machine=True)
        cls.folder.chmod(0o755)

    def test_libraries_come_from_debian_packages(self):
        names = edge_image.packages(self.suite.system)
        for name in ("libc6", r"libopencv-dnn\d+", r"libroscpp\d\w+", r"libyaml-cpp[\d.]+"):
            self.assertRegex("\n".join(names), rf"(?m)^{name}$")
        with self.assertRaisesRegex(ToolError, "root/etc.* belongs to no Debian package"):
            edge_image.packages([self.root / "etc/pi_edge/edge_server.yaml"])

    def test_what_is_missing_is_named(self):
        with self.assertRaisesRegex(ToolError, "edge_server is missing: call make build"):
            edge_image.EdgeNode.installed(self.folder)
        with self.assertRaisesRegex(ToolError, "no_such_program is missing: apt-get install some_package"):
            edge_image.run(["no_such_program"], "some_package")
        with self.assertRaisesRegex(ToolError, "ended with status 1: "):
            edge_image.run(["ldd", "/proc/self/nothing"], "libc-bin")

    def test_the_archive_is_an_image_of_oci(self):
        small = self.folder / "small"
        (small / "etc").mkdir(parents=True)
        (small / "etc/name").write_text("edge")
        archive = self.folder / "image.tar"
        edge_image.write_archive(small, archive, edge_image.EdgeNode, "1.2.3")
        with tarfile.open(archive) as file:
            blobs = {entry.name: file.extractfile(entry).read() for entry in file if entry.isfile()}
        self.assertEqual({"imageLayoutVersion": "1.0.0"}, json.loads(blobs["oci-layout"]))
        entry, = json.loads(blobs["index.json"])["manifests"]
        self.assertEqual("pi_edge/edge_server:1.2.3", entry["annotations"]["org.opencontainers.image.ref.name"])

        def blob(described):
            data = blobs["blobs/" + described["digest"].replace(":", "/")]
            self.assertEqual(described["digest"], "sha256:" + hashlib.sha256(data).hexdigest())
            self.assertEqual(described["size"], len(data))
            return data

        manifest = json.loads(blob(entry))
        described = json.loads(blob(manifest["config"]))
        layer, = manifest["layers"]
        plain = gzip.decompress(blob(layer))
        self.assertEqual(["sha256:" + hashlib.sha256(plain).hexdigest()], described["rootfs"]["diff_ids"])
        with tarfile.open(fileobj=io.BytesIO(plain)) as file:
            self.assertEqual(b"edge", file.extractfile("./etc/name").read())
            self.assertEqual({0}, {member.uid for member in file})
        self.assertEqual(f"{edge_image.USER}:{edge_image.USER}", described["config"]["User"])
        self.assertEqual(["--config", "/etc/pi_edge/edge_server.yaml"], described["config"]["Cmd"])

    def bundle(self, parameters):
        """What runc starts: the image's root, program and user, on the network of this machine."""
        bundle = self.folder / "bundle"
        bundle.mkdir(exist_ok=True)
        parameter_file = bundle / "edge_server.yaml"
        parameter_file.write_text(yaml.safe_dump(parameters))
        subprocess.run(["runc", "spec"], cwd=bundle, check=True)
        spec = json.loads((bundle / "config.json").read_text())
        described = edge_image.configuration(edge_image.EdgeNode, "", "")["config"]
        user, group = (int(number) for number in described["User"].split(":"))
        spec["root"] = {"path": str(self.root), "readonly": True}
        spec["process"].update(terminal=False, user={"uid": user, "gid": group}, env=described["Env"], cwd="/",
                               args=described["Entrypoint"] + described["Cmd"], capabilities={})
        spec["linux"]["namespaces"] = [one for one in spec["linux"]["namespaces"] if one["type"] != "network"]
        spec["mounts"] = [one for one in spec["mounts"] if one["destination"] != "/sys" and one["type"] != "cgroup"] + [
            {"destination": "/tmp", "type": "tmpfs", "source": "tmpfs", "options": ["nosuid", "nodev", "mode=1777"]},
            {"destination": edge_image.CONFIGURATION, "type": "bind", "source": str(parameter_file),
             "options": ["bind", "ro"]}]
        (bundle / "config.json").write_text(json.dumps(spec))
        return bundle

    def start(self, parameters):
        """@return (the container's process, addresses of server and health)"""
        name = f"edge_image_{os.getpid()}"
        process = subprocess.Popen(["runc", "--root", self.folder / "runc", "run", "--bundle", self.bundle(parameters),
                                    name], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                   text=True)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(subprocess.run, ["runc", "--root", self.folder / "runc", "delete", "--force", name],
                        stderr=subprocess.DEVNULL, check=False)
        said = []
        for line in process.stdout:
            said.append(line)
            if " works at " in line:
                address, _, health = line.partition(" works at ")[2].partition(", health at port ")
                return name, process, int(address.rpartition(":")[2]), int(health)
        if any("operation not permitted" in line.lower() or "cgroup" in line.lower() for line in said):
            self.skipTest("runc cannot start a container here: " + said[-1].strip())
        self.fail("the container ended: " + "".join(said[-20:]))

    def test_a_container_answers_a_vehicle_and_drains(self):
        if shutil.which("runc") is None:
            self.skipTest("runc is not installed: apt-get install runc")
        if os.geteuid() != 0:
            self.skipTest("runc needs root here")
        name, process, port, health = self.start({
            "id": "container", "host": "127.0.0.1", "port": 0, "admission": {"workers": 1},
            "speech": {"enabled": True}, "health": {"host": "127.0.0.1", "port": 0}, "drain_s": LIMIT_S})
        vehicle = Vehicle(port)
        self.addCleanup(vehicle.socket.close)
        vehicle.send_picture(1)
        self.assertEqual((1, Vehicle.OK, False), vehicle.reply())
        with urllib.request.urlopen(f"http://127.0.0.1:{health}/metrics", timeout=LIMIT_S) as answer:
            metrics = answer.read().decode()
        for metric in yaml.safe_load((KUBERNETES / "prometheus_adapter.yaml").read_text())["rules"]["custom"]:
            self.assertIn("\n" + metric["seriesQuery"].partition("{")[0] + " ", metrics)
        subprocess.run(["runc", "--root", self.folder / "runc", "kill", name, "TERM"], check=True)
        self.assertEqual(0, process.wait(LIMIT_S))


if __name__ == "__main__":
    unittest.main()
