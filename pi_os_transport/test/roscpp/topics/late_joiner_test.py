#!/usr/bin/python3 -B
"""Judge of late_joiner.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class LateJoiner(harness.TransportTest):

    def check_latched(self, size, before, joiners=1):
        topic = self.topic()
        talker, witness = self.peers('talker', 'witness')
        talker.call('advertise', topic=topic, latch=True, queue=100)
        # Publisher::publish only queues: without a witness of the last message, roscpp may give a joiner the latched
        # message and then, out of the queue, all of them again.
        witness.call('subscribe', topic=topic, queue=100)
        self.link(talker, witness, topic)
        talker.call('publish', count=before, sizes=size)
        witness.call('await_received', seq=before)
        witness.call('unsubscribe')
        talker.call('await_subscribers', n=0)
        listeners = []
        for i in range(joiners):
            listener, = self.peers('listener%d' % i)
            listener.call('subscribe', topic=topic, queue=100, log=True)
            report = listener.call('await_received', n=1, header=True)
            self.assertEqual(report['log'], [[1, before]])
            self.assertEqual(report['header'].get('latching'), '1')
            listeners.append(listener)
        for listener in listeners:
            self.link(talker, listener, topic, of=joiners)
        # The next message is the barrier behind which no second copy of the latched one can follow.
        talker.call('publish', count=1, sizes=size)
        for listener in listeners:
            report = listener.call('await_received', seq=before + 1)
            self.assertEqual(report['log'], [[1, before], [1, before + 1]])
            self.assertEqual(report['corrupt'], 0)
        # A joiner that comes now gets what went through shared memory last.
        last, = self.peers('last')
        last.call('subscribe', topic=topic, queue=100, log=True)
        report = last.call('await_received', n=1)
        self.assertEqual((report['log'], report['corrupt']), ([[1, before + 1]], 0))

    def test_small_message(self):
        self.check_latched(size=100, before=1)

    def test_only_the_last_of_three(self):
        self.check_latched(size=1000, before=3, joiners=2)

    def test_six_megabytes(self):
        self.check_latched(size=6220800, before=3)

    def test_not_latched_gives_nothing_old(self):
        topic = self.topic()
        talker, early, late = self.peers('talker', 'early', 'late')
        talker.call('advertise', topic=topic, queue=100)
        early.call('subscribe', topic=topic, queue=100, log=True)
        self.link(talker, early, topic)
        talker.call('publish', count=3, sizes=1000)
        early.call('await_received', n=3)
        late.call('subscribe', topic=topic, queue=100, log=True)
        talker.call('await_subscribers', n=2)
        talker.call('publish', count=1, sizes=1000)
        self.assertEqual(late.call('await_received', n=1)['log'], [[1, 4]])
        self.assertEqual(early.call('await_received', n=4)['log'], [[1, 1], [1, 2], [1, 3], [1, 4]])


if __name__ == '__main__':
    harness.main(LateJoiner)
