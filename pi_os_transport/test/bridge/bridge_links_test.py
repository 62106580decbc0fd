#!/usr/bin/python3 -B
"""Judge of bridge_links.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

SIZES = (0, 1, 100, 4096, 65536, 300000, 1000000, 8000000)  # in B: empty to many fragments


def volume(first, count, sizes=SIZES):
    """Bytes of `count` messages of test_peer from number `first` on."""
    return sum(sizes[seq % len(sizes)] for seq in range(first, first + count))


def text(sizes):
    return ','.join(str(size) for size in sizes)


class BridgeLinks(device_testbed.DeviceTest):

    def setUp(self):
        super().setUp()
        self.start_bridges()

    def test_five_subscribers_of_a_device_cost_one_copy(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        listeners = self.nodes(self.edge_a, *('listener%d' % i for i in range(5)))
        talker.call('advertise', topic=topic, queue=1000)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=1000)
        self.await_links(talker, listeners, topic)
        report = talker.call('await_subscribers', n=5)
        self.assertEqual(sorted(report['connected']), sorted(listener.name for listener in listeners))
        before = self.vehicle.counters()
        count = 3 * len(SIZES)
        talker.call('publish', count=count, sizes=text(SIZES))
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=count), count)
        self.assert_copies(self.vehicle, before, volume(1, count), 1 if self.preload else 5)
        self.await_links(talker, listeners, topic)
        self.assert_no_warning(talker, *listeners)
        if self.preload:
            self.assert_counted(topic, talker, listeners, count)

    def assert_counted(self, topic, talker, listeners, count):
        status = self.status(self.vehicle)
        self.assertEqual(status['version'], 1)
        flows = [flow for flow in status['outgoing'] if flow['topic'] == topic]
        self.assertEqual([(flow['publisher'], flow['subscribers'], flow['messages'], flow['lost'], flow['superseded'])
                          for flow in flows], [(talker.name, 5, count, 0, 0)], status)
        self.assertTrue(flows[0]['peer'].startswith(self.edge_a.address), status)
        self.assertGreaterEqual(flows[0]['bytes'], volume(1, count))
        states = {peer['address'].split(':')[0]: peer['state'] for peer in status['peers']}
        self.assertEqual(states.get(self.edge_a.address), 'up', status)
        status = self.status(self.edge_a)
        self.assertEqual(sorted((flow['subscriber'], flow['publisher'], flow['messages'], flow['dropped'], flow['lost'])
                                for flow in status['incoming'] if flow['topic'] == topic),
                         sorted((listener.name, talker.name, count, 0, 0) for listener in listeners), status)

    def test_subscribers_on_all_devices(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        near = self.node(self.vehicle, 'near')
        far = self.nodes(self.edge_a, 'a0', 'a1') + self.nodes(self.edge_b, 'b0', 'b1')
        talker.call('advertise', topic=topic, queue=1000)
        for listener in [near] + far:
            listener.call('subscribe', topic=topic, queue=1000)
        for listener in far:
            listener.await_transports(topic, 'i', [self.NN])
        near.await_transports(topic, 'i', [self.SHM])
        talker.await_transports(topic, 'o', [self.SHM] + 4 * [self.NN])
        before = self.vehicle.counters()
        talker.call('publish', count=2 * len(SIZES), sizes=text(SIZES))
        for listener in [near] + far:
            self.assert_complete(listener.call('await_received', seq=2 * len(SIZES)), 2 * len(SIZES))
        self.assert_copies(self.vehicle, before, volume(1, 2 * len(SIZES)), 2 if self.preload else 4)

    def test_both_directions_and_between_edges(self):
        nodes = {device: self.node(device, 'node_' + device.name) for device in self.testbed.devices.values()}
        topics = {device: self.topic('from_' + device.name) for device in nodes}
        for device, node in nodes.items():
            node.call('advertise', topic=topics[device], queue=1000)
            for other in nodes:
                if other is not device:
                    node.call('subscribe', **{'as': other.name}, topic=topics[other], queue=1000)
        for device, node in nodes.items():
            node.await_transports(topics[device], 'o', [self.NN] * 2)
            for other in nodes:
                node.await_transports(topics[other], 'i', [] if other is device else [self.NN])
        for node in nodes.values():
            node.call('publish', count=100, rate=200, sizes='100,200000', background=True)
        for device, node in nodes.items():
            for other in nodes:
                if other is not device:
                    self.assert_complete(node.call('await_received', sub=other.name, seq=100), 100)

    def test_a_late_joiner_gets_the_latched_message(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        talker.call('advertise', topic=topic, queue=10, latch=True)
        talker.call('publish', count=3, sizes=1000000)
        late = [self.node(self.edge_a, 'late_a'), self.node(self.edge_a, 'late_a2'), self.node(self.edge_b, 'late_b')]
        for n, listener in enumerate(late, 1):
            listener.call('subscribe', topic=topic, queue=10)
            self.assert_complete(listener.call('await_received', n=1), 1, first=3)
            listener.await_transports(topic, 'i', [self.NN])
            talker.await_transports(topic, 'o', n * [self.NN])
        talker.call('publish', count=20, rate=100, sizes='10,500000')
        for listener in late:
            self.assert_complete(listener.call('await_received', seq=23), 21, first=3)

    def test_wrong_type_is_refused_and_nobody_else_notices(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        right, wrong = self.nodes(self.edge_a, 'right', 'wrong')
        talker.call('advertise', topic=topic, queue=100)
        right.call('subscribe', topic=topic, queue=100)
        self.await_links(talker, [right], topic)
        wrong.call('subscribe', topic=topic, type='string', queue=100)
        harness.await_state(lambda: talker.output(r'Client .*wants topic'), 'refusal in the output of the publisher')
        talker.call('publish', count=50, sizes='10,100000')
        self.assert_complete(right.call('await_received', seq=50), 50)
        self.assertEqual(talker.call('publisher')['subscribers'], 1)
        self.assertEqual(wrong.call('report')['received'], 0)
        wrong.call('unsubscribe')
        wrong.call('subscribe', topic=topic, queue=100)
        self.await_links(talker, [right, wrong], topic)
        talker.call('publish', count=10, sizes=5000)
        self.assert_complete(wrong.call('await_received', seq=60), 10, first=51)
        self.assert_complete(right.call('await_received', seq=60), 60)

    def test_publisher_and_subscribers_come_and_go(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        listeners = self.nodes(self.edge_a, 'a0', 'a1') + self.nodes(self.edge_b, 'b0')
        talker.call('advertise', topic=topic, queue=1000)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=1000)
        self.await_links(talker, listeners, topic)
        talker.call('await_subscribers', n=3)
        talker.call('publish', count=0, rate=200, sizes='100,30000', background=True)
        # One leaves in order, one is killed, another one comes back under its name: the one that stays misses nothing.
        for remaining, leave in ((2, lambda: listeners[1].call('unsubscribe')), (1, listeners[2].kill)):
            leave()
            talker.call('await_subscribers', n=remaining)
            self.assert_flows(talker, listeners[0])
        again = self.node(self.edge_b, 'b0')
        again.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=2)
        self.await_links(talker, [listeners[0], again], topic)
        self.assert_flows(talker, again)
        last = talker.call('stop')['published']
        self.assert_complete(listeners[0].call('await_received', seq=last), last)
        self.assert_order(again.call('await_received', seq=last))
        # The publisher is killed and comes back under its name.
        talker.kill()
        talker = self.node(self.vehicle, 'talker')
        talker.call('advertise', topic=topic, queue=1000, id=2)
        self.await_links(talker, [listeners[0], again], topic)
        talker.call('await_subscribers', n=2)
        talker.call('publish', count=50, sizes=text(SIZES[:-1]))
        for listener in (listeners[0], again):
            self.assert_complete(listener.call('await_received', id=2, seq=50), 50, identity=2)
        if self.preload:
            harness.await_state(lambda: [flow['subscribers'] for flow in self.status(self.vehicle)['outgoing']
                                         if flow['topic'] == topic] == [1, 1], lambda: self.status(self.vehicle))

    def test_peers_without_the_library_stay_on_tcpros(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        bridged = self.node(self.edge_a, 'bridged')
        python = self.node(self.edge_a, 'python', kind='rospy')
        plain = self.node(self.edge_a, 'plain', preload='')
        talker.call('advertise', topic=topic, queue=1000)
        for listener in (bridged, python, plain):
            listener.call('subscribe', topic=topic, queue=1000)
        bridged.await_transports(topic, 'i', [self.NN])
        talker.await_transports(topic, 'o', ['TCPROS', 'TCPROS', self.NN])
        talker.call('await_subscribers', n=3)
        talker.call('publish', count=200, rate=400, sizes='100,100000,0,500000')
        for listener in (bridged, python, plain):
            self.assert_complete(listener.call('await_received', seq=200), 200)
        self.assertEqual(plain.transports(topic, 'i'), ['TCPROS'])
        # The other way round: publishers without the library.
        back = self.topic('back')
        for number, peer in enumerate((python, plain), 1):
            peer.call('advertise', topic=back, queue=1000, id=number)
        talker.call('subscribe', topic=back, queue=1000)
        talker.await_transports(back, 'i', ['TCPROS', 'TCPROS'])
        for number, peer in enumerate((python, plain), 1):
            peer.call('await_subscribers', n=1)
            peer.call('publish', count=50, sizes='100,100000')
            self.assert_complete(talker.call('await_received', id=number, seq=50), 50, identity=number)

    def test_a_node_that_wants_no_bridge_stays_on_tcpros(self):
        for who in ('publisher', 'subscriber'):
            with self.subTest(who=who):
                off = {'PI_OS_BRIDGE': '0'}
                topic = self.topic(who)
                talker = self.node(self.vehicle, 'talker_' + who, env=off if who == 'publisher' else None)
                listeners = self.nodes(self.edge_a, 'l0_' + who, 'l1_' + who, 'l2_' + who,
                                       env=off if who == 'subscriber' else None)
                near = self.node(self.vehicle, 'near_' + who)
                talker.call('advertise', topic=topic, queue=1000)
                near.call('subscribe', topic=topic, queue=1000)
                near.await_transports(topic, 'i', [self.SHM])  # the library itself is at work
                for listener in listeners:
                    listener.call('subscribe', topic=topic, queue=1000)
                talker.call('await_subscribers', n=4)
                before = self.vehicle.counters()
                talker.call('publish', count=20, sizes='100,1000000')
                for listener in listeners:
                    self.assert_complete(listener.call('await_received', seq=20), 20)
                    self.assertEqual(listener.transports(topic, 'i'), ['TCPROS'])
                self.assertEqual(talker.transports(topic, 'o'), sorted([self.SHM] + 3 * ['TCPROS']))
                self.assert_copies(self.vehicle, before, volume(1, 20, (100, 1000000)), 3)

    def test_a_slow_network_drops_the_oldest(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        listener = self.node(self.edge_a, 'listener')
        talker.call('advertise', topic=topic, queue=2)
        listener.call('subscribe', topic=topic, queue=1000)
        self.await_links(talker, [listener], topic)
        self.edge_a.shape(rate_mbit=20)
        count = 300
        talker.call('publish', count=count, rate=40, sizes=250000)  # 80 Mbit/s
        report = listener.call('await_received', seq=count, timeout=10)
        lost = self.assert_order(report, most_lost=count)
        self.assertGreater(lost, count / 3)
        self.assertGreater(report['received'], count / 12)  # a third of the network's capacity at the least
        if self.preload:
            status = self.status(self.vehicle)
            flows = [flow for flow in status['outgoing'] if flow['topic'] == topic]
            self.assertEqual(len(flows), 1, status)
            self.assertEqual(flows[0]['messages'], report['received'], status)  # the publisher dropped, not the bridge

    def test_a_slow_subscriber_drops_its_oldest_and_holds_nobody_up(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        slow, fast = self.nodes(self.edge_a, 'slow', 'fast')
        talker.call('advertise', topic=topic, queue=1000)
        slow.call('subscribe', topic=topic, queue=5, hold=True, log=True)
        fast.call('subscribe', topic=topic, queue=1000)
        self.await_links(talker, [slow, fast], topic)
        talker.call('publish', count=300, rate=300, sizes='1000,100000')
        self.assert_complete(fast.call('await_received', seq=300), 300)
        # roscpp reads on while the callback is held: what a full queue of 5 loses is lost in the subscriber.
        harness.await_state(lambda: not self.preload or [
            flow['messages'] for flow in self.status(self.edge_a)['incoming'] if flow['subscriber'] == slow.name
        ] == [300], lambda: self.status(self.edge_a))
        slow.call('release')
        report = slow.call('await_received', seq=300)
        self.assert_order(report, most_lost=300)
        self.assertEqual([seq for _, seq in report['log']][-5:], [296, 297, 298, 299, 300])
        if self.preload:
            self.assertEqual(len(report['log']), 6, report['log'])


if __name__ == '__main__':
    harness.main(BridgeLinks)
