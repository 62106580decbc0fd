#!/usr/bin/python3 -B
"""Judge of bridge_failures.test."""
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from device_testbed import LOAD_FACTOR  # noqa: E402

RATE_HZ = 100
SIZES = '100,2000,50000'
QUEUE = 1000                        # of publishers whose messages must all arrive
PROMPT_S = 1.0 * LOAD_FACTOR        # a bridge that dies, appears, or can be reached again
HUNG_S = 2.0 * LOAD_FACTOR          # a bridge that stands still is noticed by its silence
CUT_S = 4.0                         # longer than the silence that means a peer is gone

CUT_QUEUE = 10                      # of the publisher in the tests that cut the cable
CUT_RATE_HZ = 50
CUT_BYTES = 150000
IN_FLIGHT = 8                       # messages that had left the publisher's queue when the cable was cut: 1.2 MB


class BridgeFailures(device_testbed.DeviceTest):

    def pair(self, queue=QUEUE, rate=RATE_HZ, sizes=SIZES, edge=None, transport=None):
        """A publisher on the vehicle and a subscriber on an edge, with traffic until told to stop."""
        self.subject = self.topic()
        talker = self.node(self.vehicle, 'talker')
        listener = self.node(edge or self.edge_a, 'listener')
        talker.call('advertise', topic=self.subject, queue=queue)
        listener.call('subscribe', topic=self.subject, queue=1000, log=True)
        self.await_links(talker, [listener], self.subject, transport)
        talker.call('publish', count=0, rate=rate, sizes=sizes, background=True)
        self.assert_flows(talker, listener)
        return talker, listener

    def finish(self, talker, listener, most_lost=0):
        """Ends the traffic and judges all of it. @return the number of lost messages."""
        last = talker.call('stop')['published']
        report = listener.call('await_received', seq=last)
        return self.assert_order(report, most_lost=most_lost)

    def assert_back(self, talker, listeners, within_s=PROMPT_S):
        """All links are over the bridges again within the time, and carry traffic."""
        self.await_links(talker, listeners, self.subject, 'NNROS', within_s)
        for listener in listeners:
            self.assert_flows(talker, listener, PROMPT_S)

    # ----------------------------------------------------------------------------------------------------- the bridges

    def test_bridges_that_start_later_take_over_without_loss(self):
        talker, listener = self.pair(transport='TCPROS')
        self.start_bridges(self.vehicle)
        self.assert_flows(talker, listener, PROMPT_S)
        self.assertEqual(listener.transports(self.subject, 'i'), ['TCPROS'])  # one bridge is none
        self.start_bridges(self.edge_a)
        self.assert_back(talker, [listener])
        last = talker.call('stop')['published']
        self.assert_complete(listener.call('await_received', seq=last), last)

    def killed(self, device):
        self.start_bridges()
        talker, listener = self.pair()
        for _ in range(3):
            self.bridges[device.name].kill()
            self.assert_flows(talker, listener, PROMPT_S)
            self.await_links(talker, [listener], self.subject, 'TCPROS', PROMPT_S)
            self.start_bridge(device)
            self.assert_back(talker, [listener])
        self.finish(talker, listener)

    def test_the_subscribers_bridge_is_killed(self):
        self.killed(self.edge_a)

    def test_the_publishers_bridge_is_killed(self):
        self.killed(self.vehicle)

    def test_a_bridge_that_is_told_to_end_loses_nothing(self):
        self.start_bridges()
        talker, listener = self.pair()
        for device in (self.edge_a, self.vehicle):
            self.assertEqual(self.bridges[device.name].terminate(), 0, self.bridges[device.name].lines)
            self.assert_flows(talker, listener, PROMPT_S)
            self.await_links(talker, [listener], self.subject, 'TCPROS', PROMPT_S)
            self.start_bridge(device)
            self.assert_back(talker, [listener])
        self.finish(talker, listener, most_lost=0)

    def stopped(self, device, most_lost):
        self.start_bridges()
        talker, listener = self.pair()
        for _ in range(2):
            self.bridges[device.name].pause()
            self.assert_flows(talker, listener, HUNG_S)
            self.await_links(talker, [listener], self.subject, 'TCPROS', HUNG_S)
            self.bridges[device.name].resume()
            self.assert_back(talker, [listener], HUNG_S)
        self.finish(talker, listener, most_lost)

    def test_the_subscribers_bridge_stands_still_and_goes_on(self):
        self.stopped(self.edge_a, most_lost=0)

    def test_the_publishers_bridge_stands_still_and_goes_on(self):
        self.stopped(self.vehicle, most_lost=2 * HUNG_S * RATE_HZ)  # its publisher does not notice

    def test_a_bridge_is_restarted_before_anybody_notices(self):
        # The new process must not take what belongs to the old one's sessions.
        self.start_bridges()
        talker, listener = self.pair()
        for device in (self.vehicle, self.edge_a) * 3:
            self.bridges[device.name].kill()
            self.start_bridge(device)
            self.assert_flows(talker, listener, PROMPT_S)
        self.assert_back(talker, [listener], harness.DEADLINE_S)
        self.finish(talker, listener)

    # ----------------------------------------------------------------------------------------------------- the network

    def cut(self, how):
        self.start_bridges()
        talker, listener = self.pair(queue=CUT_QUEUE, rate=CUT_RATE_HZ, sizes=CUT_BYTES)
        for _ in range(2):
            self.edge_a.cut(how)
            time.sleep(CUT_S)  # the length of the cut is what is tested
            before = len(listener.call('report')['log'])
            restored_at = talker.call('publisher')['published']
            self.edge_a.restore()
            self.assert_flows(talker, listener, PROMPT_S)
            after = [seq for _, seq in listener.call('report')['log'][before:]]
            old = [seq for seq in after if seq <= restored_at]
            self.assertLessEqual(len(old), CUT_QUEUE + IN_FLIGHT, 'delivered after the cut though older: %s' % old)
            self.assertGreater(restored_at, after[0] - 1 - CUT_S * CUT_RATE_HZ)  # the cut was one: that much was due
            self.assert_back(talker, [listener], HUNG_S)
        lost = self.finish(talker, listener, most_lost=2 * (CUT_S + PROMPT_S) * CUT_RATE_HZ)
        self.assertGreater(lost, CUT_S * CUT_RATE_HZ - 2 * (CUT_QUEUE + IN_FLIGHT))

    def test_the_network_loses_everything_for_some_seconds(self):
        self.cut('loss')

    def test_the_cable_is_pulled_for_some_seconds(self):
        self.cut('down')

    def test_a_short_cut_loses_nothing(self):
        # Shorter than the silence that ends a connection, and the queue has room: TCP repeats what was lost.
        self.start_bridges()
        talker, listener = self.pair()
        self.edge_a.cut('loss')
        time.sleep(0.3)  # the length of the cut
        self.edge_a.restore()
        self.assert_flows(talker, listener, PROMPT_S)
        self.finish(talker, listener, most_lost=0)

    def test_a_network_that_loses_and_delays_packets_loses_no_message(self):
        self.start_bridges()
        try:
            self.edge_a.shape(rate_mbit=100, delay_ms=5, loss_percent=1)
        except device_testbed.devices.Unsupported as reason:
            self.skipTest(str(reason))
        talker, listener = self.pair()
        talker.call('await_published', n=1000)
        self.finish(talker, listener, most_lost=0)

    # ----------------------------------------------------------------------------------------------------- the devices

    def device_gone(self, end):
        self.start_bridges()
        talker, other = self.pair(edge=self.edge_b)
        victims = self.nodes(self.edge_a, 'victim0', 'victim1')
        for victim in victims:
            victim.call('subscribe', topic=self.subject, queue=1000)
        self.await_links(talker, victims + [other], self.subject)
        self.assert_flows(talker, victims[0])
        end()
        for _ in range(20):  # about a second or two: well past what the publisher's side takes to notice
            self.assert_flows(talker, other, PROMPT_S)
        self.assertEqual(other.transports(self.subject, 'i'), ['NNROS'])
        self.edge_a.restore()
        self.start_bridge(self.edge_a)
        again = self.node(self.edge_a, 'victim0')
        again.call('subscribe', topic=self.subject, queue=1000)
        again.await_transports(self.subject, 'i', ['NNROS'])
        self.assert_flows(talker, again, PROMPT_S)
        last = talker.call('stop')['published']
        self.assert_complete(other.call('await_received', seq=last), last)
        self.assert_order(again.call('await_received', seq=last))

    def test_a_device_is_killed_and_another_one_goes_on_undisturbed(self):
        self.device_gone(self.edge_a.kill_all)

    def test_a_device_loses_power_and_another_one_goes_on_undisturbed(self):
        self.device_gone(self.edge_a.power_off)

    # ------------------------------------------------------------------------------------------------- latched messages

    def test_a_latched_message_reaches_a_late_joiner_in_every_state(self):
        topic = self.topic('latched')
        talker = self.node(self.vehicle, 'latching')
        talker.call('advertise', topic=topic, queue=10, latch=True)
        talker.call('publish', count=3, sizes=200000)
        states = (
            ('no bridge at all', lambda: None),
            ('both bridges', self.start_bridges),
            ('publisher\'s bridge killed', lambda: self.bridges['vehicle'].kill()),
            ('publisher\'s bridge back', lambda: self.start_bridge(self.vehicle)),
            ('subscriber\'s bridge killed', lambda: self.bridges['edge_a'].kill()),
            ('subscriber\'s bridge back', lambda: self.start_bridge(self.edge_a)),
            ('publisher\'s bridge stopped', lambda: self.bridges['vehicle'].pause()),
            ('publisher\'s bridge goes on', lambda: self.bridges['vehicle'].resume()),
            ('subscriber\'s bridge stopped', lambda: self.bridges['edge_a'].pause()),
            ('subscriber\'s bridge goes on', lambda: self.bridges['edge_a'].resume()),
        )
        for number, (state, reach) in enumerate(states):
            with self.subTest(state=state):
                late = self.node(self.edge_a, 'late%d' % number)
                reach()
                late.call('subscribe', topic=topic, queue=10)
                self.assert_complete(late.call('await_received', n=1, timeout=HUNG_S), 1, first=3)
                late.exit()

    def test_a_latched_message_published_in_a_cut_arrives_afterwards(self):
        self.start_bridges()
        topic = self.topic('latched')
        talker = self.node(self.vehicle, 'latching')
        listener = self.node(self.edge_a, 'listener')
        talker.call('advertise', topic=topic, queue=1, latch=True)
        listener.call('subscribe', topic=topic, queue=10)
        self.await_links(talker, [listener], topic)
        for number, how in enumerate(('loss', 'down'), 1):
            with self.subTest(how=how):
                self.edge_a.cut(how)
                talker.call('publish', count=1, sizes=1000)
                time.sleep(CUT_S)  # the length of the cut
                self.edge_a.restore()
                listener.call('await_received', seq=number, timeout=HUNG_S)
                self.assert_order(listener.call('report'))


if __name__ == '__main__':
    harness.main(BridgeFailures, plain=False, needs_library=True)
