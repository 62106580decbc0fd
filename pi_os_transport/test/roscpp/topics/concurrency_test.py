#!/usr/bin/python3 -B
"""Judge of concurrency.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class Concurrency(harness.TransportTest):

    def test_two_threads_on_one_publisher(self):
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, queue=5000)
        listener.call('subscribe', topic=topic, queue=5000)
        self.link(talker, listener, topic)
        for identity in (1, 2, 3):
            talker.call('publish', id=identity, count=400, rate=1000, sizes='100,30000,5,200000', background=True)
        talker.call('join')
        for identity in (1, 2, 3):
            report = listener.call('await_received', id=identity, seq=400)
            self.assert_complete(report, 400, identity=identity)

    def test_two_publishers_of_one_process_and_one_of_another(self):
        topic = self.topic()
        talker, other, listener = self.peers('talker', 'other', 'listener')
        listener.call('subscribe', topic=topic, queue=5000)
        talker.call('advertise', **{'as': 'a'}, topic=topic, queue=5000, id=1)
        talker.call('advertise', **{'as': 'b'}, topic=topic, queue=5000, id=2)
        other.call('advertise', topic=topic, queue=5000, id=3)
        listener.await_transports(topic, 'i', [self.SHM] * 2)
        for pub in ('a', 'b'):
            talker.call('await_subscribers', pub=pub, n=1)
        other.call('await_subscribers', n=1)
        talker.call('publish', pub='a', count=300, rate=500, sizes='100,30000,200000', background=True)
        talker.call('publish', pub='b', count=300, rate=500, sizes='100,30000,200000', background=True)
        other.call('publish', count=300, rate=500, sizes='100,30000,200000', background=True)
        for identity in (1, 2, 3):
            report = listener.call('await_received', id=identity, seq=300)
            self.assert_complete(report, 300, identity=identity)

    def test_concurrent_callbacks(self):
        topic = self.topic()
        talker, = self.peers('talker')
        listener, = self.peers('listener', threads=4)
        talker.call('advertise', topic=topic, queue=2000)
        listener.call('subscribe', topic=topic, queue=2000, concurrent=True, hold=True)
        self.link(talker, listener, topic)
        talker.call('publish', count=500, rate=1000, sizes='100,30000,200000')
        # Held callbacks show that four run at once; without order, only completeness is judged.
        listener.call('await_received', n=4)
        listener.call('release')
        report = listener.call('await_received', n=500)
        self.assertEqual((report['corrupt'], report['flows']['1']['lost'], report['most_concurrent']), (0, 0, 4),
                         report)

    def test_within_and_across_processes_at_once(self):
        topic = self.topic()
        talker, = self.peers('talker', threads=2)
        first, second = self.peers('first', 'second')
        talker.call('advertise', topic=topic, queue=1000)
        for listener in (talker, first, second):
            listener.call('subscribe', topic=topic, queue=1000)
        talker.await_transports(topic, 'o', ['INTRAPROCESS', self.SHM, self.SHM])
        talker.call('publish', count=200, rate=500, sizes='100,30000,200000')
        for listener in (talker, first, second):
            self.assert_complete(listener.call('await_received', seq=200), 200)
        talker.call('publish', count=200, rate=500, sizes='100,30000,200000', by_reference=True)
        for listener in (talker, first, second):
            self.assert_complete(listener.call('await_received', seq=400), 400)

    def test_callback_that_ends_its_own_subscription(self):
        topic = self.topic()
        talker, witness, listener = self.peers('talker', 'witness', 'listener')
        talker.call('advertise', topic=topic, queue=1000)
        witness.call('subscribe', topic=topic, queue=1000)
        self.link(talker, witness, topic)
        for round_ in range(10):
            listener.call('subscribe', topic=topic, queue=1000, unsubscribe_after=3)
            self.link(talker, listener, topic, of=2)
            talker.call('publish', count=20, sizes='100,100000')
            talker.call('await_subscribers', n=1)
            self.assertEqual(listener.call('report')['received'], 3)
        self.assert_complete(witness.call('await_received', seq=200), 200)

    def test_orderly_end_of_subscribers_during_traffic(self):
        topic = self.topic()
        talker, witness = self.peers('talker', 'witness')
        talker.call('advertise', topic=topic, queue=2000)
        witness.call('subscribe', topic=topic, queue=2000)
        self.link(talker, witness, topic)
        talker.call('publish', count=0, rate=500, sizes='100,100000,1000', background=True)
        for round_ in range(8):
            listener, = self.peers('listener')
            listener.call('subscribe', topic=topic, queue=2000)
            listener.await_transports(topic, 'i', [self.SHM])
            listener.call('await_received', n=10)
            self.assertEqual(listener.exit(), 0)
        last = talker.call('stop')['published']
        self.assert_complete(witness.call('await_received', seq=last), last)
        self.assertEqual(talker.exit(), 0)

    def test_orderly_end_of_a_publisher_during_traffic(self):
        topic = self.topic()
        listener, = self.peers('listener')
        listener.call('subscribe', topic=topic, queue=2000)
        for round_ in range(5):
            talker, = self.peers('talker')
            talker.call('advertise', topic=topic, queue=2000, id=round_ + 1)
            self.link(talker, listener, topic)
            talker.call('publish', count=0, rate=500, sizes='100,100000,1000', background=True)
            listener.call('await_received', id=round_ + 1, seq=20)
            self.assertEqual(talker.exit(), 0)
            report = listener.call('await_publishers', n=0)
            flow = report['flows'][str(round_ + 1)]
            self.assertEqual((report['corrupt'], flow['lost'], flow['reordered']), (0, 0, 0), report)


if __name__ == '__main__':
    harness.main(Concurrency)
