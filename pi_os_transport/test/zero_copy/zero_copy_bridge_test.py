#!/usr/bin/python3 -B
"""Judge of zero_copy_bridge.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

SIZES = [300000, 64, 2000, 1000000]
COUNT = 20 * len(SIZES)
LARGE = COUNT // len(SIZES) * 3


class ZeroCopyBridge(device_testbed.DeviceTest):

    def setUp(self):
        super().setUp()
        self.start_bridges()

    def test_to_zero_copy_and_stock_nodes_of_another_device(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker', kind='zero_copy')
        talker.call('advertise', topic=topic, queue=1000)
        near = self.node(self.vehicle, 'near', kind='zero_copy')
        far = self.node(self.edge_a, 'far', kind='zero_copy')
        stock = self.node(self.edge_a, 'stock')
        for listener in (near, far, stock):
            listener.call('subscribe', topic=topic, queue=1000)
        near.await_transports(topic, 'i', [self.SHM])
        for listener in (far, stock):
            listener.await_transports(topic, 'i', [self.NN])
        talker.await_transports(topic, 'o', [self.SHM, self.NN, self.NN])
        talker.call('publish', count=COUNT, rate=100, sizes=','.join(map(str, SIZES)))
        for listener in (near, far):
            report = listener.call('await_received', n=COUNT)
            self.assertEqual((report['received'], report['corrupt'], report['reordered']), (COUNT, 0, 0), report)
            self.assertEqual(report['views'], LARGE if self.preload else 0, report)
        self.assert_complete(stock.call('await_received', seq=COUNT), COUNT)

    def test_views_outlive_the_bridge(self):
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker', kind='zero_copy')
        talker.call('advertise', topic=topic, queue=1000)
        far = self.node(self.edge_a, 'far', kind='zero_copy')
        far.call('subscribe', topic=topic, queue=1000, hold=5)
        far.await_transports(topic, 'i', [self.NN])
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=20, rate=100, sizes=300000)
        far.call('await_received', n=20)
        if self.preload:
            self.bridges[self.edge_a.name].kill()
        talker.kill()
        held = far.call('check_held')
        self.assertEqual((held['held'], held['intact']), (5, 5))


if __name__ == '__main__':
    harness.main(ZeroCopyBridge)
