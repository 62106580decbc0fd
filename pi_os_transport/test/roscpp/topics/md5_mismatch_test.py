#!/usr/bin/python3 -B
"""Judge of md5_mismatch.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class Md5Mismatch(harness.TransportTest):

    def test_wrong_type_is_refused_and_nobody_else_notices(self):
        topic = self.topic()
        talker, right, wrong = self.peers('talker', 'right', 'wrong')
        talker.call('advertise', topic=topic, queue=100)
        right.call('subscribe', topic=topic, queue=100)
        self.link(talker, right, topic)
        wrong.call('subscribe', topic=topic, type='string', queue=100)
        # roscpp names the refusal on both sides; the line is the event that the attempt has been made.
        harness.await_state(lambda: talker.output(r'Client .*wants topic'), 'refusal in the output of the publisher')
        talker.call('publish', count=50, sizes='10,100000')
        self.assert_complete(right.call('await_received', seq=50), 50)
        self.assertEqual(talker.call('publisher')['subscribers'], 1)
        self.assertEqual(talker.transports(topic, 'o'), [self.SHM])
        self.assertEqual(wrong.call('report')['received'], 0)
        # The refused node is not spoilt: the right type of the same topic works in it.
        wrong.call('unsubscribe')
        wrong.call('subscribe', topic=topic, queue=100)
        self.link(talker, wrong, topic, of=2)
        talker.call('publish', count=10, sizes=5000)
        self.assert_complete(wrong.call('await_received', seq=60), 10, first=51)
        self.assert_complete(right.call('await_received', seq=60), 60)

    def test_publisher_of_the_wrong_type_beside_one_of_the_right_type(self):
        topic = self.topic()
        listener, right, wrong = self.peers('listener', 'right', 'wrong')
        listener.call('subscribe', topic=topic, queue=100)
        right.call('advertise', topic=topic, queue=100)
        self.link(right, listener, topic)
        wrong.call('advertise', topic=topic, type='string', latch=True, queue=100)
        wrong.call('publish', count=3, sizes=50)
        harness.await_state(lambda: wrong.output(r'Client .*wants topic'), 'refusal in the output of the publisher')
        right.call('publish', count=20, sizes=20000)
        report = listener.call('await_received', seq=20)
        self.assert_complete(report, 20)
        self.assertEqual(report['received'], 20)


if __name__ == '__main__':
    harness.main(Md5Mismatch)
