#!/usr/bin/python3 -B
"""Judge of mixed_subscribers.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class MixedSubscribers(harness.TransportTest):

    def test_every_kind_of_subscriber_gets_every_message(self):
        topic = self.topic()
        talker, preloaded = self.peers('talker', 'preloaded')
        plain = self.peer('plain', preload='')
        rospy = self.peer('rospy', preload='', kind='rospy')
        rospy_preloaded = self.peer('rospy_preloaded', kind='rospy')
        talker.call('advertise', topic=topic, queue=1000)
        listeners = (preloaded, plain, rospy, rospy_preloaded)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=1000)
        for listener in listeners:
            listener.await_transports(topic, 'i', [self.SHM if listener is preloaded else 'TCPROS'])
        talker.await_transports(topic, 'o', [self.SHM] + ['TCPROS'] * 3)
        talker.call('publish', count=300, rate=300, sizes='100,20000,300000,0,1000000,7')
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=300), 300)

    def test_plain_and_preloaded_publishers_at_one_subscriber(self):
        topic = self.topic()
        listener, preloaded = self.peers('listener', 'preloaded')
        plain = self.peer('plain', preload='')
        listener.call('subscribe', topic=topic, queue=1000)
        preloaded.call('advertise', topic=topic, queue=1000, id=1)
        plain.call('advertise', topic=topic, queue=1000, id=2)
        listener.await_transports(topic, 'i', [self.SHM, 'TCPROS'])
        for publisher in (preloaded, plain):
            publisher.call('await_subscribers', n=1)
            publisher.send('publish', count=200, rate=300, sizes='100,20000,300000')
        for publisher in (preloaded, plain):
            publisher.result()
        for identity in (1, 2):
            report = listener.call('await_received', id=identity, seq=200)
            self.assert_complete(report, 200, identity=identity)


if __name__ == '__main__':
    harness.main(MixedSubscribers)
