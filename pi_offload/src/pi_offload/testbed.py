"""The test bed: the vehicle's nodes and edge servers as processes on devices of their own, with radio links between.

The devices are network namespaces, those of pi_os_transport's bench_devices; nothing of them stays, whatever ends this
process. They share the processors of the machine.
"""

import json
import os
import sys
from pathlib import Path

import roslib.packages
import yaml

from pi_offload.errors import ToolError

PORT = 5680
START_S = 120.0
LAN = {"rate_mbps": 100.0, "delay_s": 0.0005, "loss": 0.0}


def program(package, name):
    """@throws ToolError"""
    found = [path for path in roslib.packages.find_node(package, name) if os.access(path, os.X_OK)]
    if not found:
        raise ToolError(f"{package} has no program {name}: build the package and source setup.sh of its space")
    return found[0]


sys.path.append(str(Path(program("pi_os_transport", "bench_devices")).parent))
from transport_bench import devices  # noqa: E402  (found through the line above)

Unsupported = devices.Unsupported
BenchError = devices.BenchError


def _parameters(package, name):
    with open(Path(roslib.packages.get_pkg_dir(package)) / "config" / name, encoding="utf-8") as file:
        return yaml.safe_load(file)


class RadioLink:
    """Between the vehicle and a node, by TUN devices and the program radio_link."""

    def __init__(self, bed, number, device):
        self._vehicle = bed.vehicle
        self._name = f"radio{number}"
        self.address = f"10.89.{number}.2"
        self.interfaces = (self._name, "radio")  # of the vehicle and of the node
        self._process = self._vehicle.start(program("pi_offload", "radio_link"), self._name, "radio", device.path)
        try:
            self._process.answer()
        except BenchError as error:
            raise Unsupported(f"no radio link of TUN devices here: {error}") from None
        for namespace, name, address in ((self._vehicle, self._name, f"10.89.{number}.1"),
                                         (device, "radio", self.address)):
            namespace.run("ip", "addr", "add", address + "/30", "dev", name)
            namespace.run("ip", "link", "set", name, "addrgenmode", "none", "up")

    def set(self, rate_mbps, delay_s, loss):
        """Both directions alike. loss 1: nothing passes."""
        self._process.say(rate_mbps, delay_s, loss)
        self._process.answer()

    def up(self, on):
        """Plugs the vehicle's interface in or out."""
        self._vehicle.run("ip", "link", "set", self._name, "up" if on else "down")


class NetemLink:
    """The same by tc netem on the node's cable, for kernels that have it."""

    def __init__(self, _, __, device):
        self._device = device
        self._down = self._lost = False
        self.address = device.address
        self.interfaces = (devices.INTERFACE, devices.INTERFACE)
        self.set(**LAN)

    def set(self, rate_mbps, delay_s, loss):
        lost = loss >= 1.0
        if lost != self._lost and not self._down:
            self._device.cut("loss") if lost else self._device.restore()
            self._lost = lost
        if not lost:
            self._device.shape(rate_mbps, queue_ms=100.0, delay_ms=1e3 * delay_s, loss_percent=100.0 * loss)

    def up(self, on):
        self._down = not on
        self._device.restore() if on else self._device.cut("down")


LINKS = {"tun": RadioLink, "netem": NetemLink}


