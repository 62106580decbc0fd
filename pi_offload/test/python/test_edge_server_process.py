"""edge_server as a service manager sees it: by the line of its unit, with probes, and SIGTERM while it works.

EDGE_SERVER names the program; its packages must be found by ROS_PACKAGE_PATH or stand beside it in an install space.
"""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
LIMIT_S = 120.0
TASKS = 200
CONFIG = f"""
id: drained
host: 127.0.0.1
port: 0
admission: {{workers: 1, max_queued: {2 * TASKS}, max_queued_per_vehicle: {2 * TASKS}}}
speech: {{enabled: false}}
health: {{host: 127.0.0.1, port: 0}}
drain_s: {LIMIT_S}
"""


class Vehicle:
    """Speaks nanomsg's request-reply protocol and the suite's messages."""
    GREETING = b"\0SP\0\0\x30\0\0"
    OK, REFUSED = 0, 1

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)
        self.socket.sendall(self.GREETING)
        greeting = self.receive(8)
        if greeting != b"\0SP\0\0\x31\0\0":
            raise AssertionError(f"not the greeting of a replier: {greeting}")

    def receive(self, count):
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise EOFError("the server closed the connection")
            data += part
        return data

    def send_picture(self, number, width=320, height=240):
        """A TASK with a grey picture, that has all the time in the world."""
        name = b"vehicle"
        pixels = bytes(width * height)
        body = struct.pack("<4sHBBQQdddd", b"PIRQ", 2, 2, 0, number, 0, 3600.0, 0.0, 0.0, 0.0)
        body += struct.pack("<BBIIII", 3, len(name), width, height, 0, len(pixels)) + name + pixels
        self.socket.sendall(struct.pack(">QI", len(body) + 4, 0x80000000 | number) + body)

    def reply(self):
        """Its number, status, and whether the server says that it drains."""
        length = struct.unpack(">Q", self.receive(8))[0]
        body = self.receive(length)[4:]
        magic, _, status, _, number, _, _, flags = struct.unpack("<4sHBBQBBB", body[:19])
        if magic != b"PIRP":
            raise AssertionError(f"no reply: {magic}")
        return number, status, bool(flags & 1)


class EdgeServer(unittest.TestCase):
    def setUp(self):
        program = os.environ.get("EDGE_SERVER")
        if not program:
            self.skipTest("EDGE_SERVER does not name the program")
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        config = Path(folder.name) / "edge_server.yaml"
        config.write_text(CONFIG)
        # The unit's line, with program and file of this test.
        unit = (PACKAGE / "deploy/systemd/edge_server.service").read_text()
        line = re.search(r"^ExecStart=(.*)$", unit, re.MULTILINE).group(1).split()
        self.assertEqual(["/opt/pi_edge/lib/pi_offload/edge_server", "--config", "/etc/pi_edge/edge_server.yaml"], line)
        self.process = subprocess.Popen([program, line[1], str(config)], stderr=subprocess.PIPE, text=True)
        self.addCleanup(self.process.stderr.close)
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        for text in self.process.stderr:
            found = re.search(r"works at [^:]*:(\d+), health at port (\d+)", text)
            if found:
                break
        self.assertTrue(found, text)
        self.port, self.health_port = (int(port) for port in found.groups())

    def get(self, path):
        """Status and text."""
        with socket.create_connection(("127.0.0.1", self.health_port), timeout=LIMIT_S) as connection:
            connection.sendall(f"GET {path} HTTP/1.0\r\n\r\n".encode())
            answer = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
        return int(answer.split()[1]), answer.partition("\r\n\r\n")[2]

    def metric(self, name):
        return float(re.search(rf"^pi_offload_{name} (.*)$", self.get("/metrics")[1], re.MULTILINE).group(1))

    def test_the_dashboard_shows_metrics_that_it_has(self):
        dashboard = json.loads((PACKAGE / "deploy/grafana/edge_servers.json").read_text())
        queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
        queries += [one["query"] for one in dashboard["templating"]["list"]]
        shown = {name for query in queries for name in re.findall(r"pi_offload_\w+", query)}
        lines = self.get("/metrics")[1].splitlines()
        exported = {re.match(r"\w+", line).group() for line in lines if line and not line.startswith("#")}
        self.assertGreater(len(shown), 15)
        self.assertEqual(set(), shown - exported, "the dashboard asks for what the server does not export")
        kinds = {label for query in queries for label in re.findall(r"by \(([^)]*)\)", query)}
        self.assertLessEqual(kinds, {"instance", "instance, kind", "instance, kind, le"})
        ids = [panel["id"] for panel in dashboard["panels"]]
        self.assertEqual(len(ids), len(set(ids)))
        places = [tuple(panel["gridPos"][key] for key in "xywh") for panel in dashboard["panels"]]
        self.assertTrue(all(x + w <= 24 for x, _, w, _ in places))
        self.assertFalse([(a, b) for a in places for b in places if a < b and a[0] < b[0] + b[2] and b[0] < a[0] + a[2]
                          and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]], "panels that overlap")

    def test_sigterm_drains_it(self):
        self.assertEqual(200, self.get("/healthz")[0])
        self.assertEqual(200, self.get("/readyz")[0])
        vehicle = Vehicle(self.port)
        self.addCleanup(vehicle.socket.close)
        for number in range(1, TASKS + 1):
            vehicle.send_picture(number)
        while self.metric("tasks_taken_total") < TASKS:
            pass  # the server still reads them
        self.process.send_signal(signal.SIGTERM)
        while self.get("/readyz")[0] == 200:
            pass  # the signal is on its way; once the server has ended, this fails
        self.assertEqual(200, self.get("/healthz")[0], "who drains is not ill")
        vehicle.send_picture(TASKS + 1)
        replies = [vehicle.reply() for _ in range(TASKS + 1)]
        status = {number: status for number, status, _ in replies}
        self.assertEqual({TASKS + 1: Vehicle.REFUSED}, {n: s for n, s in status.items() if s != Vehicle.OK})
        self.assertEqual(set(range(1, TASKS + 2)), set(status), "each is answered, once")
        self.assertTrue(replies[-1][2], "advertisements say that it drains")
        self.assertEqual(0, self.process.wait(LIMIT_S))
        with self.assertRaises(EOFError):
            vehicle.reply()

    def test_it_ends_at_once_without_work(self):
        self.process.send_signal(signal.SIGTERM)
        self.assertEqual(0, self.process.wait(LIMIT_S))


if __name__ == "__main__":
    unittest.main()
