#!/usr/bin/python3 -B
"""Judge of zero_copy.test."""
import os
import pathlib
import signal
import sys

import rosbag

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)
from rospy_peer import pattern  # noqa: E402

SIZES = [100000, 5000, 64, 1000000, 1023, 1024, 0, 300001]
LARGE = sum(1 for size in SIZES if size >= 1024)
COUNT = 25 * len(SIZES)


class ZeroCopy(harness.TransportTest):

    def talker(self, topic, **options):
        peer = self.peer('talker', kind='zero_copy')
        peer.call('advertise', topic=topic, queue=1000, **options)
        return peer

    def listener(self, topic, name='listener', **options):
        peer = self.peer(name, kind='zero_copy')
        peer.call('subscribe', topic=topic, queue=1000, **options)
        return peer

    def stock(self, name, topic, verb, **options):
        peer = self.peer(name)
        peer.call(verb, topic=topic, queue=1000, **options)
        return peer

    def publish(self, talker, count=COUNT, sizes=SIZES, rate=1000):
        return talker.call('publish', count=count, rate=rate, sizes=','.join(map(str, sizes)))

    def assert_undamaged(self, report, count):
        self.assertEqual((report['received'], report['corrupt'], report['reordered']), (count, 0, 0), report)

    def views(self, count):
        """How many of `count` messages arrive as views: none over TCPROS."""
        return count if self.preload else 0

    def test_zero_copy_to_zero_copy(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.listener(topic)
        self.link(talker, listener, topic)
        self.publish(talker)
        report = listener.call('await_received', n=COUNT)
        self.assert_undamaged(report, COUNT)
        self.assertEqual(report['views'], self.views(COUNT // len(SIZES) * LARGE))
        statistics = talker.call('statistics')
        self.assertEqual((statistics['in_place'], statistics['small'], statistics['no_room']),
                         (COUNT // len(SIZES) * LARGE, COUNT // len(SIZES) * (len(SIZES) - LARGE), 0))
        self.assertEqual(statistics['from_heap'], 0 if self.preload else statistics['in_place'])
        received = listener.call('statistics')
        self.assertEqual((received['viewed'], received['copied']),
                         (report['views'], 0 if self.preload else COUNT))
        self.assert_no_warning(talker, listener)

    def test_zero_copy_to_stock_roscpp(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.stock('stock', topic, 'subscribe')
        self.link(talker, listener, topic)
        self.publish(talker)
        self.assert_complete(listener.call('await_received', seq=COUNT), COUNT)

    def test_stock_roscpp_to_zero_copy(self):
        topic = self.topic()
        talker = self.stock('stock', topic, 'advertise')
        listener = self.listener(topic)
        self.link(talker, listener, topic)
        self.publish(talker)
        report = listener.call('await_received', n=COUNT)
        self.assert_undamaged(report, COUNT)
        self.assertEqual(report['views'], self.views(COUNT // len(SIZES) * LARGE))

    def test_to_everybody_at_once(self):
        topic = self.topic()
        talker = self.talker(topic)
        zero_copy = self.listener(topic)
        same = self.stock('same', topic, 'subscribe')
        plain = self.peer('tcpros', preload='')
        plain.call('subscribe', topic=topic, queue=1000)
        python = self.peer('python', preload='', kind='rospy')
        python.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=4)
        talker.await_transports(topic, 'o', [self.SHM, self.SHM, 'TCPROS', 'TCPROS'])
        self.publish(talker, rate=200)
        self.assert_undamaged(zero_copy.call('await_received', n=COUNT), COUNT)
        for listener in (same, plain, python):
            self.assert_complete(listener.call('await_received', seq=COUNT), COUNT)

    def test_from_rospy(self):
        topic = self.topic()
        talker = self.peer('python', preload='', kind='rospy')
        talker.call('advertise', topic=topic, queue=1000)
        listener = self.listener(topic)
        talker.call('await_subscribers', n=1)
        self.publish(talker)
        report = listener.call('await_received', n=COUNT)
        self.assert_undamaged(report, COUNT)
        self.assertEqual(report['views'], 0)

    def test_to_and_from_a_bag(self):
        topic = self.topic()
        path = os.path.join(self.scratch(), 'zero_copy.bag')
        talker = self.talker(topic)
        recorder = self.process([harness.other_program('rosbag', 'record'), '-O', path, '-l', str(COUNT), '--buffsize=0',
                                 topic, '__name:=' + self.unique('recorder')])
        talker.call('await_subscribers', n=1)
        self.publish(talker, rate=200)
        self.assertEqual(recorder.wait(), 0, recorder.lines)  # ends by itself with the last message
        with rosbag.Bag(path) as bag:
            numbers = []
            for _, message, _ in bag.read_messages():
                self.assertEqual(bytes(message.data), pattern(1, message.width, SIZES[message.width % len(SIZES)]))
                numbers.append(message.width)
            self.assertEqual(numbers, list(range(1, COUNT + 1)))
        talker.exit()
        listener = self.listener(topic)
        player = self.process([harness.other_program('rosbag', 'play'), '--wait-for-subscribers', '--quiet', path,
                               '__name:=' + self.unique('player')])
        self.assert_undamaged(listener.call('await_received', n=COUNT), COUNT)
        player.signal(signal.SIGINT)
        player.wait()

    def test_latched(self):
        topic = self.topic()
        talker = self.talker(topic, latch=1)
        talker.call('publish', count=3, sizes=200000)
        listener = self.listener(topic)
        self.assert_undamaged(listener.call('await_received', n=1), 1)
        late = self.stock('late', topic, 'subscribe')
        self.assert_complete(late.call('await_received', seq=3), 1, first=3)

    def test_a_held_view_stays_while_messages_go_on(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.listener(topic, hold=5)
        self.link(talker, listener, topic)
        self.publish(talker, count=1000, sizes=[20000], rate=2000)  # four times round the ring
        report = listener.call('await_received', n=1000)
        self.assert_undamaged(report, 1000)
        self.assertEqual(report['views'], self.views(1000), 'a held view turned later messages into copies')
        self.assertEqual(listener.call('check_held')['intact'], 5)

    def test_what_is_held_is_bounded(self):
        topic = self.topic()
        talker = self.peer('talker', kind='zero_copy', env={'PI_OS_POOL_LIMIT_MB': '64'})  # 8 MB may be held
        talker.call('advertise', topic=topic, queue=1000)
        listener = self.listener(topic, hold=600)
        self.link(talker, listener, topic)
        self.publish(talker, count=600, sizes=[100000], rate=600)
        self.assert_undamaged(listener.call('await_received', n=600), 600)
        held = listener.call('check_held')
        self.assertEqual((held['held'], held['intact']), (600, 600))
        if self.preload:
            # As much again may wait to be taken, and the pool grows by half of what it has.
            self.assertLessEqual(harness.memfd_kb(talker.pid), 1.5 * 2 * 8 * 1024 + 1024)
        listener.call('drop_held')
        self.publish(talker, count=10, sizes=[100000], rate=300)
        self.assert_undamaged(listener.call('await_received', n=610), 610)

    def test_views_outlive_subscriber_publisher_and_ros(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.listener(topic, hold=3)
        self.link(talker, listener, topic)
        self.publish(talker, count=3, sizes=[100000])
        listener.call('await_received', n=3)
        listener.call('unsubscribe')
        self.publish(talker, count=300, sizes=[100000])  # would overwrite what is not held
        self.assertEqual(listener.call('check_held')['intact'], 3)
        talker.kill()
        self.assertEqual(listener.call('check_held')['intact'], 3)
        listener.call('shutdown_ros')
        self.assertEqual(listener.call('check_held')['intact'], 3)
        listener.call('drop_held')
        self.assertEqual(listener.exit(), 0)

    def test_publisher_killed_while_views_are_held(self):
        topic = self.topic()
        listener = self.listener(topic, hold=20)
        for life in range(3):
            talker = self.talker(topic)
            talker.call('await_subscribers', n=1)
            talker.call('publish', count=0, rate=500, sizes='50000,200000', background=1)
            listener.call('await_received', n=50 * (life + 1))
            talker.kill()
            held = listener.call('check_held')
            self.assertEqual(held['intact'], held['held'])
        report = listener.call('await_received', n=150)
        self.assertEqual(report['corrupt'], 0)

    def test_subscriber_killed_while_views_are_held(self):
        topic = self.topic()
        talker = self.talker(topic)
        survivor = self.listener(topic, 'survivor')
        for life in range(3):
            victim = self.listener(topic, 'victim', hold=50)
            talker.call('await_subscribers', n=2)
            talker.await_transports(topic, 'o', [self.SHM, self.SHM])
            self.publish(talker, count=60, sizes=[300000], rate=300)
            victim.call('await_received', n=60)
            victim.kill()
            talker.call('await_subscribers', n=1)
        report = survivor.call('await_received', n=180)
        self.assert_undamaged(report, 180)
        if self.preload:
            # The next lives find the memory of the killed ones.
            self.assertLessEqual(harness.memfd_kb(talker.pid), 50 * 1024)

    def test_loans_that_are_never_published_come_back(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.listener(topic)
        self.link(talker, listener, topic)
        for _ in range(10):
            talker.call('borrow', count=20, size=1000000)
            talker.call('drop_loans')
        if self.preload:
            self.assertLessEqual(harness.memfd_kb(talker.pid), 50 * 1024)
        talker.call('borrow', count=3, size=1000000)
        talker.call('publish_loans')
        self.assert_undamaged(listener.call('await_received', n=3), 3)

    def test_loans_outlive_publisher_subscriber_and_ros(self):
        topic = self.topic()
        talker = self.talker(topic)
        listener = self.listener(topic)
        self.link(talker, listener, topic)
        talker.call('borrow', count=4, size=1000000)
        listener.kill()
        talker.call('await_subscribers', n=0)
        talker.call('unadvertise')
        talker.call('publish_loans')
        talker.call('borrow', count=2, size=1000000)
        talker.call('shutdown_ros')
        talker.call('borrow', count=2, size=1000000)
        talker.call('drop_loans')
        self.assertEqual(talker.exit(), 0)

    def test_publisher_and_subscriber_in_one_process(self):
        topic = self.topic()
        both = self.talker(topic)
        both.call('subscribe', topic=topic, queue=1000, hold=3)
        both.call('await_subscribers', n=1)
        self.publish(both, count=20, sizes=[100000])
        report = both.call('await_received', n=20)
        self.assert_undamaged(report, 20)
        self.assertEqual(report['views'], 20)
        self.assertEqual(both.call('check_held')['intact'], 3)

    def test_nodes_of_the_tutorial(self):
        topic = self.topic()
        camera = self.process([harness.program('camera_zero_copy'), '__name:=' + self.unique('camera'),
                               'image:=' + topic])
        viewer = self.process([harness.program('viewer_zero_copy'), '__name:=' + self.unique('viewer'),
                               'image:=' + topic], env={'ROSCONSOLE_STDOUT_LINE_BUFFERED': '1'})
        seen = r'1920x1080 from camera_optical, %s: mean' % ('not copied' if self.preload else 'copied')
        harness.await_state(lambda: len(viewer.output(seen)) >= 2, lambda: viewer.lines[-5:])
        for node in (viewer, camera):
            node.signal(signal.SIGINT)
            self.assertEqual(node.wait(), 0)
        harness.await_state(lambda: viewer.output('%s: received .* as views' % topic), lambda: viewer.lines[-5:])

    def test_without_any_subscriber(self):
        talker = self.talker(self.topic())
        statistics = self.publish(talker, count=100)
        self.assertEqual((statistics['in_place'], statistics['small'], statistics['no_room']), (0, 0, 0))


if __name__ == '__main__':
    harness.main(ZeroCopy)
