#!/usr/bin/python3 -B
"""Judge of memory_limits.test."""
import pathlib
import re
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

MEGABYTE = 1000000
MESSAGES = 60


class MemoryLimits(harness.TransportTest):

    def run_into_limit(self, talker, listener, size=MEGABYTE, messages=MESSAGES):
        """The listener keeps all messages in its queue; the publisher never runs far ahead of what has arrived."""
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=messages + 30)
        listener.call('subscribe', topic=topic, queue=messages + 30, hold=True)
        listener.call('subscribe', **{'as': 'witness'}, topic=topic, queue=messages + 30, type='any')
        talker.call('await_subscribers', n=1)
        if self.preload:
            # Linked through shared memory or already refused: both are settled before the flood.
            harness.await_state(lambda: talker.transports(topic, 'o') == [self.SHM] or
                                talker.warnings() or listener.warnings(), 'link settled')
        talker.call('publish', count=1, sizes=100)
        listener.call('await_received', n=1)
        for message in range(messages):
            talker.call('publish', count=1, sizes=size)
            listener.call('await_received', sub='witness', n=message + 2)
        listener.call('release')
        self.assert_complete(listener.call('await_received', seq=messages + 1), messages + 1)
        talker.call('publish', count=20, sizes='0,%d,500' % size)
        self.assert_complete(listener.call('await_received', seq=messages + 21), messages + 21)
        self.assertTrue(talker.alive() and listener.alive())
        return topic

    def assert_one_warning(self, *peers):
        if self.preload:
            said = [line for peer in peers for line in peer.warnings()]
            self.assertEqual(len(said), 1, said)

    def test_pool_limit_below_what_the_subscriber_keeps(self):
        talker = self.peer('talker', env={'PI_OS_POOL_LIMIT_MB': '16'})
        listener, = self.peers('listener', threads=2)
        topic = self.run_into_limit(talker, listener)
        # Each message fits, so a subscriber that keeps many is no reason to leave shared memory.
        self.link(talker, listener, topic)
        self.assertLessEqual(len(talker.warnings() + listener.warnings()), 1)

    def test_pool_limit_below_one_message(self):
        talker = self.peer('talker', env={'PI_OS_POOL_LIMIT_MB': '1'})
        listener, = self.peers('listener', threads=2)
        self.run_into_limit(talker, listener, size=6220800, messages=20)
        self.assert_one_warning(talker, listener)

    def test_pool_limit_with_two_subscribers(self):
        topic = self.topic()
        talker = self.peer('talker', env={'PI_OS_POOL_LIMIT_MB': '16'})
        fast, slow = self.peers('fast', 'slow')
        talker.call('advertise', topic=topic, queue=200)
        fast.call('subscribe', topic=topic, queue=200)
        slow.call('subscribe', topic=topic, queue=200, hold=True)
        self.link(talker, fast, topic, of=2)
        self.link(talker, slow, topic, of=2)
        for message in range(MESSAGES):
            talker.call('publish', count=1, sizes=MEGABYTE)
            fast.call('await_received', seq=message + 1)
        slow.call('release')
        for listener in (fast, slow):
            self.assert_complete(listener.call('await_received', seq=MESSAGES), MESSAGES)

    def test_file_size_limit(self):
        talker, = self.peers('talker', prefix=['prlimit', '--fsize=500000'])
        listener, = self.peers('listener', threads=2)
        self.run_into_limit(talker, listener)
        self.assert_one_warning(talker, listener)

    def test_address_space_of_the_publisher(self):
        talker, = self.peers('talker', prefix=['prlimit', '--as=%d' % self.address_space()])
        listener, = self.peers('listener', threads=2)
        self.run_into_limit(talker, listener, size=6220800, messages=40)
        self.assert_one_warning(talker, listener)

    def test_address_space_of_the_subscriber(self):
        # Few messages: the subscriber needs memory of its own for what it keeps and deserializes.
        talker, = self.peers('talker')
        listener, = self.peers('listener', prefix=['prlimit', '--as=%d' % self.address_space()], threads=2)
        self.run_into_limit(talker, listener, size=3 * MEGABYTE, messages=5)
        self.assertLessEqual(len(talker.warnings() + listener.warnings()), 1)

    def address_space(self):
        """What a plain node of the same work takes, and 64 MB for messages on top [bytes]."""
        talker, listener = self.peer('talker_plain', preload=''), self.peer('listener_plain', preload='')
        topic = self.topic('reference')
        talker.call('advertise', topic=topic, queue=10)
        listener.call('subscribe', topic=topic, queue=10)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=5, sizes=6220800)
        listener.call('await_received', seq=5)
        peak = 0
        for peer in (talker, listener):
            with open('/proc/%d/status' % peer.pid) as status:
                peak = max(peak, int(re.search(r'VmPeak:\s+(\d+)', status.read()).group(1)) * 1024)
            peer.close()
        return peak + (64 << 20)

    @harness.needs_root
    def test_tiny_dev_shm(self):
        prefix = ['unshare', '-m', 'sh', '-c', 'mount -t tmpfs -o size=4k none /dev/shm && exec "$0" "$@"']
        possible = subprocess.run(prefix + ['true'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if possible.returncode != 0:
            self.skipTest('no mount namespace of its own here: %s' % possible.stdout.decode().strip())
        talker, listener = self.peers('talker', 'listener', prefix=prefix, threads=2)
        with open('/proc/%d/mounts' % talker.pid) as mounts:
            self.assertTrue([line for line in mounts if ' /dev/shm ' in line and 'size=4k' in line])
        topic = self.run_into_limit(talker, listener)
        # Pools are anonymous files, which do not live in /dev/shm.
        self.link(talker, listener, topic)
        self.assert_no_warning(talker, listener)


if __name__ == '__main__':
    harness.main(MemoryLimits)
