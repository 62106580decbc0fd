#!/usr/bin/python3 -B
"""Judge of publisher_killed.test."""
import pathlib
import sys

import rosgraph

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class PublisherKilled(harness.TransportTest):

    def test_queued_messages_outlive_the_publisher(self):
        topic = self.topic()
        talker, = self.peers('talker')
        listener, = self.peers('listener', threads=2)
        talker.call('advertise', topic=topic, queue=100)
        # Two subscriptions of one process: the held one keeps serialized messages in its queue, and the other one, of
        # another C++ type, so that each deserializes for itself, shows that all of them have arrived.
        listener.call('subscribe', **{'as': 'held'}, topic=topic, queue=100, hold=True)
        listener.call('subscribe', **{'as': 'witness'}, topic=topic, queue=100, type='any')
        self.link(talker, listener, topic)
        talker.call('publish', count=30, sizes='300000,10,70000')
        listener.call('await_received', sub='witness', n=30)
        talker.kill()
        listener.call('release', sub='held')
        self.assert_complete(listener.call('await_received', sub='held', n=30), 30)

    def test_subscribers_see_it_go_and_find_it_again(self):
        topic = self.topic()
        listeners = self.peers('listener0', 'listener1')
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=1000)
        for life in range(3):
            talker = self.peer('talker')
            talker.call('advertise', topic=topic, queue=1000, id=life + 1)
            talker.call('await_subscribers', n=2)
            for listener in listeners:
                self.link(talker, listener, topic, of=2)
            talker.call('publish', count=0, rate=500, sizes='rand:64:1000000', background=True)
            for listener in listeners:
                listener.call('await_received', id=life + 1, seq=50)
            talker.kill()
            # The master learns of a death only from a successor or from "rosnode cleanup", which does this.
            master = rosgraph.Master(talker.name)
            master.unregisterPublisher(topic, self.talker_uri(talker))
            for listener in listeners:
                listener.call('await_publishers', n=0)
                report = listener.call('report')
                flow = report['flows'][str(life + 1)]
                self.assertEqual((report['corrupt'], flow['lost'], flow['reordered'], flow['received']),
                                 (0, 0, 0, flow['highest'] - flow['first'] + 1), report)

    def test_successor_of_the_same_name_without_cleanup(self):
        topic = self.topic()
        listener, = self.peers('listener')
        listener.call('subscribe', topic=topic, queue=1000)
        first = self.peer('talker')
        first.call('advertise', topic=topic, queue=1000, id=1)
        self.link(first, listener, topic)
        first.call('publish', count=20, sizes=100000)
        self.assert_complete(listener.call('await_received', id=1, seq=20), 20)
        first.kill()
        second = self.peer('talker')
        second.call('advertise', topic=topic, queue=1000, id=2)
        self.link(second, listener, topic)
        listener.call('await_publishers', n=1)
        second.call('publish', count=20, sizes=100000)
        self.assert_complete(listener.call('await_received', id=2, seq=20), 20, identity=2)

    @staticmethod
    def talker_uri(talker):
        return rosgraph.Master('/judge').lookupNode(talker.name)


if __name__ == '__main__':
    harness.main(PublisherKilled)
