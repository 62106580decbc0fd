"""What the rostests of the bridge between devices share: devices, their bridges, and steered nodes on them.

The devices are those of the benchmark (bench/transport_bench/devices.py), imported from the devel or install space,
where its programs are. Each test gets devices of its own: `vehicle`, which also runs the master, `edge_a`, `edge_b`.

A test class runs once plain, on TCPROS without bridges, and once with the library and, after start_bridges(), with a
bridge on every device. NN is what getBusInfo has to show for a link between devices in that run.
"""
import os
import sys
import time

import transport_harness as harness

sys.path[:0] = [os.path.join(prefix, 'lib', harness.PACKAGE)
                for prefix in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if prefix]
import transport_bench as bench  # noqa: E402  (from the devel or install space, where its programs are)
from transport_bench import device_keys, device_nodes, devices, hostile  # noqa: E402

__all__ = ['DevicePeer', 'DeviceTest', 'bench', 'device_keys', 'device_nodes', 'devices', 'hostile', 'with_bridges']

LOAD_FACTOR = 2.0  # what is promised within 1 s must hold within 2 s here: the test machine does other things as well
FRESH = 3          # messages sent after an event that show that traffic goes on


class DevicePeer(harness.Peer):
    """A steered node on a device. kind as in harness.Peer, or service_peer, image_peer."""

    def __init__(self, device, name, preload='', env=None, kind='test_peer', threads=1, args=()):
        self.name = '/' + name
        self.device = device
        self._uri = None
        programs = {'test_peer': harness.PACKAGE + '_test_peer', 'rospy': 'rospy_peer.py',
                    'service_peer': harness.PACKAGE + '_test_service_peer',
                    'image_peer': harness.PACKAGE + '_test_image_peer',
                    'zero_copy': harness.PACKAGE + '_test_zero_copy_peer'}
        command = [harness.program(programs[kind]), str(threads), '__name:=' + name] + list(args)
        variables = {key: value for key, value in device.environment(env).items()
                     if key.startswith('ROS_') or key.startswith('PI_OS_')}
        with device.entered():
            harness.Process.__init__(self, command, preload, variables,
                                     ['setpriv', '--pdeathsig', 'KILL', 'env', '-u', 'ROS_HOSTNAME'])
        device.processes.append(self)

    def bus_info(self):
        self._uri = self._uri or self.device.testbed.call_master('lookupNode', self.name)
        return [(None, None, *link) for link in self.device.testbed.bus_info(self.device, self.name, self._uri)]


def with_bridges(test):
    """Marks a test of what only bridges do: there is none of it in the plain run."""
    test.with_bridges = True
    return test


class DeviceTest(harness.TransportTest):

    NN = 'TCPROS'

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        if cls.__name__.endswith('Plain'):  # see harness.variants()
            for name in dir(cls):
                if getattr(getattr(cls, name), 'with_bridges', False):
                    setattr(cls, name, None)

    def setUp(self):
        super().setUp()
        try:
            self.testbed = devices.Testbed()
        except devices.Unsupported as reason:
            self.skipTest(str(reason))
        self.addCleanup(self.testbed.close)
        self.vehicle, self.edge_a, self.edge_b = self.testbed.devices.values()
        self.bridges = {}
        self.addCleanup(self._show_bridges)
        if self.preload:
            self.NN = 'NNROS'

    def _show_bridges(self):
        for name, bridge in self.bridges.items():
            for line in bridge.lines[1:]:
                print('bridge on %s: %s' % (name, line))

    # --------------------------------------------------------------------------------------------------- the processes

    def start_bridge(self, device, *args):
        self.bridges[device.name] = device.start_bridge(*args)
        return self.bridges[device.name]

    def start_bridges(self, *where):
        """A bridge on each device, or on those given. Does nothing in the plain run."""
        if self.preload:
            for device in where or self.testbed.devices.values():
                self.start_bridge(device)

    def status(self, device):
        return self.bridges[device.name].status()

    def node(self, device, name, preload=None, **options):
        """Starts a node on a device; preload None means that of this run."""
        peer = DevicePeer(device, self.unique(name), self.preload if preload is None else preload, **options)
        self.addCleanup(peer.close)
        return peer.ready()

    def nodes(self, device, *names, **options):
        """Starts several nodes on a device at once."""
        started = [DevicePeer(device, self.unique(name), self.preload, **options) for name in names]
        for peer in started:
            self.addCleanup(peer.close)
        return [peer.ready() for peer in started]

    # -------------------------------------------------------------------------------------------------------- the links

    def await_links(self, publisher, subscribers, topic, transport=None, timeout=harness.DEADLINE_S):
        """Waits until publisher and subscribers have exactly the links between them, all over one transport."""
        transport = transport or self.NN
        deadline = time.monotonic() + timeout
        for subscriber in subscribers:
            subscriber.await_transports(topic, 'i', [transport], max(deadline - time.monotonic(), 0))
        publisher.await_transports(topic, 'o', [transport] * len(subscribers), max(deadline - time.monotonic(), 0))

    def assert_flows(self, publisher, subscriber, within_s=harness.DEADLINE_S, identity=1):
        """Messages published after this call arrive within the time. @return how long it took [s]"""
        begin = time.monotonic()
        sent = publisher.call('publisher')['published']
        subscriber.send('await_received', id=identity, seq=sent + FRESH, timeout=within_s)
        reply = subscriber.answer()
        self.assertTrue(reply['ok'], '%s: nothing later than %d from %s within %.1f s: %s; links there: %s'
                        % (subscriber.name, sent, publisher.name, within_s, reply, publisher.bus_info()))
        return time.monotonic() - begin

    def assert_order(self, report, identity=1, most_lost=0):
        """In order, none twice, undamaged. @return the number of those that are missing, at most most_lost."""
        flow = report['flows'][str(identity)]
        self.assertEqual((report['corrupt'], flow['reordered']), (0, 0), report)
        self.assertLessEqual(flow['lost'], most_lost, report)
        return flow['lost']

    def assert_copies(self, device, before, volume, copies):
        """The device has sent `volume` bytes of messages so many times since the counters `before`."""
        sent = device.counters()['sent'] - before['sent']
        # 1514 bytes of Ethernet carry 1448 of a TCP stream; acknowledgements and frame headers are the rest.
        self.assertGreater(sent, 0.99 * copies * volume, 'copies expected: %d' % copies)
        self.assertLess(sent, 1.07 * copies * volume + 100000, 'copies expected: %d' % copies)
