#!/usr/bin/python3 -B
"""Judge of subscriber_killed.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

SIZES = 'rand:64:1000000'


class SubscriberKilled(harness.TransportTest):

    def test_others_lose_nothing_during_traffic(self):
        topic = self.topic()
        talker, first, second, third, victim = self.peers('talker', 'first', 'second', 'third', 'victim')
        talker.call('advertise', topic=topic, queue=2000)
        listeners = (first, second, third, victim)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=2000)
        for listener in listeners:
            self.link(talker, listener, topic, of=4)
        talker.send('publish', count=600, rate=400, sizes=SIZES)
        victim.call('await_received', seq=100)
        victim.kill()
        talker.result()
        for listener in (first, second, third):
            self.assert_complete(listener.call('await_received', seq=600), 600)
        report = talker.call('await_subscribers', n=3)
        self.assertEqual(report['disconnected'], [victim.name])
        self.assertEqual(talker.transports(topic, 'o'), [self.SHM] * 3)
        self.assert_no_warning(talker, first, second, third)

    def test_what_a_dead_subscriber_held_serves_again(self):
        topic = self.topic()
        # 64 MB of pool; each victim dies with 20 messages of 1 MB in its queue, 200 MB in all.
        talker = self.peer('talker', env={'PI_OS_POOL_LIMIT_MB': '64'})
        survivor, = self.peers('survivor')
        talker.call('advertise', topic=topic, queue=100)
        survivor.call('subscribe', topic=topic, queue=100)
        self.link(talker, survivor, topic)
        for life in range(10):
            victim = self.peer('victim', threads=2)
            victim.call('subscribe', **{'as': 'held'}, topic=topic, queue=100, hold=True)
            victim.call('subscribe', **{'as': 'witness'}, topic=topic, queue=100, type='any')
            self.link(talker, victim, topic, of=2)
            talker.call('publish', count=20, sizes=1000000)
            victim.call('await_received', sub='witness', n=20)
            victim.kill()
            talker.call('await_subscribers', n=1)
            survivor.call('await_received', seq=20 * (life + 1))
        self.assert_complete(survivor.call('report'), 200)
        self.assertEqual(survivor.transports(topic, 'i'), [self.SHM])
        self.assert_no_warning(talker, survivor)


if __name__ == '__main__':
    harness.main(SubscriberKilled)
