#!/usr/bin/python3 -B
"""Judge of statistics.test."""
import pathlib
import sys

import rosgraph

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class Statistics(harness.TransportTest):

    def test_published_statistics_count_the_messages_of_the_link(self):
        master = rosgraph.Master('/statistics_judge')
        master.setParam('/enable_statistics', True)   # roscpp reads it when a node subscribes
        self.addCleanup(master.deleteParam, '/enable_statistics')
        topic = self.topic()
        talker, listener = self.peers('talker', 'listener')
        talker.call('advertise', topic=topic, queue=500)
        listener.call('subscribe', topic=topic, queue=500)
        self.link(talker, listener, topic)
        echo = self.process(['rostopic', 'echo', '-n', '1', '--filter',
                             'm.topic == "%s" and m.delivered_msgs > 10' % topic, '/statistics'], preload='')
        # Statistics come once a second of traffic; the publisher goes on until one has arrived.
        sent = 0
        while echo.alive() and sent < 50 * harness.DEADLINE_S:
            talker.call('publish', count=50, rate=50, sizes='1000')
            sent += 50
        echo.wait()
        text = '\n'.join(echo.lines)
        self.assertIn('topic: "%s"' % topic, text)
        self.assertIn('node_pub: "%s"' % talker.name, text)
        self.assertIn('node_sub: "%s"' % listener.name, text)
        self.assertEqual(echo.output(r'^dropped_msgs: '), ['dropped_msgs: 0'], text)
        self.assertGreater(int(echo.output(r'^traffic: ')[0].split()[1]), 10 * 1000, text)


if __name__ == '__main__':
    harness.main(Statistics)
