#!/usr/bin/python3 -B
"""Judge of actions.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

GOAL = 20          # feedback messages of one goal
LONG_GOAL = 100000  # one that does not end by itself
PARTS_OUT = ('status', 'feedback', 'result')
PARTS_IN = ('goal', 'cancel')


class Actions(harness.TransportTest):

    def pair(self):
        self.action = self.topic('action')
        server, client = self.peers('server', 'client', kind='service_peer', threads=2)
        server.call('serve_action', action=self.action)
        return server, client

    def test_goals_reach_their_result(self):
        server, client = self.pair()
        for _ in range(3):
            report = client.call('act', action=self.action, goal=GOAL)
            self.assertEqual((report['state'], report['result'], report['feedback']), ('SUCCEEDED', 2 * GOAL, GOAL))
        self.assert_no_warning(server, client)

    def test_its_topics_go_through_shared_memory(self):
        server, client = self.pair()
        client.send('act', action=self.action, goal=LONG_GOAL, cancel=GOAL)
        for part in PARTS_OUT:
            server.await_transports(self.action + '/' + part, 'o', [self.SHM])
        for part in PARTS_IN:
            server.await_transports(self.action + '/' + part, 'i', [self.SHM])
        self.assertEqual(client.result()['state'], 'PREEMPTED')

    def test_cancel(self):
        _, client = self.pair()
        report = client.call('act', action=self.action, goal=LONG_GOAL, cancel=3)
        self.assertEqual(report['state'], 'PREEMPTED', report)
        self.assertGreaterEqual(report['feedback'], 3)
        report = client.call('act', action=self.action, goal=GOAL)
        self.assertEqual((report['state'], report['result']), ('SUCCEEDED', 2 * GOAL))

    def test_a_goal_of_another_client_preempts(self):
        server, first = self.pair()
        second, = self.peers('second', kind='service_peer', threads=2)
        first.send('act', action=self.action, goal=LONG_GOAL)
        server.await_transports(self.action + '/feedback', 'o', [self.SHM])
        # Only once the first goal is at work: its feedback has begun.
        server.call('await_goal', action=self.action)
        report = second.call('act', action=self.action, goal=GOAL)
        self.assertEqual((report['state'], report['result']), ('SUCCEEDED', 2 * GOAL))
        self.assertEqual(first.result()['state'], 'PREEMPTED')

    def test_a_killed_server(self):
        server, client = self.pair()
        client.send('act', action=self.action, goal=LONG_GOAL, timeout=20)
        server.call('await_goal', action=self.action)
        server.kill()
        replacement = self.peer('server', kind='service_peer', threads=2)
        replacement.call('serve_action', action=self.action)
        reply = client.answer()
        self.assertIn(reply['state'], ('LOST', 'no result'))
        report = client.call('act', action=self.action, goal=GOAL)
        self.assertEqual((report['state'], report['result']), ('SUCCEEDED', 2 * GOAL))


if __name__ == '__main__':
    harness.main(Actions)
