#!/usr/bin/python3 -B
"""Judge of rosbag_interop.test."""
import os
import pathlib
import signal
import sys

import rosbag

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)
from rospy_peer import pattern  # noqa: E402

MESSAGES = 200
SIZES = [100, 20000, 0, 300000, 7, 1000000]


class Tool(harness.Peer):
    """A stock program with roscpp: no commands, but links to look at."""

    def __init__(self, name, command, preload):
        self.name = '/' + name
        self._master_uri = None
        harness.Process.__init__(self, command + ['__name:=' + name], preload)


class RosbagInterop(harness.TransportTest):

    def tool(self, name, command):
        started = Tool(self.unique(name), command, self.preload)
        self.addCleanup(started.close)
        return started

    def record(self, folder, topic):
        path = os.path.join(folder, 'recorded.bag')
        talker, = self.peers('talker')
        talker.call('advertise', topic=topic, queue=1000)
        recorder = self.tool('recorder', [harness.other_program('rosbag', 'record'), '-O', path, '--buffsize=0', topic])
        talker.call('await_subscribers', n=1)
        self.link(talker, recorder, topic)
        # The recorder tells nobody what it has, so a witness of the same traffic, and the orderly end, stand in.
        witness, = self.peers('witness')
        witness.call('subscribe', topic=topic, queue=1000)
        self.link(talker, witness, topic, of=2)
        talker.call('publish', count=MESSAGES, rate=200, sizes=','.join(map(str, SIZES)))
        self.assert_complete(witness.call('await_received', seq=MESSAGES), MESSAGES)
        harness.await_state(lambda: os.path.exists(path + '.active') and
                            os.path.getsize(path + '.active') > 0, 'bag file begun')
        harness.await_state(lambda: self.drained(recorder), 'recorder idle')
        recorder.signal(signal.SIGINT)
        self.assertEqual(recorder.wait(), 0, recorder.lines)
        talker.exit()
        witness.exit()
        return path

    @staticmethod
    def drained(process):
        """True when the process slept through an interval: no scheduler tick and no context switch of any thread."""
        def activity():
            total = 0
            for task in os.listdir('/proc/%d/task' % process.pid):
                with open('/proc/%d/task/%s/stat' % (process.pid, task)) as stat:
                    fields = stat.read().rsplit(')', 1)[1].split()
                total += int(fields[11]) + int(fields[12])
            return total
        before = activity()
        deadline = harness.time.monotonic() + 0.3
        while harness.time.monotonic() < deadline:
            harness.time.sleep(0.05)
        return activity() == before

    def test_record_then_play(self):
        topic = self.topic()
        path = self.record(self.scratch(), topic)
        with rosbag.Bag(path) as bag:
            numbers = []
            for name, message, _ in bag.read_messages():
                self.assertEqual(name, topic)
                size = SIZES[message.width % len(SIZES)]
                self.assertEqual(bytes(message.data), pattern(1, message.width, size))
                numbers.append(message.width)
            self.assertEqual(numbers, list(range(1, MESSAGES + 1)))
            connections = list(bag._get_connections())
            self.assertEqual(len(connections), 1)
            self.assertEqual(set(connections[0].header),
                             {'callerid', 'latching', 'md5sum', 'message_definition', 'topic', 'type'})
        listener, = self.peers('listener')
        listener.call('subscribe', topic=topic, queue=1000)
        player = self.tool('player', [harness.other_program('rosbag', 'play'), '--wait-for-subscribers', '--keep-alive',
                                      '--quiet', path])
        report = listener.call('await_received', seq=MESSAGES)
        self.link(player, listener, topic)
        self.assert_complete(report, MESSAGES)
        player.signal(signal.SIGINT)
        player.wait()


if __name__ == '__main__':
    harness.main(RosbagInterop)
