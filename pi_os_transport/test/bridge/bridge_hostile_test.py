#!/usr/bin/python3 -B
"""Judge of bridge_hostile.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from device_testbed import LOAD_FACTOR, hostile  # noqa: E402

FRAMES = 2000
SEED = 20
RATE_HZ = 200
SIZES = '100,2000,50000,600000'
PROMPT_S = 1.0 * LOAD_FACTOR
MOST_GROWTH_KB = 32 * 1024  # of the bridge; the frames of one attack could announce far more


class BridgeHostile(device_testbed.DeviceTest):

    def setUp(self):
        super().setUp()
        # edge_b is a stranger: it may not speak to the vehicle's bridge.
        self.bridge = self.start_bridge(self.vehicle, '--allow', self.edge_a.address + '/32')
        self.start_bridge(self.edge_a)
        self.subject = self.topic()
        self.talker = self.node(self.edge_a, 'talker')
        self.listener = self.node(self.vehicle, 'listener')
        recorder = hostile.Recorder(self.testbed, self.vehicle)
        self.talker.call('advertise', topic=self.subject, queue=1000)
        self.listener.call('subscribe', topic=self.subject, queue=1000)
        self.await_links(self.talker, [self.listener], self.subject)
        self.talker.call('publish', count=0, rate=RATE_HZ, sizes=SIZES, background=True)
        self.assert_flows(self.talker, self.listener)
        self.talker.call('await_published', n=200)
        self.frames = recorder.stop()
        # Whoever overhears a session could go on with it: what is recorded is of an earlier one.
        self.bridge.kill()
        self.bridge = self.start_bridge(self.vehicle, *self.bridge.args)
        self.await_links(self.talker, [self.listener], self.subject)
        self.talker.call('stop')
        self.listener.call('await_received', seq=self.talker.call('publisher')['published'])
        self.listener.call('reset')
        self.first = self.talker.call('publisher')['published'] + 1
        self.talker.call('publish', count=0, rate=RATE_HZ, sizes=SIZES, background=True)
        self.assert_flows(self.talker, self.listener)

    def attack(self, device, kinds=hostile.KINDS, count=FRAMES):
        """@return what the bridge has refused meanwhile, by reason."""
        before = self.bridge.refused()
        attacker = hostile.Attacker(device, self.vehicle.address, self.frames, SEED)
        for _ in range(10):
            attacker.send(count // 10, kinds)
            self.assert_flows(self.talker, self.listener, PROMPT_S)
        self.assertEqual(sum(attacker.sent.values()), count)
        self.assertEqual(attacker.unended, 0)  # a bridge ends what has nothing more to say
        self.assertTrue(self.bridge.alive(), self.bridge.describe())
        after = self.bridge.refused()
        return {reason: after[reason] - before[reason] for reason in after}

    def assert_unharmed(self, resident_kb, *others):
        self.await_links(self.talker, [self.listener, *others], self.subject, 'NNROS', PROMPT_S)
        last = self.talker.call('stop')['published']
        self.assert_complete(self.listener.call('await_received', seq=last), last - self.first + 1, first=self.first)
        self.assertLess(self.bridge.resident_kb(), resident_kb + MOST_GROWTH_KB)
        self.assertEqual(self.bridge.terminate(), 0, self.bridge.lines)

    def test_bad_frames_from_a_device_that_may_speak(self):
        resident_kb = self.bridge.resident_kb()
        refused = self.attack(self.edge_a)
        print('refused:', refused)
        for reason in ('wrong_version', 'oversized', 'malformed', 'bad_session'):
            self.assertGreater(refused[reason], FRAMES / len(hostile.KINDS) / 10, refused)
        self.assertEqual(refused['unknown_peer'], 0, refused)
        self.assert_unharmed(resident_kb)

    def test_each_kind_is_refused_for_what_it_is(self):
        for kind, reason in (('version', 'wrong_version'), ('oversized', 'oversized'), ('session', 'bad_session'),
                             ('handshake', 'malformed'), ('garbage', 'malformed'), (hostile.STRANGER, 'unknown_peer')):
            with self.subTest(kind=kind):
                refused = self.attack(self.edge_a, (kind,), 50)
                self.assertGreaterEqual(refused[reason], 20, refused)

    def test_a_device_that_may_not_speak(self):
        resident_kb = self.bridge.resident_kb()
        refused = self.attack(self.edge_b, count=500)
        self.assertGreaterEqual(refused['unknown_peer'], 100, refused)
        self.assertEqual([refused[reason] for reason in ('wrong_version', 'oversized', 'malformed', 'bad_session')],
                         [0, 0, 0, 0], refused)  # nothing of it is even read
        # Nor do its nodes get a bridge: they fall back to TCPROS and lose nothing.
        self.start_bridge(self.edge_b)
        stranger = self.node(self.edge_b, 'stranger')
        stranger.call('subscribe', topic=self.subject, queue=1000)
        stranger.await_transports(self.subject, 'i', ['NNROS'])  # its node is in the graph, and the others allow that
        outside = self.topic('outside')
        stranger.call('advertise', topic=outside, queue=1000, id=2)
        self.listener.call('subscribe', **{'as': 'o'}, topic=outside, queue=1000)
        stranger.call('await_subscribers', n=1)
        stranger.call('publish', count=100, rate=100, sizes=SIZES)
        self.assert_complete(self.listener.call('await_received', sub='o', id=2, seq=100), 100, identity=2)
        self.assertEqual(self.listener.transports(outside, 'i'), ['TCPROS'])
        self.assert_unharmed(resident_kb, stranger)

    def test_many_connections_that_say_nothing(self):
        resident_kb = self.bridge.resident_kb()
        files = len(harness.open_files(self.bridge.pid))
        with self.edge_a.entered():
            silent = []
            for _ in range(300):
                try:
                    silent.append(hostile.connect((self.vehicle.address, device_testbed.devices.BRIDGE_PORT)))
                except OSError:  # more than the bridge takes
                    break
        self.assert_flows(self.talker, self.listener, PROMPT_S)
        for connection in silent:
            connection.close()
        harness.await_state(lambda: len(harness.open_files(self.bridge.pid)) <= files + 2,
                            lambda: harness.open_files(self.bridge.pid))
        self.assert_unharmed(resident_kb)


if __name__ == '__main__':
    harness.main(BridgeHostile, plain=False, needs_library=True)
