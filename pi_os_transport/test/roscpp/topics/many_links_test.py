#!/usr/bin/python3 -B
"""Judge of many_links.test."""
import os
import pathlib
import resource
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

MESSAGES = 3
MOST_DESCRIPTORS = 1.15  # times those of TCPROS
REACHED = r'limit of \d+ open files \(ulimit -n\)'


def limited(files):
    return ['prlimit', '--nofile=%d' % files]


class ManyLinks(harness.TransportTest):

    def make_links(self, talker, listener, count):
        """@return the topics, one for each link"""
        topics = ['%s_%d' % (self.topic(), number) for number in range(count)]
        for number, topic in enumerate(topics):
            talker.send('advertise', **{'as': 'p%d' % number}, topic=topic, queue=100, latch=True)
        for _ in topics:
            talker.result()
        for number, topic in enumerate(topics):
            listener.send('subscribe', **{'as': 's%d' % number}, topic=topic, queue=100)
        for _ in topics:
            listener.result()
        return topics

    def assert_each_arrives_once(self, talker, listener, topics):
        for message in range(MESSAGES):
            for number in range(len(topics)):
                talker.send('publish', pub='p%d' % number, count=1, sizes=100)
            for _ in topics:
                talker.result()
            for number in range(len(topics)):
                listener.send('await_received', sub='s%d' % number, seq=message + 1)
            reports = [listener.result() for _ in topics]
        for report in reports:
            self.assert_complete(report, MESSAGES)

    def settled(self, talker, topics):
        """Waits until as many links as can be are in shared memory. @return how many those are"""
        talker.call('await_subscribers', pub='p%d' % (len(topics) - 1), n=1)

        def transports():
            info = talker.bus_info()
            return [entry[3] for entry in info if entry[4] in topics]
        harness.await_state(lambda: len(transports()) == len(topics), lambda: '%d of %d links are there' %
                            (len(transports()), len(topics)))
        harness.await_state(lambda: transports().count(self.SHM) == len(topics) or talker.output(REACHED),
                            lambda: '%d of %d links are %s' % (transports().count(self.SHM), len(topics), self.SHM))
        return transports().count(self.SHM)

    def count_descriptors(self, count, files):
        talker, listener = self.peers('talker', 'listener', prefix=limited(files))
        topics = self.make_links(talker, listener, count)
        self.assertEqual(self.settled(talker, topics), count)
        self.assert_each_arrives_once(talker, listener, topics)
        used = {peer.name: len(harness.open_files(peer.pid)) for peer in (talker, listener)}
        self.assert_no_warning(talker, listener)
        for name, number in sorted(used.items()):
            print('%d links, %s: %s has %d descriptors' % (count, self.SHM, name, number))
            # TCPROS: one for each link, and those that any node has.
            self.assertLessEqual(number, MOST_DESCRIPTORS * (count + 10))

    def test_450_links_below_1024_files(self):
        self.count_descriptors(450, 1024)

    @unittest.skipUnless(os.environ.get('PI_EDGE_SOAK') == '1', 'soak: PI_EDGE_SOAK=1')
    def test_1500_links_below_4096_files(self):
        hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        if hard < 4096:
            self.skipTest('this process may have %d open files, must be 4096: raise ulimit -Hn' % hard)
        self.count_descriptors(1500, 4096)

    def linked(self, count):
        talker, listener = self.peers('talker', 'listener')
        topics = self.make_links(talker, listener, count)
        self.settled(talker, topics)
        self.assert_each_arrives_once(talker, listener, topics)
        return talker, listener, topics

    def forbid_descriptors(self, peer):
        """From now on the process gets none. @return the limits before"""
        used = {int(fd) for fd in os.listdir('/proc/%d/fd' % peer.pid)}
        free = next(fd for fd in range(len(used) + 1) if fd not in used)
        before = resource.prlimit(peer.pid, resource.RLIMIT_NOFILE)
        return resource.prlimit(peer.pid, resource.RLIMIT_NOFILE, (free, before[1]))

    def assert_large_ones_arrive(self, talker, listener, topics):
        """Messages of sizes for which the pool has no segment yet, and small ones behind them."""
        for size in (60000, 600000, 3000000, 100):
            for number in range(len(topics)):
                talker.call('publish', pub='p%d' % number, count=1, sizes=size)
        for number in range(len(topics)):
            report = listener.call('await_received', sub='s%d' % number, seq=MESSAGES + 4)
            self.assert_complete(report, MESSAGES + 4)

    def assert_one_warning(self, peer, other):
        self.assertEqual(other.warnings(), [])
        if self.preload:
            self.assertEqual(len(peer.warnings()), 1, peer.warnings())
            self.assertRegex(peer.warnings()[0], REACHED)

    def test_publisher_without_descriptors(self):
        talker, listener, topics = self.linked(10)
        self.forbid_descriptors(talker)
        self.assert_large_ones_arrive(talker, listener, topics)
        self.assert_one_warning(talker, listener)

    def test_subscriber_without_descriptors(self):
        talker, listener, topics = self.linked(10)
        before = self.forbid_descriptors(listener)
        self.assert_large_ones_arrive(talker, listener, topics)
        self.assert_one_warning(listener, talker)
        resource.prlimit(listener.pid, resource.RLIMIT_NOFILE, before)  # to answer what it is asked
        # Who could not read a message has gone back to TCPROS.
        for topic in topics:
            listener.await_transports(topic, 'i', ['TCPROS'])

    def test_no_room_for_rings(self):
        talker, = self.peers('talker', prefix=['prlimit', '--fsize=4096'])
        listener, = self.peers('listener')
        topics = self.make_links(talker, listener, 10)
        self.assert_each_arrives_once(talker, listener, topics)
        self.assert_large_ones_arrive(talker, listener, topics)
        for topic in topics:
            listener.await_transports(topic, 'i', ['TCPROS'])
        self.assertEqual(listener.warnings(), [])
        if self.preload:
            self.assertEqual(len(talker.warnings()), 1, talker.warnings())
            self.assertRegex(talker.warnings()[0], r'file size limit of this process \(4096, see ulimit -f\)')

    def test_subscriber_without_address_space(self):
        talker, listener, topics = self.linked(10)
        with open('/proc/%d/statm' % listener.pid) as statm:
            used = int(statm.read().split()[0]) * resource.getpagesize()
        resource.prlimit(listener.pid, resource.RLIMIT_AS, (used + (16 << 20), resource.RLIM_INFINITY))
        self.assert_large_ones_arrive(talker, listener, topics)
        self.assertEqual(talker.warnings(), [])
        self.assertLessEqual(len(listener.warnings()), 1, listener.warnings())


if __name__ == '__main__':
    harness.main(ManyLinks)
