"""Checks of the network against servers of the test."""

import http.server
import socket
import threading
import unittest

from fake_root import FakeRoot
from pi_bringup.doctor import network


class Health(http.server.BaseHTTPRequestHandler):
    status = 200

    def do_GET(self):
        self.send_response(self.status if self.path == "/readyz" else 404)
        self.end_headers()
        self.wfile.write(b"loads a model")

    def log_message(self, *_):
        pass


class Network(FakeRoot):
    def listener(self):
        server = socket.socket()
        self.addCleanup(server.close)
        server.bind(("127.0.0.1", 0))
        server.listen(5)
        return server.getsockname()[1]

    def health(self, status):
        kind = type("OneHealth", (Health,), {"status": status})
        server = http.server.HTTPServer(("127.0.0.1", 0), kind)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return server.server_address[1]

    def test_port(self):
        taken = self.listener()
        self.expect("WARN", network.check_port(taken), "is in use", "pi_os status")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            number = free.getsockname()[1]
        self.expect("OK", network.check_port(number), "is free")

    def test_node(self):
        address = "127.0.0.1:%d" % self.listener()
        self.expect("OK", network.check_node(address, self.health(200)), "is ready")
        self.expect("FAIL", network.check_node(address, self.health(503)), "is not ready: 503 loads a model")

    def test_node_without_health(self):
        silent = self.listener()  # takes the connection, and says nothing
        address = "127.0.0.1:%d" % self.listener()
        self.expect("WARN", network.check_node(address, silent, 0.2), "does not say its health")

    def test_node_that_is_not_there(self):
        with socket.socket() as closed:
            closed.bind(("127.0.0.1", 0))
            self.expect("FAIL", network.check_node("127.0.0.1:%d" % closed.getsockname()[1]), "takes no connection")

    def test_addresses(self):
        self.assertEqual(("10.0.0.17", 5680), network.split_address("10.0.0.17:5680"))
        self.assertEqual(("fe80::1", 5680), network.split_address("[fe80::1]:5680"))
        for wrong in ("10.0.0.17", "10.0.0.17:", ":5680", "a:b", "a:0", "a:70000"):
            with self.subTest(wrong):
                self.expect("FAIL", network.check_node(wrong), "must be HOST:PORT")


if __name__ == "__main__":
    unittest.main()
