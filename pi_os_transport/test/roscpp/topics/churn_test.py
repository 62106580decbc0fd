#!/usr/bin/python3 -B
"""Judge of churn.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)

# roscpp needs about 0.2 s for a link, so a round makes and ends one on each of four topics at once.
TOPICS = 4
ROUNDS = 25
WARM_UP = 5  # rounds after which caches, arenas and thread stacks have their size


class Churn(harness.TransportTest):

    def settled(self, peer, files):
        """Footprint once the descriptors of the last link are closed; roscpp closes them in its poll thread."""
        harness.await_state(lambda: len(harness.open_files(peer.pid)) <= files,
                            lambda: '%s: %d descriptors, %d expected: %s'
                            % (peer.name, len(harness.open_files(peer.pid)), files, harness.open_files(peer.pid)),
                            timeout=10)
        return harness.Footprint(peer.pid)

    def assert_no_growth(self, peer, before):
        after = self.settled(peer, before.files)
        text = '%s: before %s; after %s' % (peer.name, before, after)
        self.assertLessEqual(after.maps, before.maps + 4, text)
        self.assertLessEqual(after.anonymous, before.anonymous + 1500, text)
        self.assertLessEqual(after.memfd, before.memfd + 1500, text)
        self.assertTrue(peer.alive())

    def test_subscribing_and_unsubscribing(self):
        topics = [self.topic('topic%d' % i) for i in range(TOPICS)]
        talker, listener = peers = self.peers('talker', 'listener')
        for i, topic in enumerate(topics):
            talker.call('advertise', **{'as': i}, topic=topic, queue=100)
        before = None
        for round_ in range(ROUNDS):
            if round_ == WARM_UP:
                before = [harness.Footprint(peer.pid) for peer in peers]
            for i, topic in enumerate(topics):
                listener.call('subscribe', **{'as': i}, topic=topic, queue=100)
            for i, topic in enumerate(topics):
                self.link(talker, listener, topic)
                talker.call('publish', pub=i, count=3, sizes='100,100000,3000')
            for i in range(TOPICS):
                report = listener.call('await_received', sub=i, seq=3 * round_ + 3)
                self.assert_complete(report, 3, first=3 * round_ + 1)
                listener.call('unsubscribe', sub=i)
            for i in range(TOPICS):
                talker.call('await_subscribers', pub=i, n=0)
        for peer, footprint in zip(peers, before):
            self.assert_no_growth(peer, footprint)

    def test_advertising_and_unadvertising(self):
        topics = [self.topic('topic%d' % i) for i in range(TOPICS)]
        talker, listener = peers = self.peers('talker', 'listener')
        for i, topic in enumerate(topics):
            listener.call('subscribe', **{'as': i}, topic=topic, queue=100)
        before = None
        for round_ in range(ROUNDS):
            if round_ == WARM_UP:
                before = [harness.Footprint(peer.pid) for peer in peers]
            identity = round_ + 1
            for i, topic in enumerate(topics):
                talker.call('advertise', **{'as': i}, topic=topic, queue=100, id=identity)
            for i, topic in enumerate(topics):
                self.link(talker, listener, topic)
                talker.call('publish', pub=i, count=3, sizes='100,100000,3000')
            for i in range(TOPICS):
                report = listener.call('await_received', sub=i, id=identity, seq=3)
                self.assert_complete(report, 3, identity=identity)
                talker.call('unadvertise', pub=i)
            for i in range(TOPICS):
                listener.call('await_publishers', sub=i, n=0)
        for peer, footprint in zip(peers, before):
            self.assert_no_growth(peer, footprint)

    def test_unsubscribing_in_the_middle_of_traffic(self):
        topic = self.topic()
        talker, witness, listener = self.peers('talker', 'witness', 'listener')
        talker.call('advertise', topic=topic, queue=1000)
        witness.call('subscribe', topic=topic, queue=1000)
        self.link(talker, witness, topic)
        talker.call('publish', count=0, rate=300, sizes='100,200000,5000', background=True)
        for round_ in range(ROUNDS):
            listener.call('subscribe', topic=topic, queue=1000)
            report = listener.call('await_received', n=3 + round_)
            flow = report['flows']['1']
            self.assertEqual((report['corrupt'], flow['lost'], flow['reordered']), (0, 0, 0), report)
            listener.call('unsubscribe')
        last = talker.call('stop')['published']
        talker.call('await_subscribers', n=1)
        self.assert_complete(witness.call('await_received', seq=last), last)


if __name__ == '__main__':
    harness.main(Churn, plain=False)
