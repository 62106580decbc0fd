#!/usr/bin/python3 -B
"""Judge of callbacks_and_headers.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

HEADER = {'callerid', 'latching', 'md5sum', 'message_definition', 'topic', 'type'}
GREETING_ID = 1001  # see GREETING_ID_OFFSET in test_peer.cpp


class CallbacksAndHeaders(harness.TransportTest):

    def test_connect_and_disconnect_callbacks(self):
        topic = self.topic()
        talker, first, second = self.peers('talker', 'first', 'second')
        talker.call('advertise', topic=topic, queue=100)
        for listener in (first, second):
            listener.call('subscribe', topic=topic, queue=100)
        self.link(talker, first, topic, of=2)
        self.link(talker, second, topic, of=2)
        harness.await_state(lambda: sorted(talker.call('publisher')['connected']) == [first.name, second.name],
                            'two connect callbacks')
        first.call('await_publishers', n=1)
        first.call('unsubscribe')
        talker.call('await_subscribers', n=1)
        harness.await_state(lambda: talker.call('publisher')['disconnected'] == [first.name], 'disconnect callback')
        second.exit()
        talker.call('await_subscribers', n=0)
        harness.await_state(lambda: talker.call('publisher')['disconnected'] == [first.name, second.name],
                            'second disconnect callback')
        self.assertEqual(sorted(talker.call('publisher')['connected']), [first.name, second.name])

    def check_greeting(self, size):
        topic = self.topic()
        talker, first, second = self.peers('talker', 'first', 'second')
        talker.call('advertise', topic=topic, queue=100, greet=size)
        for number, listener in enumerate((first, second)):
            listener.call('subscribe', topic=topic, queue=100, log=True)
            report = listener.call('await_received', n=1)
            # The greeting is for this subscriber only, so the number is its own.
            self.assertEqual((report['log'], report['corrupt']), ([[GREETING_ID, number + 1]], 0))
        self.link(talker, first, topic, of=2)
        talker.call('publish', count=5, sizes=size)
        for number, listener in enumerate((first, second)):
            report = listener.call('await_received', seq=5)
            self.assertEqual(report['log'], [[GREETING_ID, number + 1]] + [[1, seq] for seq in range(1, 6)])
            self.assertEqual(report['corrupt'], 0)

    def test_publishing_from_the_connect_callback(self):
        self.check_greeting(100)

    def test_publishing_six_megabytes_from_the_connect_callback(self):
        self.check_greeting(6220800)

    def test_connection_header_of_messages(self):
        topic = self.topic()
        talker, early = self.peers('talker', 'early')
        talker.call('advertise', topic=topic, queue=100)
        early.call('subscribe', topic=topic, queue=100)
        self.link(talker, early, topic)
        talker.call('publish', count=5, sizes=100000)
        report = early.call('await_received', n=5, header=True)
        header = report['header']
        self.assertEqual(set(header), HEADER)
        self.assertEqual((header['callerid'], header['latching'], header['topic'], header['type']),
                         (talker.name, '0', topic, 'sensor_msgs/Image'))
        self.assertEqual(header['md5sum'], '060021388200f6f0f447d0fcd9c64743')
        self.assertEqual(report['publisher_name'], talker.name)
        # Publication counts header.seq from 0 for the topic, not for the link.
        self.assertEqual(report['flows']['1']['last_header_seq'], 4)
        late, = self.peers('late')
        late.call('subscribe', topic=topic, queue=100)
        self.link(talker, late, topic, of=2)
        talker.call('publish', count=3, sizes=100000)
        for listener in (early, late):
            report = listener.call('await_received', seq=8)
            self.assertEqual(report['flows']['1']['last_header_seq'], 7)

    def test_names_of_several_publishers(self):
        topic = self.topic()
        listener, = self.peers('listener')
        talkers = self.peers('talker0', 'talker1', 'talker2')
        listener.call('subscribe', topic=topic, queue=100)
        for identity, talker in enumerate(talkers):
            talker.call('advertise', topic=topic, queue=100, id=identity)
        for talker in talkers:
            self.link(talker, listener, topic, publishers=3)
        listener.call('await_publishers', n=3)
        for talker in talkers:
            talker.call('publish', count=1, sizes=5000)
        report = listener.call('await_received', n=3)
        self.assertEqual(sorted(report['publisher_names']), sorted(talker.name for talker in talkers))
        self.assertEqual(sorted(report['flows']), ['0', '1', '2'])
        talkers[0].exit()
        listener.call('await_publishers', n=2)


if __name__ == '__main__':
    harness.main(CallbacksAndHeaders)
