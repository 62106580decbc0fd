#!/usr/bin/python3 -B
"""Judge of slow_subscriber.test."""
import pathlib
import signal
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

MEGABYTE = 1000000


class SlowSubscriber(harness.TransportTest):

    def test_queue_of_one_keeps_the_newest(self):
        topic = self.topic()
        talker, fast = self.peers('talker', 'fast')
        slow, = self.peers('slow', threads=2)
        talker.call('advertise', topic=topic, queue=500)
        fast.call('subscribe', topic=topic, queue=500)
        slow.call('subscribe', topic=topic, queue=1, hold=True, log=True)
        # Shows when all messages have reached the process of the slow subscription.
        slow.call('subscribe', **{'as': 'witness'}, topic=topic, queue=500, type='any')
        self.link(talker, fast, topic, of=2)
        self.link(talker, slow, topic, of=2)
        talker.call('publish', count=1, sizes=50000)
        slow.call('await_received', n=1)  # sits in the callback of message 1 from here
        for batch in range(10):
            talker.call('publish', count=20, sizes='50000,100,300000')
            fast.call('await_received', seq=21 + 20 * batch)
        self.assert_complete(fast.call('report'), 201)
        slow.call('await_received', sub='witness', n=201)
        slow.call('release')
        slow.call('await_received', seq=201)
        talker.call('publish', count=1)
        report = slow.call('await_received', seq=202)
        self.assertEqual(report['log'], [[1, 1], [1, 201], [1, 202]])
        self.assertEqual(report['corrupt'], 0)

    def test_publisher_queue_of_one(self):
        topic = self.topic()
        talker, fast, slow = self.peers('talker', 'fast', 'slow')
        talker.call('advertise', topic=topic, queue=1)
        fast.call('subscribe', topic=topic, queue=100)
        slow.call('subscribe', topic=topic, queue=1, hold=True, log=True)
        self.link(talker, fast, topic, of=2)
        self.link(talker, slow, topic, of=2)
        for message in range(60):  # one at a time: with a queue of one, a publisher that runs ahead may drop
            talker.call('publish', count=1, sizes=200000)
            fast.call('await_received', seq=message + 1)
        self.assert_complete(fast.call('report'), 60)
        slow.call('release')
        log = [seq for _, seq in slow.call('await_received', seq=60)['log']]
        self.assertEqual(log[-1], 60)
        self.assertEqual(log, sorted(set(log)))

    def test_burst_at_a_stopped_process_keeps_the_order(self):
        # More messages than shared memory keeps for one subscriber, within the queue limits: what had to go another
        # way must not overtake what waits in shared memory, nor the other way round.
        topic = self.topic()
        talker, stopped = self.peers('talker', 'stopped')
        talker.call('advertise', topic=topic, type='string', queue=10000)
        stopped.call('subscribe', topic=topic, type='string', queue=10000)
        self.link(talker, stopped, topic)
        first = 1
        for burst in (300, 3000, 1000):
            stopped.signal(signal.SIGSTOP)
            talker.call('publish', count=burst, sizes='4,17,60')
            stopped.signal(signal.SIGCONT)
            first += burst
            self.assert_complete(stopped.call('await_received', seq=first - 1), first - 1)
        # Traffic that goes on while the backlog is worked off changes from one way to the other again and again.
        for _ in range(5):
            stopped.signal(signal.SIGSTOP)
            talker.call('publish', count=500, sizes='4,17,60')
            talker.call('publish', count=1500, rate=5000, sizes='4,17,60', background=True)
            stopped.signal(signal.SIGCONT)
            talker.call('join')
            first += 2000
            self.assert_complete(stopped.call('await_received', seq=first - 1), first - 1)
        self.link(talker, stopped, topic)

    def check_stopped(self, queue):
        """A process under SIGSTOP reads nothing at all; returns what it got after SIGCONT."""
        topic = self.topic()
        talker, fast, stopped = self.peers('talker', 'fast', 'stopped')
        talker.call('advertise', topic=topic, queue=queue)
        fast.call('subscribe', topic=topic, queue=200)
        stopped.call('subscribe', topic=topic, queue=200, log=True)
        self.link(talker, fast, topic, of=2)
        self.link(talker, stopped, topic, of=2)
        talker.call('publish', count=1, sizes=MEGABYTE)
        stopped.call('await_received', n=1)
        before = harness.Footprint(talker.pid)
        stopped.signal(signal.SIGSTOP)
        most_kb = 0
        for batch in range(40):
            talker.call('publish', count=min(queue, 5), sizes=MEGABYTE)
            fast.call('await_received', seq=1 + min(queue, 5) * (batch + 1))
            now = harness.Footprint(talker.pid)
            most_kb = max(most_kb, now.anonymous + now.memfd)
        last = 1 + min(queue, 5) * 40
        self.assert_complete(fast.call('report'), last)
        # The queue, what is on the way to the other subscriber, and the allocator's slack; without the limit of the
        # queue it would be all the messages sent.
        growth_mb = (most_kb - before.anonymous - before.memfd) / 1000.0
        self.assertLess(growth_mb, 2.5 * queue + 30, 'publisher grew by %.0f MB' % growth_mb)
        stopped.signal(signal.SIGCONT)
        report = stopped.call('await_received', seq=last)
        talker.call('publish', count=1, sizes=100)
        report = stopped.call('await_received', seq=last + 1)
        self.assertEqual(report['corrupt'], 0)
        log = [seq for _, seq in report['log']]
        self.assertEqual(log, sorted(set(log)), 'order')
        # What roscpp had accepted for sending stays; of the rest the newest remain, without a gap between them.
        newest = log[-min(queue, 5) - 1:]
        self.assertEqual(newest, list(range(last + 1 - min(queue, 5), last + 2)))
        self.link(talker, stopped, topic, of=2)
        self.assert_no_warning(talker, fast, stopped)

    def test_stopped_process_queue_of_ten(self):
        self.check_stopped(10)

    def test_stopped_process_queue_of_one(self):
        self.check_stopped(1)


if __name__ == '__main__':
    harness.main(SlowSubscriber)
