"""What pi_edge fleet wrote, in use: two sites with real servers in a cluster, and all roles, strangers among them."""

import contextlib
import io
import shutil
import socket
import ssl
import tempfile
import time
import unittest
from datetime import datetime, timezone
from pathlib import Path

import nats
from pi_bringup import pi_edge
from pi_bringup.fleet import commands
from pi_bringup.fleet.commands import Fleet

STRANGERS = 255
PICTURE = bytes(7 << 20)
NO_RESPONDERS = b"NATS/1.0 503"
UNWRITTEN = "Permissions Violation"


def fleet(folder, *words):
    with contextlib.redirect_stdout(io.StringIO()):
        status = commands.main(pi_edge.parse(["fleet", *(str(word) for word in words), "--folder", str(folder)]))
    if status != 0:
        raise AssertionError(f"pi_edge fleet {words}: status {status}")


class FleetServers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        scratch = tempfile.TemporaryDirectory()
        cls.addClassCleanup(scratch.cleanup)
        cls.folder = Path(scratch.name) / "fleet"
        cls.other = Path(scratch.name) / "other"  # a fleet of somebody else, of the same name
        for folder in (cls.folder, cls.other):
            fleet(folder, "init", "--name", "yards")
        ports = nats.free_ports(6)
        cls.ports = {"gate": ports[0], "lamp": ports[1]}
        cls.route_port = ports[2]
        for name, port, route_port, http_port in (("gate", *ports[0:6:2]), ("lamp", *ports[1:6:2])):
            fleet(cls.folder, "add-site", name, "--host", "localhost", "--port", port, "--route-port", route_port,
                  "--http-port", http_port, "--device-folder", cls.folder / "sites" / name)
        fleet(cls.folder, "add-vehicle", "truck", "van", "stolen", "worn")
        fleet(cls.folder, "add-operator", "control")
        fleet(cls.other, "add-vehicle", "truck")
        cls.configurations = {name: cls.folder / "sites" / name / "server/nats-server.conf" for name in cls.ports}
        cls.servers = {}
        for name, configuration in cls.configurations.items():
            cls.servers[name] = nats.Server(configuration)
            cls.addClassCleanup(cls.servers[name].stop)
        cls.servers["gate"].wait_for("Route connection created")

    def client(self, name, site="gate", folder=None):
        member = folder or {"control": self.folder / "operators/control"}.get(
            name, self.folder / ("sites" if name in self.ports else "vehicles") / name)
        one = nats.Client(self.ports[site], member / "worker" if name in self.ports else member)
        self.addCleanup(one.close)
        return one

    def reload(self):
        for server in self.servers.values():
            server.reload()

    def test_servers_accept_what_is_written(self):
        for configuration in self.configurations.values():
            status, text = nats.check(configuration)
            self.assertEqual(0, status, text)
        broken = self.configurations["gate"].with_name("broken.conf")
        broken.write_text(self.configurations["gate"].read_text().replace("verify_and_map: true", "verify_and_map: 8"))
        self.assertNotEqual(0, nats.check(broken)[0])

    def test_a_vehicle_is_answered_by_a_worker_of_another_site(self):
        worker = self.client("lamp", "lamp")
        worker.subscribe("edge.detection.>", "workers")
        vehicle = self.client("truck")
        vehicle.subscribe("_INBOX.truck.1")
        self.ask(vehicle, "edge.detection.fast", PICTURE, "_INBOX.truck.1")
        subject, reply, payload = worker.receive()
        self.assertEqual(("edge.detection.fast", PICTURE), (subject, payload))
        worker.publish(reply, b"a car")
        worker.flush()
        self.assertEqual(("_INBOX.truck.1", "", b"a car"), vehicle.receive())
        with self.assertRaisesRegex(nats.Refused, UNWRITTEN):  # one answer for a request
            worker.publish(reply, b"a car")
            worker.flush()

    def ask(self, vehicle, subject, payload, reply):
        """Sends a request until a worker gets it: the sites tell each other of new subscriptions."""
        for _ in range(10000):
            vehicle.publish(subject, payload, reply)
            vehicle.flush()
            if not vehicle.messages:
                return
            self.assertTrue(vehicle.receive()[2].startswith(NO_RESPONDERS))
        self.fail(f"nobody gets {subject}")

    def test_without_a_worker_the_vehicle_is_told_at_once(self):
        vehicle = self.client("truck")
        vehicle.subscribe("_INBOX.truck.>")
        vehicle.publish("edge.nobody", b"hello", "_INBOX.truck.2")
        self.assertTrue(vehicle.receive()[2].startswith(NO_RESPONDERS))

    def test_roles_may_do_their_own_work_alone(self):
        for name, forbidden in (
                ("truck", ("edge.>", "edge.detection.fast", "_INBOX.van.>", "_INBOX.>", ">")),
                ("gate", ("edge.>", "_INBOX.>", "_INBOX.truck.1", ">"))):
            for subject in forbidden:
                with self.subTest(name=name, subject=subject), self.assertRaisesRegex(nats.Refused, UNWRITTEN):
                    self.client(name).subscribe(subject)
        for name, forbidden in (("truck", ("edge.status.gate", "_INBOX.van.1", "other")),
                                ("gate", ("edge.status.lamp", "_INBOX.truck.1", "edge.detection.fast")),
                                ("control", ("edge.detection.fast", "_INBOX.truck.1", "edge.status.gate"))):
            for subject in forbidden:
                with self.subTest(name=name, subject=subject), self.assertRaisesRegex(nats.Refused, UNWRITTEN):
                    one = self.client(name)
                    one.publish(subject, b"")
                    one.flush()

    def test_an_operator_sees_all_and_a_vehicle_the_sites(self):
        operator = self.client("control")
        operator.subscribe(">")
        waiting = self.client("van")
        waiting.subscribe("edge.status.>")
        worker, vehicle = self.client("gate"), self.client("truck")
        worker.publish("edge.status.gate", b"well")
        worker.flush()
        for one in (operator, waiting):
            self.assertEqual(("edge.status.gate", "", b"well"), one.receive())
        vehicle.publish("edge.detection.fast", b"picture")
        vehicle.flush()
        self.assertEqual(("edge.detection.fast", "", b"picture"), operator.receive())

    def test_strangers_are_refused(self):
        with self.subTest("foreign"), self.assertRaises(nats.Refused):
            nats.Client(self.ports["gate"], self.other / "vehicles/truck", self.folder / "vehicles/truck")
        with self.subTest("no certificate"), self.assertRaises(nats.Refused):
            nats.Client(self.ports["gate"], None, self.folder / "vehicles/truck")
        with self.subTest("a certificate of another purpose"), self.assertRaises(nats.Refused):
            nats.Client(self.ports["gate"], self.folder / "sites/gate/server")

    def test_an_expired_certificate_is_refused(self):
        self.client("worn")
        with Fleet(self.folder) as known:
            known.certify("worn", dict(known.members["worn"]), 0)
            known.save()
            end = datetime.fromisoformat(known.members["worn"]["expires"])
        time.sleep(max(0.0, (end - datetime.now(timezone.utc)).total_seconds() + 1.0))
        self.reload()
        with self.assertRaises(nats.Refused):
            self.client("worn")
        self.servers["gate"].wait_for("TLS handshake error.*certificate has expired")

    def test_revoked_and_renewed_certificates_are_refused_and_disconnected(self):
        kept = {name: self.folder.parent / name for name in ("stolen", "van")}
        for name, folder in kept.items():
            (self.folder / "vehicles" / name).rename(folder)
            shutil.copytree(folder, self.folder / "vehicles" / name)
        connected = {name: self.client(name, site) for name, site in (("stolen", "gate"), ("van", "lamp"))}
        fleet(self.folder, "revoke", "stolen")
        fleet(self.folder, "renew", "van")
        self.reload()
        for name, one in connected.items():
            one.ended()
            for site in self.ports:
                with self.subTest(name=name, site=site), self.assertRaises(nats.Refused):
                    self.client(name, site, kept[name])
        self.client("van")
        self.client("truck")

    def test_a_vehicles_certificate_opens_no_route(self):
        for member, welcome in (("vehicles/truck", False), ("sites/lamp/server", True)):
            folder = self.folder / member
            with self.subTest(member), socket.create_connection(("localhost", self.route_port), nats.LIMIT_S) as plain:
                context = ssl.create_default_context(cafile=str(folder / "ca.pem"))
                context.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
                with context.wrap_socket(plain, server_hostname="localhost") as route:
                    route.sendall(b'INFO {"server_id":"SPY","cluster":"yards","headers":true}\r\nPING\r\n')
                    said = b""
                    with contextlib.suppress(OSError):
                        while b"PONG" not in said and (part := route.recv(1 << 16)):
                            said += part
                    self.assertEqual(welcome, b"PONG" in said, said)

    def test_silent_strangers_keep_no_vehicle_out(self):
        address = ("localhost", self.ports["gate"])
        strangers = [socket.create_connection(address, nats.LIMIT_S) for _ in range(STRANGERS)]
        for one in strangers:
            self.addCleanup(one.close)
        vehicle = self.client("truck")
        vehicle.flush()
        for one in strangers:  # and they are sent away
            with contextlib.suppress(ConnectionResetError):
                while one.recv(1 << 16):
                    pass
        vehicle.flush()


if __name__ == "__main__":
    unittest.main()
