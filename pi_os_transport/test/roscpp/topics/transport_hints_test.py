#!/usr/bin/python3 -B
"""Judge of transport_hints.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class TransportHints(harness.TransportTest):

    def check(self, hints, transport, messages=50):
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100, hints=hints)
        if transport:
            self.link(talker, listener, topic, transport)
        else:
            talker.call('await_subscribers', n=1)
        talker.call('publish', count=messages, rate=200, sizes='100,1000,1')
        self.assert_complete(listener.call('await_received', seq=messages), messages)

    def test_udp_stays_udp(self):
        self.check('udp', 'UDPROS')

    def test_unreliable_before_reliable_is_udp(self):
        self.check('unreliable,reliable', 'UDPROS')

    def test_tcp_no_delay(self):
        self.check('nodelay', self.SHM)

    def test_no_hint(self):
        self.check('', self.SHM)

    def test_reliable(self):
        self.check('reliable', None)

    def test_reliable_before_unreliable_is_not_udp(self):
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100, hints='reliable,unreliable')
        talker.call('await_subscribers', n=1)
        self.assertNotEqual(listener.transports(topic, 'i'), ['UDPROS'])
        talker.call('publish', count=20, sizes='100000')
        self.assert_complete(listener.call('await_received', seq=20), 20)


if __name__ == '__main__':
    harness.main(TransportHints)
