#!/usr/bin/python3 -B
"""Judge of rospy_interop.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class RospyInterop(harness.TransportTest):

    def check(self, talker, listener, latched_size):
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=1000, latch=True)
        # roscpp publishes from a queue; who joins before it is empty may get the latched message twice.
        witness = self.peer('witness')
        witness.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=2, sizes=latched_size)
        witness.call('await_received', seq=2)
        witness.exit()
        talker.call('await_subscribers', n=0)
        listener.call('subscribe', topic=topic, queue=1000)
        self.assert_complete(listener.call('await_received', n=1), 1, first=2)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=150, rate=300, sizes='0,100,20000,1000000,7')
        self.assert_complete(listener.call('await_received', seq=152), 151, first=2)
        self.assertEqual(talker.transports(topic, 'o'), ['TCPROS'])
        self.assertEqual(listener.transports(topic, 'i'), ['TCPROS'])
        listener.call('unsubscribe')
        talker.call('await_subscribers', n=0)

    def test_rospy_publishes(self):
        self.check(self.peer('talker', preload='', kind='rospy'), self.peer('listener'), 1000)

    def test_preloaded_rospy_publishes_six_megabytes(self):
        self.check(self.peer('talker', kind='rospy'), self.peer('listener'), 6220800)

    def test_rospy_subscribes(self):
        self.check(self.peer('talker'), self.peer('listener', preload='', kind='rospy'), 1000)

    def test_preloaded_rospy_subscribes_six_megabytes(self):
        self.check(self.peer('talker'), self.peer('listener', kind='rospy'), 6220800)


if __name__ == '__main__':
    harness.main(RospyInterop)
