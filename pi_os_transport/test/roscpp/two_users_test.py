#!/usr/bin/python3 -B
"""Judge of two_users.test."""
import os
import pathlib
import pwd
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)


@harness.needs_root
class TwoUsers(harness.TransportTest):

    def setUp(self):
        super().setUp()
        for path in [harness.program(harness.PACKAGE + '_test_peer')] + ([self.preload] if self.preload else []):
            if not harness.readable_by_others(path):
                self.skipTest('%s is not readable by user nobody: build in a folder that others may enter' % path)

    def nobody(self, name):
        user = pwd.getpwnam('nobody')
        logs = self.scratch()
        os.chown(logs, user.pw_uid, user.pw_gid)
        return self.peer(name, env={'ROS_LOG_DIR': logs, 'HOME': logs},
                         prefix=['setpriv', '--reuid=%d' % user.pw_uid, '--regid=%d' % user.pw_gid, '--clear-groups'])

    def test_subscriber_of_another_user(self):
        topic = self.topic()
        talker, mine = self.peers('talker', 'mine')
        other = self.nobody('other')
        talker.call('advertise', topic=topic, queue=1000, latch=True)
        mine.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=1, sizes=3000000)
        mine.call('await_received', seq=1)
        other.call('subscribe', topic=topic, queue=1000)
        other.call('await_received', seq=1)
        mine.await_transports(topic, 'i', [self.SHM])
        talker.call('publish', count=100, rate=200, sizes='100,20000,1000000')
        for listener in (mine, other):
            self.assert_complete(listener.call('await_received', seq=101), 101)
        self.assertEqual(other.transports(topic, 'i'), ['TCPROS'])
        self.assertEqual(talker.transports(topic, 'o'), sorted([self.SHM, 'TCPROS']))

    def test_publisher_of_another_user(self):
        topic = self.topic()
        talker = self.nobody('talker')
        listener, = self.peers('listener')
        same = self.nobody('same')
        talker.call('advertise', topic=topic, queue=1000)
        for peer in (listener, same):
            peer.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=2)
        same.await_transports(topic, 'i', [self.SHM])
        talker.call('publish', count=100, rate=200, sizes='100,20000,1000000')
        for peer in (listener, same):
            self.assert_complete(peer.call('await_received', seq=100), 100)
        self.assertEqual(listener.transports(topic, 'i'), ['TCPROS'])


if __name__ == '__main__':
    harness.main(TwoUsers)
