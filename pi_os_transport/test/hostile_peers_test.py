#!/usr/bin/python3 -B
"""Judge of hostile_peers.test."""
import hostile_peers
import transport_harness as harness

ROUNDS = 2        # of all kinds after the first one, which fills caches and pool
SPARE = 4         # descriptors that roscpp may open meanwhile


class HostilePeers(harness.TransportTest):

    def setUp(self):
        super().setUp()
        self.topic_ = self.topic()
        self.talker, self.listener = self.peers('talker', 'listener', threads=2)
        self.talker.call('advertise', topic=self.topic_, queue=10000)
        self.listener.call('subscribe', topic=self.topic_, queue=10000)
        self.link(self.talker, self.listener, self.topic_)
        self.talker.call('publish', count=0, rate=50, sizes='rand:64:500000', background=True)

    def assert_nothing_happened(self, kind):
        """What is sent from now on arrives, and nothing was lost meanwhile."""
        seq = self.talker.call('publisher')['published'] + 3
        report = self.listener.call('await_received', seq=seq)
        flow = report['flows']['1']
        self.assertEqual((report['corrupt'], flow['lost'], flow['reordered']), (0, 0, 0), '%s: %s' % (kind, report))

    def survive(self, kinds, misbehave, target):
        before = None
        for round_ in range(ROUNDS + 1):
            for number, kind in enumerate(kinds):
                with self.subTest(kind=kind):
                    misbehave(kind, 100 * round_ + number)
                    self.assert_nothing_happened(kind)
            if round_ == 0:
                before = harness.Footprint(target.pid)
        harness.await_state(lambda: len(harness.open_files(target.pid)) <= before.files + SPARE,
                            lambda: 'descriptors at first %d, now %s' % (before.files, harness.open_files(target.pid)))
        self.link(self.talker, self.listener, self.topic_)

    def test_subscribers(self):
        def misbehave(kind, seed):
            hostile_peers.HostileSubscriber(self.talker.name, self.topic_, seed).misbehave(kind)
        self.survive(hostile_peers.HostileSubscriber.KINDS, misbehave, self.talker)

    def test_publishers(self):
        def misbehave(kind, seed):
            hostile_peers.HostilePublisher(self.topic_, seed).misbehave(kind, 1)
        self.survive(hostile_peers.HostilePublisher.KINDS, misbehave, self.listener)


if __name__ == '__main__':
    harness.main(HostilePeers, plain=False, needs_library=True)
