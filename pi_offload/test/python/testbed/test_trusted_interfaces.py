"""The direct path between two devices (network namespaces, needs root): it stays within this machine unless an interface
is named as trusted, at both ends, and says what to do."""

import socket
import tempfile
import unittest
from pathlib import Path

import yaml
from pi_offload import testbed

LIMIT_S = 60.0
PORT = 5680
GREETING = b"\0SP\0\0\x30\0\0"
WAY_OUT = "trusted_interfaces, as [wg0], or a fleet over TLS"


class TrustedInterfaces(unittest.TestCase):
    def setUp(self):
        try:
            bed = testbed.devices.Testbed(("vehicle", "edge1"))
        except testbed.Unsupported as reason:
            self.skipTest(str(reason))
        self.addCleanup(bed.close)
        self.vehicle, self.edge = bed.vehicle, bed.edge1
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def serve(self, **parameters):
        config = self.folder / "edge_server.yaml"
        config.write_text(yaml.safe_dump({
            "id": "gate", "port": PORT, "speech": {"enabled": False}, "detection": {
                "model": "street", "check_model": False}, "health": {"enabled": False}, **parameters}))
        return self.edge.start(testbed.program("pi_offload", "edge_server"), "--config", str(config))

    def greeted(self, device, address):
        """Whether a server at the address answers a vehicle of this device."""
        with device.entered():
            one = socket.socket()
        with one:
            one.settimeout(LIMIT_S)
            one.connect((address, PORT))
            try:
                one.sendall(GREETING)
                return one.recv(8, socket.MSG_WAITALL) == b"\0SP\0\0\x31\0\0"
            except ConnectionResetError:
                return False

    def test_a_server_takes_vehicles_of_its_own_machine_alone(self):
        server = self.serve()
        server.await_line("works at", LIMIT_S)
        self.assertFalse(self.greeted(self.vehicle, self.edge.address))
        line = server.await_line("is refused: it came through eth0", LIMIT_S)
        self.assertIn(WAY_OUT, line)
        self.assertTrue(self.greeted(self.edge, "127.0.0.1"))
        self.assertTrue(self.greeted(self.edge, self.edge.address))

    def test_a_server_takes_vehicles_from_a_named_interface(self):
        self.serve(trusted_interfaces=["eth0"]).await_line("works at", LIMIT_S)
        self.assertTrue(self.greeted(self.vehicle, self.edge.address))

    def test_a_server_does_not_start_at_an_address_of_another_interface(self):
        server = self.serve(host=self.edge.address)
        line = server.await_line(f"error: {self.edge.address}:{PORT} is an address of eth0", LIMIT_S)
        self.assertIn(WAY_OUT, line)
        self.assertEqual(1, server.popen.wait(LIMIT_S))
        self.serve(host=self.edge.address, trusted_interfaces=["eth0"]).await_line("works at", LIMIT_S)

    def test_a_vehicle_leaves_through_named_interfaces_alone(self):
        program = testbed.program("pi_offload", "bench_wire")
        served = [program, "--serve", "--host", self.edge.address, "--interface", "eth0"]
        self.edge.start(*served)
        asked = [program, "--ask", "--host", self.edge.address, "--rounds", "1", "--trips", "1"]
        refused = self.vehicle.start(*asked, "--interface", "wg0")
        line = refused.await_line(" is reached through eth0", LIMIT_S)
        self.assertIn(WAY_OUT, line)
        answered = self.vehicle.start(*asked, "--interface", "eth0")
        answered.await_line("libnanomsg", LIMIT_S)
        self.assertEqual(0, answered.popen.wait(LIMIT_S))


if __name__ == "__main__":
    unittest.main()
