#!/usr/bin/python3 -B
"""Judge of message_sizes.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

MIXED = [0, 1, 64 << 20, 2, 7, 8, 9, 63, 64, 65, 1000, 4095, 4096, 4097, 65535, 65536, 65537, 0, 1 << 20, (1 << 20) + 1,
         6220800, 24883200, 3, 16 << 20, 64 << 20, 1, 33554433, 100000, 0]


class MessageSizes(harness.TransportTest):

    def pair(self, type_, queue=1000):
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, type=type_, queue=queue)
        listener.call('subscribe', topic=topic, type=type_, queue=queue)
        self.link(talker, listener, topic)
        return talker, listener, topic

    def test_empty_messages(self):
        talker, listener, topic = self.pair('empty')
        talker.call('publish', count=500)
        report = listener.call('await_received', n=500)
        talker.call('unadvertise')
        report = listener.call('await_publishers', n=0)
        self.assertEqual((report['received'], report['corrupt']), (500, 0))

    def test_one_byte(self):
        talker, listener, topic = self.pair('uint8')
        talker.call('publish', count=255)
        self.assert_complete(listener.call('await_received', id=0, seq=255), 255, identity=0)

    def test_short_strings(self):
        talker, listener, topic = self.pair('string')
        talker.call('publish', count=400, sizes='4,5,6,7,8,9,10,11,12,13,15,16,17,31,32,33,60,61')
        self.assert_complete(listener.call('await_received', seq=400), 400)

    def test_nothing_to_64_megabytes_up_and_down(self):
        talker, listener, topic = self.pair('image')
        for i, size in enumerate(MIXED + MIXED[::-1]):  # one at a time: at most one large message in memory
            talker.call('publish', count=1, sizes=size)
            if size >= 1 << 20:
                listener.call('await_received', seq=i + 1)
        report = listener.call('await_received', seq=2 * len(MIXED))
        self.assert_complete(report, 2 * len(MIXED))
        self.assertEqual(report['bytes'], 2 * sum(MIXED))
        self.link(talker, listener, topic)
        self.assert_no_warning(talker, listener)

    def test_growing(self):
        talker, listener, topic = self.pair('image')
        talker.call('publish', count=100, rate=400, sizes=','.join(str(i * 30000) for i in range(101)))
        self.assert_complete(listener.call('await_received', seq=100), 100)
        self.link(talker, listener, topic)

    def test_random_sizes_to_three_subscribers(self):
        topic = self.topic()
        talker, first, second, third = self.peers('talker', 'first', 'second', 'third')
        talker.call('advertise', topic=topic, queue=1000)
        for listener in (first, second, third):
            listener.call('subscribe', topic=topic, queue=1000)
        for listener in (first, second, third):
            self.link(talker, listener, topic, of=3)
        for batch in range(20):
            talker.call('publish', count=40, sizes='rand:1:2000000')
            for listener in (first, second, third):
                listener.call('await_received', seq=40 * (batch + 1))
        for listener in (first, second, third):
            self.assert_complete(listener.call('report'), 800)
            self.link(talker, listener, topic, of=3)
        self.assert_no_warning(talker, first, second, third)


if __name__ == '__main__':
    harness.main(MessageSizes)