class Bed:
    """Devices and processes. Everything ends with close()."""

    def __init__(self, scenario, road, pictures, sounds, link="tun", deadline_s=None, model=None, node_model=None):
        """@param scenario  path of the file that road comes from. @param pictures  their files.
        @param sounds  file or folder that is spoken; empty: no speech.
        @param deadline_s  of a picture; None: that of config/coordinator.yaml.
        @param model, node_model  networks of vehicle and nodes; None: the defaults. @throws ToolError, Unsupported"""
        self.road, self.speech = road, bool(sounds)
        self._deadline_s, self._model, self._node_model = deadline_s, model, node_model
        self.servers = {}
        self._configs = {}
        self._loaders = []
        names = ["vehicle"] + [f"edge{i}" for i in range(1, len(road.nodes) + 1)]
        self._testbed = devices.Testbed(names)
        try:
            self.vehicle = self._testbed.vehicle
            self._edges = dict(zip([node.id for node in road.nodes], list(self._testbed.devices.values())[1:]))
            self.links = {node.id: LINKS[link](self, number, self._edges[node.id])
                          for number, node in enumerate(road.nodes, 1)}
            self.lan()
            for node in road.nodes:
                self.start_server(node.id, wait=False)
            self._start_vehicle(scenario, pictures, sounds)
        except BaseException:
            self.close()
            raise

    def close(self):
        self._testbed.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    # ------------------------------------------------------------------------------------------------------ processes

    def _config(self, node):
        """File of the server's parameters."""
        if node not in self._configs:
            described = next(entry for entry in self.road.nodes if entry.id == node)
            tree = _parameters("pi_offload", "edge_server.yaml")
            tree.update(id=node, address=f"{self.links[node].address}:{PORT}", port=PORT, has_position=True,
                        x=described.x, y=described.y, range=described.range_m,
                        trusted_interfaces=[self.links[node].interfaces[1]])
            tree["detection"]["check_model"] = False  # it is the package's, and servers start often here
            if self._node_model:
                tree["detection"]["model"] = self._node_model
            tree["speech"]["enabled"] = self.speech
            self._configs[node] = Path(self._testbed.folder) / f"{node}.yaml"
            self._configs[node].write_text(yaml.safe_dump(tree), encoding="utf-8")
        return str(self._configs[node])

    def start_server(self, node, wait=True):
        self.servers[node] = self._edges[node].start(program("pi_offload", "edge_server"), "--config",
                                                     self._config(node))
        if wait:
            self.servers[node].await_line("works at", START_S)

    def kill_server(self, node):
        """SIGKILL, as by whatever ends a computer's process; its kernel still closes the connections."""
        server = self.servers.pop(node)
        server.close()
        self._edges[node].processes.remove(server)

    def _start_vehicle(self, scenario, pictures, sounds):
        managers = ["detection_manager"] + (["speech_manager", "sound_manager"] if sounds else [])
        self.managers = {name: self.vehicle.start(program("nodelet", "nodelet"), "manager", f"__name:={name}")
                         for name in managers}
        self._judge = self.vehicle.start("/usr/bin/python3", "-m", "pi_offload.testbed_vehicle")
        coordinator = _parameters("pi_offload", "coordinator.yaml")
        coordinator.update(vehicle="vehicle", announcements=False, trusted_interfaces=sorted(
            {link.interfaces[0] for link in self.links.values()}), nodes=[
            {"id": node.id, "address": f"{self.links[node.id].address}:{PORT}", "x": node.x, "y": node.y,
             "range": node.range_m} for node in self.road.nodes])
        if self._deadline_s:
            coordinator["detection"]["deadline_s"] = self._deadline_s
            coordinator["local"]["max_waiting"] = 64  # as many may come home at once
        self._load("detection_manager", "pi_offload/coordinator", "coordinator", coordinator)
        ssd = _parameters("pi_detect", "ssd.yaml")
        ssd.update(max_rate_hz=0.0, input_timeout_s=3600.0, check_model=False, model=self._model or ssd["model"])
        self._load("detection_manager", "pi_detect/ssd", "ssd", ssd, "image:=local/image",
                   "detections:=local/detections", "labels:=local/labels")
        if sounds:
            recognizer = _parameters("pi_speech", "recognizer.yaml")
            recognizer["utterance_service"] = "recognize_utterance"
            self._load("speech_manager", "pi_speech/recognizer", "recognizer", recognizer)
            player = _parameters("pi_speech", "player.yaml")
            player.update(files=[str(path) for path in sounds], loop=True)
            self._load("sound_manager", "pi_speech/player", "player", player)
        for server in self.servers.values():
            server.await_line("works at", START_S)
        self.judge("start", pictures=[str(path) for path in pictures], scenario=str(scenario))
        self.stand_between()
        self.await_all()
        self.judge("await_detections", count=20)

    def _load(self, manager, kind, name, parameters, *remap):
        """Loads a nodelet; where that fails, its loader ends and the manager says why."""
        self.judge("parameters", name=name, tree=parameters)
        self._loaders.append(self.vehicle.start(program("nodelet", "nodelet"), "load", kind, manager,
                                                f"__name:={name}", *remap))

    def judge(self, do, **arguments):
        """What pi_offload.testbed_vehicle has under this name. @throws ToolError"""
        self._judge.say(json.dumps({"do": do, **arguments}))
        answer = self._judge.answer(3600.0)
        if "error" in answer:
            ended = [process.describe() for process in [*self._loaders, *self.managers.values()] if not process.alive()]
            raise ToolError("\n".join([f"{do}: {answer['error']}", *ended]))
        return answer["value"]

    def describe(self):
        """The last lines of all processes."""
        return "\n".join(process.describe() for process in [*self.managers.values(), *self.servers.values(),
                                                              self._judge])

    # ------------------------------------------------------------------------------------------------ what is steered

    def lan(self):
        for link in self.links.values():
            link.set(**LAN)

    def stand_between(self):
        """Where all nodes are in range, if there is such a place; else beside the first."""
        nodes = self.road.nodes
        x, y = sum(node.x for node in nodes) / len(nodes), sum(node.y for node in nodes) / len(nodes)
        if any(self.road.rate_mbps(node, x, y) == 0.0 for node in nodes):
            x, y = nodes[0].x, nodes[0].y
        self.judge("stand", x=x, y=y)
        self._place = (x, y)

    def await_all(self):
        """Until the coordinator is connected to all nodes in range."""
        self.judge("await_nodes", names=[node.id for node in self.road.nodes
                                         if self.road.rate_mbps(node, *self._place) > 0.0])

    def drive_links(self, driven_m):
        """Links as they are after so many metres of the route."""
        x, y, _ = self.road.at(driven_m)
        for node in self.road.nodes:
            rate = self.road.rate_mbps(node, x, y)
            self.links[node.id].set(rate or 1.0, self.road.round_trip_s / 2, self.road.loss if rate else 1.0)

    def cpu_seconds(self):
        """Of the vehicle's processes, since they began: {manager: s}."""
        ticks = os.sysconf("SC_CLK_TCK")
        times = {}
        for name, process in self.managers.items():
            with open(f"/proc/{process.pid}/stat", encoding="utf-8") as file:
                fields = file.read().rpartition(")")[2].split()
            times[name] = (int(fields[11]) + int(fields[12])) / ticks
        return times
