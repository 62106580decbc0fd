#!/usr/bin/python3 -B
"""Judge of bridge_loss.test."""
import os
import pathlib
import signal
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

RATE_HZ = 500
BYTES = 1000
COUNT = 100000 if os.environ.get('PI_EDGE_SOAK') else 4000
BUSY_LOOPS = 8
SIZES = '1000,0,20000,100,150000'  # in one frame and in several
ROUNDS = 50 if os.environ.get('PI_EDGE_SOAK') else 3
QUEUE = 10              # of the publisher; the bridges hold beyond it what the sockets of TCPROS hold:
SOCKET_BYTES = 1 << 20
DROPPING = 6000         # more messages than all queues on the way hold
WAITING = 900           # messages that the ring of a subscriber cannot hold
ALL = 100000            # a queue that loses nothing
LAST = 20               # messages of a publisher that ends
LAST_BYTES = 100000
STANDS_STILL_S = 2.5    # longer than links wait for a bridge that hangs


class BridgeLoss(device_testbed.DeviceTest):

    def load(self):
        """Busy loops at the priority of the nodes and bridges."""
        for _ in range(BUSY_LOOPS):
            self.process(['setpriv', '--pdeathsig', 'KILL', 'sh', '-c', 'while :; do :; done'], preload='')

    def pair(self, queue, transport=None):
        self.subject = self.topic()
        talker = self.node(self.vehicle, 'talker')
        listener = self.node(self.edge_a, 'listener')
        talker.call('advertise', topic=self.subject, queue=queue)
        listener.call('subscribe', topic=self.subject, queue=ALL)
        self.await_links(talker, [listener], self.subject, transport)
        return talker, listener

    def test_busy_cores_lose_nothing(self):
        self.start_bridges()
        talker, listener = self.pair(QUEUE)
        self.load()
        talker.call('publish', count=COUNT, rate=RATE_HZ, sizes=BYTES, background=True)
        talker.send('join')
        talker.result(2 * COUNT / RATE_HZ + harness.DEADLINE_S)
        self.assert_complete(listener.call('await_received', seq=COUNT), COUNT)

    def test_drops_are_counted_at_both_ends(self):
        self.start_bridges()
        talker, listener = self.pair(QUEUE)
        listener.signal(signal.SIGSTOP)
        talker.call('publish', count=DROPPING, sizes=BYTES)
        listener.signal(signal.SIGCONT)
        report = listener.call('await_received', seq=DROPPING)
        lost = self.assert_order(report, most_lost=DROPPING)
        self.assertLess(lost, DROPPING - SOCKET_BYTES / BYTES, report)
        self.assertGreater(lost, 0, report)
        at_publisher, at_subscriber = [
            sum(link[counter] for state in device.pi_os('links') for link in state[side]
                if link['topic'] == self.subject)
            for device, side, counter in ((self.vehicle, 'publications', 'dropped'),
                                          (self.edge_a, 'subscriptions', 'missing'))]
        at_bridge = sum(link['dropped'] for link in self.status(self.edge_a)['incoming'])
        self.assertEqual((at_publisher + at_bridge, at_subscriber), (lost, lost))

    def killed_beside_a_slow_subscriber(self, device):
        self.start_bridges()
        talker, listener = self.pair(ALL)
        listener.signal(signal.SIGSTOP)
        talker.call('publish', count=WAITING, sizes=BYTES)
        harness.await_state(lambda: [link['paused'] for link in self.status(self.edge_a)['incoming']] == [1],
                            'messages that wait in the bridge of the subscriber')
        self.bridges[device.name].kill()
        listener.signal(signal.SIGCONT)
        self.assert_complete(listener.call('await_received', seq=WAITING), WAITING)

    def test_the_publishers_bridge_is_killed_beside_a_slow_subscriber(self):
        self.killed_beside_a_slow_subscriber(self.vehicle)

    def test_the_subscribers_bridge_is_killed_beside_a_slow_subscriber(self):
        self.killed_beside_a_slow_subscriber(self.edge_a)

    def test_a_publisher_that_has_ended_loses_nothing_to_a_bridge_that_stands_still(self):
        self.start_bridges()
        talker, listener = self.pair(ALL)
        self.bridges[self.edge_a.name].pause()
        talker.say('publish count=%d sizes=%d\nexit' % (LAST, LAST_BYTES))
        talker.wait()
        time.sleep(STANDS_STILL_S)
        self.bridges[self.edge_a.name].resume()
        self.assert_complete(listener.call('await_received', seq=LAST), LAST)

    def hand_over(self, end, busy=False):
        """Links are taken over by bridges and handed back, again and again, while messages flow."""
        talker, listener = self.pair(ALL, 'TCPROS')  # the socket of a new connection holds little
        if busy:
            self.load()
        talker.call('publish', count=0, rate=RATE_HZ, sizes=SIZES, background=True)
        for _ in range(ROUNDS):
            for device in (self.vehicle, self.edge_a):
                self.start_bridges(*[one for one in (self.vehicle, self.edge_a)
                                     if one.name not in self.bridges or not self.bridges[one.name].alive()])
                self.await_links(talker, [listener], self.subject)
                self.assert_flows(talker, listener)
                end(self.bridges[device.name])
                self.await_links(talker, [listener], self.subject, 'TCPROS')
                self.assert_flows(talker, listener)
        last = talker.call('stop')['published']
        self.assert_complete(listener.call('await_received', seq=last), last)

    def test_bridges_that_start_and_end_lose_nothing(self):
        self.hand_over(lambda bridge: bridge.terminate())

    def test_bridges_that_start_and_are_killed_lose_nothing(self):
        self.hand_over(lambda bridge: bridge.kill())

    def test_bridges_that_are_killed_on_busy_cores_lose_nothing(self):
        self.hand_over(lambda bridge: bridge.kill(), busy=True)


if __name__ == '__main__':
    harness.main(BridgeLoss, plain=False, needs_library=True)
