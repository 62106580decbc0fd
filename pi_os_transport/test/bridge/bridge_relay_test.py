#!/usr/bin/python3 -B
"""Judge of bridge_relay.test."""
import pathlib
import socket
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import false_bridge  # noqa: E402
import transport_harness as harness  # noqa: E402
from device_testbed import devices  # noqa: E402


class BridgeRelay(device_testbed.DeviceTest):

    def setUp(self):
        super().setUp()
        self.bridge = self.start_bridge(self.vehicle)
        self.service = self.topic('service')
        self.server = self.node(self.vehicle, 'server', kind='service_peer')
        self.server.call('serve', service=self.service)
        self.port = int(self.testbed.call_master('lookupService', self.service).rstrip('/').rpartition(':')[2])

    def greet(self):
        bridge = false_bridge.FalseBridge(self.edge_b, self.vehicle.address)
        self.addCleanup(bridge.close)
        return bridge

    def greet_from_the_graph(self):
        """A node on the false bridge's device makes it one of the robot's devices."""
        self.node(self.edge_b, 'member').call('advertise', topic=self.topic('member'), queue=1)
        bridge = self.greet()
        self.assertTrue(bridge.met(harness.DEADLINE_S), self.bridge.describe())
        return bridge

    def listener(self, port=0):
        """A program of the vehicle that listens on all interfaces and is no service, as sshd."""
        with self.vehicle.entered():
            listening = socket.create_server(('0.0.0.0', port))
        self.addCleanup(listening.close)
        listening.settimeout(0)
        return listening

    def assert_refused(self, bridge, identity, port, service, reason):
        before = self.bridge.refused()['no_service']
        self.assertIn(reason, bridge.open_tunnel(identity, self.vehicle.address, port, service, harness.DEADLINE_S))
        self.assertEqual(self.bridge.refused()['no_service'] - before, 1)

    def test_a_bridge_of_a_device_outside_the_graph_is_not_answered(self):
        stranger = self.greet()
        harness.await_state(lambda: self.bridge.refused()['unknown_peer'] > 0, self.bridge.describe)
        self.assertFalse(stranger.await_frame(lambda kind, _: kind == false_bridge.HELLO, 0))
        self.assertEqual(self.bridge.status()['peers'], [])
        warned = [line for line in self.bridge.lines if 'no node of it is registered' in line]
        self.assertEqual(len(warned), 1, self.bridge.lines)
        self.assertIn(self.edge_b.address, warned[0])

    def test_a_service_is_reached_and_no_other_port(self):
        bridge = self.greet_from_the_graph()
        self.assertEqual(bridge.open_tunnel(1, self.vehicle.address, self.port, self.service, harness.DEADLINE_S), '')
        listening = self.listener()
        other = listening.getsockname()[1]
        self.assert_refused(bridge, 2, other, self.service, 'another port')
        self.assert_refused(bridge, 3, other, '/nobody', 'not registered')
        self.assert_refused(bridge, 4, other, 'SSH-2.0', 'not valid')
        self.assert_refused(bridge, 5, self.port, '/nobody', 'not registered')
        self.assert_refused(bridge, 6, devices.MASTER_PORT, self.service, 'another port')
        with self.assertRaises(BlockingIOError):
            listening.accept()  # nobody has connected
        warned = [line for line in self.bridge.lines if 'a tunnel from' in line]
        self.assertEqual(len(warned), 1, warned)

    def test_a_stale_registration_opens_nothing(self):
        bridge = self.greet_from_the_graph()
        self.server.kill()
        self.assert_refused(bridge, 1, self.port, self.service, 'nobody serves')
        listening = self.listener(self.port)  # another program gets the port
        self.assert_refused(bridge, 2, self.port, self.service, 'nobody serves')
        # Whoever registers the port of another program as a service gets no tunnel to it either.
        self.testbed.call_master('registerService', '/pretended', 'rosrpc://%s:%d' % (self.vehicle.address, self.port),
                                 'http://%s:1/' % self.edge_b.address)
        self.assert_refused(bridge, 3, self.port, '/pretended', 'nobody serves')
        self.assertIsNotNone(listening)


if __name__ == '__main__':
    harness.main(BridgeRelay, plain=False, needs_library=True)
