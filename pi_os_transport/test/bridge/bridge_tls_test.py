#!/usr/bin/python3 -B
"""Judge of bridge_tls.test."""
import os
import pathlib
import random
import shutil
import socket
import sys
import tempfile
import xmlrpc.client

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from device_testbed import LOAD_FACTOR, bench, device_keys, devices  # noqa: E402

MB = 1000000
SIZES = '100,2000,50000,600000'
PROMPT_S = 1.0 * LOAD_FACTOR
HANDSHAKES = 10000 if 'PI_EDGE_SOAK' in os.environ else 300
REQUIRED = {'PI_OS_REQUIRE_BRIDGE': '1'}


class BridgeTls(device_testbed.DeviceTest):

    made = {}  # folders of keys, by fleet and device: each fleet is made once

    @classmethod
    def tearDownClass(cls):
        for folders in cls.made.values():
            for folder in folders.values():
                shutil.rmtree(folder)
        cls.made.clear()
        super().tearDownClass()

    def keys_of(self, fleet, shared=False):
        """Arguments of the bridges, by device."""
        if fleet not in self.made:
            made = device_keys.make_keys(self.testbed, fleet, shared)
            self.made[fleet] = {name: tempfile.mkdtemp(prefix='pi_os_test_') for name in made}
            for name, args in made.items():
                shutil.copytree(args[-1], self.made[fleet][name], dirs_exist_ok=True)
        return {name: ('--secure', 'tls', '--keys', folder) for name, folder in self.made[fleet].items()}

    def protect(self, *where, config=None, shared=False):
        """Starts bridges with keys of one fleet on the devices, or on those given. `config`: YAML by device."""
        self.keys = self.keys_of('sharing' if shared else 'fleet', shared)
        for device in where or self.testbed.devices.values():
            self.start_protected(device, (config or {}).get(device.name))

    def start_protected(self, device, config=None):
        args = list(self.keys[device.name])
        if config:
            path = os.path.join(self.scratch(), 'bridge.yaml')
            with open(path, 'w') as file:
                file.write(config)
            args += ['--config', path]
        return self.start_bridge(device, *args)

    def pair(self, topic, publisher_env=None, subscriber_env=None):
        talker = self.node(self.vehicle, 'talker', env=publisher_env)
        listener = self.node(self.edge_a, 'listener', env=subscriber_env)
        talker.call('advertise', topic=topic, queue=1000)
        listener.call('subscribe', topic=topic, queue=1000)
        return talker, listener

    def await_said(self, device, *words):
        """Waits until the bridge of a device has said one line with all these words."""
        bridge = self.bridges[device.name]
        harness.await_state(lambda: [line for line in bridge.lines if all(word in line for word in words)],
                            lambda: '%s not in: %s' % (words, bridge.lines))

    def assert_stays_outside(self, device, topic, talker):
        """A node there gets the topic over TCPROS alone."""
        outsider = self.node(device, 'outsider')
        outsider.call('subscribe', topic=topic, queue=1000)
        before = talker.call('publisher')['published']
        talker.call('await_published', n=before + 50)
        outsider.await_transports(topic, 'i', ['TCPROS'])
        return outsider

    # ------------------------------------------------------------------------------------------------------ the traffic

    def traffic(self):
        topic = self.topic()
        talker, listener = self.pair(topic)
        self.await_links(talker, [listener], topic)
        talker.call('publish', count=300, rate=300, sizes=SIZES)
        self.assert_complete(listener.call('await_received', seq=300), 300)
        for device in (self.vehicle, self.edge_a):
            peers = [peer for peer in self.status(device)['peers'] if peer['state'] == 'up']
            self.assertEqual(self.status(device)['secure'], 'tls')
            self.assertTrue(peers and all(peer['identity'] for peer in peers), peers)

    def test_topics_and_services_with_certificates(self):
        self.protect()
        self.traffic()
        self.assertEqual({peer['identity'] for peer in self.status(self.vehicle)['peers']}, {'edge_a'})
        service = self.topic('service')
        server = self.node(self.vehicle, 'server', kind='service_peer')
        client = self.node(self.edge_a, 'client', kind='service_peer')
        server.call('serve', service=service)
        client.call('await_service', service=service)
        report = client.call('call', service=service, count=20, size=800, answer=MB, persistent=True)
        self.assertEqual((report['calls'], report['failed'], report['wrong']), (20, 0, 0), report)
        self.assertGreater(sum(peer['received_bytes'] for peer in self.status(self.edge_a)['peers']), 20 * MB)

    def test_topics_with_a_shared_key(self):
        self.protect(shared=True)
        self.traffic()

    def test_nothing_can_be_read_on_the_network(self):
        self.protect(self.vehicle, self.edge_a)
        recorder = device_testbed.hostile.Recorder(self.testbed, self.vehicle)
        self.traffic()
        recorder.stop()
        streams = [b''.join(pieces.values()) for pieces in recorder._streams.values()]
        self.assertGreater(sum(map(len, streams)), 1000)
        for stream in streams:
            self.assertEqual(stream[0], 22, stream[:20])  # a handshake of TLS
            for word in (b'test_nothing', b'\0SP\0', b'10.88.'):
                self.assertNotIn(word, stream)

    # ------------------------------------------------------------------------------------------------ who stays outside

    def flow(self):
        """Traffic from the vehicle to edge_a that goes on."""
        topic = self.topic()
        talker, listener = self.pair(topic)
        self.await_links(talker, [listener], topic)
        talker.call('publish', count=0, rate=200, sizes=SIZES, background=True)
        self.assert_flows(talker, listener)
        return topic, talker, listener

    def test_a_revoked_device(self):
        self.protect(config={'vehicle': 'trust: [{name: edge_b, allow: false}, {name: "*"}]\n'})
        topic, talker, listener = self.flow()
        self.assert_stays_outside(self.edge_b, topic, talker)
        self.await_said(self.vehicle, self.edge_b.address, 'is not trusted', '"edge_b" is revoked')
        self.await_said(self.edge_b, self.vehicle.address, 'this device is revoked there')
        self.assertGreater(self.bridges['vehicle'].refused()['untrusted'], 0)
        self.assert_flows(talker, listener, PROMPT_S)

    def test_a_device_with_another_name_than_configured(self):
        self.protect(self.edge_b, config={})
        self.start_bridge(self.edge_a, *self.keys['edge_a'], '--peer', 'vehicle@' + self.edge_b.address)
        self.await_said(self.edge_a, 'its name is "edge_b", not "vehicle"')

    def test_topics_that_a_device_is_not_trusted_with(self):
        allowed, forbidden = self.topic('allowed'), self.topic('forbidden')
        self.protect(config={'vehicle': 'trust: [{name: edge_a, topics: ["/allowed*"]}]\n'})
        talker, listener = self.pair(allowed)
        talker.call('advertise', topic=forbidden, queue=1000, id=2)
        listener.call('subscribe', **{'as': 'f'}, topic=forbidden, queue=1000)
        listener.await_transports(allowed, 'i', ['NNROS'])
        self.await_said(self.vehicle, '"edge_a" may not receive ' + forbidden)
        listener.await_transports(forbidden, 'i', ['TCPROS'])

    def test_plain_and_protected_bridges(self):
        self.protect(self.vehicle, self.edge_a)
        self.start_bridge(self.edge_b)
        topic, talker, listener = self.flow()
        self.assert_stays_outside(self.edge_b, topic, talker)
        self.await_said(self.vehicle, self.edge_b.address, 'is not trusted: it does not speak TLS')
        self.await_said(self.edge_b, self.vehicle.address, 'is not trusted: it speaks TLS: set secure: tls')
        self.assert_flows(talker, listener, PROMPT_S)

    def test_keys_of_another_fleet(self):
        self.protect(self.vehicle, self.edge_a)
        other = self.keys_of('other')
        self.start_bridge(self.edge_b, *other['edge_b'])
        topic, talker, listener = self.flow()
        self.assert_stays_outside(self.edge_b, topic, talker)
        self.await_said(self.vehicle, self.edge_b.address, 'is not trusted')
        self.await_said(self.edge_b, self.vehicle.address, 'is not trusted')
        self.assert_flows(talker, listener, PROMPT_S)

    def test_hostile_handshakes(self):
        self.protect(self.vehicle, self.edge_a)
        topic, talker, listener = self.flow()
        bridge = self.bridges['vehicle']
        files, resident_kb = len(harness.open_files(bridge.pid)), bridge.resident_kb()
        pick = random.Random(3)
        for attempt in range(HANDSHAKES):
            with self.edge_b.entered():
                connection = socket.create_connection((self.vehicle.address, devices.BRIDGE_PORT), timeout=5.0)
            with connection:
                head = b'\x16\x03\x01' + pick.randrange(1 << 14).to_bytes(2, 'big') if attempt % 2 else b''
                try:
                    connection.sendall(head + pick.randbytes(pick.randrange(1, 2000)))
                except OSError:
                    pass  # ended by the bridge meanwhile
            if attempt % (HANDSHAKES // 10) == 0:
                self.assert_flows(talker, listener, PROMPT_S)
        harness.await_state(lambda: len(harness.open_files(bridge.pid)) <= files + 2,
                            lambda: harness.open_files(bridge.pid))
        self.assertLess(bridge.resident_kb(), resident_kb + 8 * 1024)
        self.await_links(talker, [listener], topic, 'NNROS', PROMPT_S)

    def test_libnanomsg_cannot_protect(self):
        keys = self.keys_of('fleet')
        with self.assertRaises(bench.BenchError) as refused:
            self.vehicle.start_bridge(*keys['vehicle'], '--wire', 'nanomsg')
        self.assertIn('libnanomsg cannot encrypt, wire must be sp', str(refused.exception))

    # ---------------------------------------------------------------------------------------------- nothing unprotected

    def test_a_required_bridge_carries_from_the_first_message_on(self):
        self.protect(self.vehicle, self.edge_a)
        topic = self.topic()
        talker, listener = self.pair(topic, REQUIRED, REQUIRED)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=100, rate=200, sizes=SIZES)
        self.assert_complete(listener.call('await_received', seq=100), 100)
        self.await_links(talker, [listener], topic)
        self.assertIn(', 0 through TCPROS', self.link_info(talker, topic))

    def link_info(self, talker, topic):
        """What getBusInfo says of the publisher's link."""
        uri = self.testbed.call_master('lookupNode', talker.name)
        with talker.device.entered(), xmlrpc.client.ServerProxy(uri) as proxy:
            return ' '.join(str(entry) for entry in proxy.getBusInfo('/judge')[2] if entry[4] == topic)

    def test_without_its_bridge_a_link_waits_and_says_so(self):
        topic = self.topic()
        talker, listener = self.pair(topic, REQUIRED)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=0, rate=20, sizes='100', background=True)
        harness.await_state(lambda: talker.output('PI_OS_REQUIRE_BRIDGE'), lambda: talker.lines)
        self.assertIn(topic, talker.output('PI_OS_REQUIRE_BRIDGE')[0])
        self.assertEqual(listener.call('report')['flows'], {})
        self.protect(self.vehicle, self.edge_a)
        listener.call('await_received', seq=talker.call('publisher')['published'])
        self.assertEqual(len(talker.output('PI_OS_REQUIRE_BRIDGE')), 1, talker.lines)

    def test_a_node_without_the_library_is_refused(self):
        self.protect(self.vehicle, self.edge_a)
        topic, inside = self.topic(), self.topic('inside')
        talker = self.node(self.vehicle, 'talker', env=REQUIRED)
        talker.call('advertise', topic=topic, queue=1000)
        plain = self.node(self.edge_a, 'plain', preload='')
        plain.call('subscribe', topic=topic, queue=1000)
        harness.await_state(lambda: talker.output('a subscriber of %s on another device is refused' % topic),
                            lambda: talker.lines)
        near = self.node(self.vehicle, 'near', preload='')  # on the same device nothing changes
        near.call('subscribe', topic=topic, queue=1000)
        talker.call('publish', count=50, rate=100, sizes='100')
        near.call('await_received', seq=50)
        self.assertEqual(plain.call('report')['flows'], {}, inside)

    def test_services_without_a_bridge_fail(self):
        service = self.topic('service')
        server = self.node(self.vehicle, 'server', kind='service_peer')
        server.call('serve', service=service)
        client = self.node(self.edge_a, 'client', kind='service_peer', env=REQUIRED)
        client.call('await_service', service=service)
        report = client.call('call', service=service, count=3, size=80, answer=20)
        self.assertEqual((report['calls'], report['failed']), (3, 3), report)
        self.assertEqual(len(client.output('calls of %s on another device fail' % service)), 1, client.lines)


if __name__ == '__main__':
    harness.main(BridgeTls, plain=False, needs_library=True)
