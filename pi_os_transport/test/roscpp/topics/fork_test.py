#!/usr/bin/python3 -B
"""Judge of fork.test."""
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class Fork(harness.TransportTest):

    def pair(self):
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, queue=500)
        listener.call('subscribe', topic=topic, queue=500)
        self.link(talker, listener, topic)
        talker.call('publish', count=20, sizes='100,100000')
        listener.call('await_received', seq=20)
        return talker, listener, topic

    def test_children_during_traffic(self):
        talker, listener, topic = self.pair()
        for peer in (talker, listener):
            self.idle_child(peer)
            self.assertEqual(peer.call('fork', kind='exec')['status'], 7)
            self.assertEqual(peer.call('fork', kind='exit')['status'], 3)
            talker.call('publish', count=20, sizes='100,100000')
        self.assert_complete(listener.call('await_received', seq=60), 60)
        self.link(talker, listener, topic)

    def test_end_of_a_child_does_not_end_a_link(self):
        talker, listener, topic = self.pair()
        for peer in (talker, listener):
            harness.end_process(self.idle_child(peer))
        talker.call('publish', count=20, sizes='100,100000')
        self.assert_complete(listener.call('await_received', seq=40), 40)
        self.link(talker, listener, topic)

    def test_death_of_a_forked_subscriber_is_seen(self):
        if not self.preload:
            self.skipTest('TCPROS does not see it: the child holds a copy of the socket')
        talker, listener, topic = self.pair()
        child = self.idle_child(listener)
        listener.kill()
        os.kill(child, 0)
        talker.call('await_subscribers', n=0)

    def test_death_of_a_forked_publisher_is_seen(self):
        if not self.preload:
            self.skipTest('TCPROS does not see it: the child holds a copy of the socket')
        talker, listener, topic = self.pair()
        child = self.idle_child(talker)
        talker.kill()
        os.kill(child, 0)
        listener.await_transports(topic, 'i', ['TCPROS'])   # the link that roscpp now tries to restore

    def test_orderly_end_of_a_forked_publisher_is_seen(self):
        talker, listener, topic = self.pair()
        child = self.idle_child(talker)
        talker.exit()
        os.kill(child, 0)
        listener.call('await_publishers', n=0)

    def test_child_keeps_no_pool(self):
        talker, listener, topic = self.pair()
        child = self.idle_child(talker)

        def pools():
            return [line for line in harness.mappings(child) if '/memfd:' in line and 'pi_os' in line]
        # The parent may answer before the child has run at all.
        harness.await_state(lambda: not pools(), lambda: 'a child without %s' % pools())


if __name__ == '__main__':
    harness.main(Fork)
