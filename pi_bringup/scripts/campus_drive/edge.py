"""Edge servers on this computer, in place of those along the road."""

import socket
from pathlib import Path

import yaml
from first_drive.errors import DemoError


class EdgeServers:
    """Processes by name, and the map file of them for the vehicle."""

    def __init__(self, nodes, output):
        self.nodes = nodes
        self.output = output
        self.map_file = output / "edge_nodes.yaml"
        self.processes = {}

    def start(self, started, prefixes):
        """@param prefixes  install or devel spaces. @throws DemoError if there is no edge_server."""
        program = next((folder / "lib/pi_offload/edge_server" for folder in prefixes
                        if (folder / "lib/pi_offload/edge_server").is_file()), None)
        if program is None:
            raise DemoError("edge_server is missing; build and install pi_offload, or drive with --no-offload")
        known = []
        with_ports = [(node, *self._free_ports()) for node in self.nodes]
        for node, port, health_port in with_ports:
            address = "127.0.0.1:%d" % port
            config = self.output / ("edge_%s.yaml" % node.name)
            self._write(config, {
                "id": node.name, "address": address, "has_position": True, "x": node.x, "y": node.y,
                "range": node.range_m, "host": "127.0.0.1", "port": port, "admission": {"workers": 1},
                "health": {"host": "127.0.0.1", "port": health_port}})
            known.append({"id": node.name, "address": address, "x": node.x, "y": node.y, "range": node.range_m})
            self.processes[node.name] = started.start([program, "--config", config],
                                                      self.output / "log" / ("edge_%s.log" % node.name))
        self._write(self.map_file, {"nodes": known})

    @staticmethod
    def _free_ports():
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            second.bind(("127.0.0.1", 0))
            return first.getsockname()[1], second.getsockname()[1]

    @staticmethod
    def _write(path, tree):
        try:
            path.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
        except OSError as error:
            raise DemoError("%s cannot be written: %s; make room there or choose another folder with --output" %
                            (path, error.strerror)) from error


def spaces(environment):
    """The install or devel spaces of an environment, the topmost first."""
    return [Path(folder) for folder in environment.get("CMAKE_PREFIX_PATH", "").split(":") if folder]

