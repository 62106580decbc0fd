#!/usr/bin/python3
"""The checks of the benchmark, on stock TCPROS with faults injected by the publisher."""

import dataclasses
import os
import signal
import sys
import unittest

import rostest

PREFIXES = [prefix for prefix in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if prefix]
sys.path[:0] = [os.path.join(prefix, 'lib', 'pi_os_transport') for prefix in PREFIXES]
import transport_bench as bench  # noqa: E402  (from the devel or install space, where the nodes are)

TCPROS = bench.MODES['tcpros']
SIZES = (64, 1000000)  # checked in the callback, checked by the low-priority thread
FAULT_SEQUENCE = 5     # as in bench_publisher


class FaultsTest(unittest.TestCase):

    @classmethod
    def setUpClass(cls):
        cls.master = bench.Master(own=False)

    @classmethod
    def tearDownClass(cls):
        cls.master.close()

    def group(self, *publisher_args, subscribers=2, mode=TCPROS, **kwargs):
        return bench.Group(self.master, mode, subscribers, publisher_args=publisher_args, **kwargs)

    def assert_fails(self, pattern, group, *args, **kwargs):
        with self.assertRaisesRegex(bench.BenchError, pattern):
            with group:
                group.run(*args, **kwargs)

    def test_sound_traffic_passes(self):
        with self.group() as group:
            for size in SIZES:
                _, answers, _ = group.run(20, size, 200.0)
                self.assertEqual([20, 20], [len(answer['latencies_ns']) for answer in answers])
                group.run(200, size, window=8, period=3)
            group.verify_links()

    def test_a_wrong_byte_fails(self):
        for size in SIZES:
            with self.subTest(size=size):
                self.assert_fails(f'wrong byte: message {FAULT_SEQUENCE} of {size} bytes .* at byte {size - 1}$',
                                  self.group('--fault', 'byte'), 20, size, 200.0)

    def test_a_wrong_byte_fails_back_to_back(self):
        self.assert_fails(f'wrong byte: message {FAULT_SEQUENCE} ', self.group('--fault', 'byte'), 20, 1000000,
                          window=4, period=3)

    def test_a_lost_message_fails(self):
        for size in SIZES:
            with self.subTest(size=size):
                self.assert_fails(f'lost or reordered .* {FAULT_SEQUENCE + 1} arrived, {FAULT_SEQUENCE} was next',
                                  self.group('--fault', 'drop'), 20, size, 200.0)

    def test_a_lost_last_message_fails(self):
        self.assert_fails(f'lost messages\\? .*subscriber_0 has received {FAULT_SEQUENCE} messages',
                          self.group('--fault', 'drop', answer_s=2.0), FAULT_SEQUENCE + 1, 64, 200.0)

    def test_reordered_messages_fail(self):
        for size in SIZES:
            with self.subTest(size=size):
                self.assert_fails(f'reordered .* {FAULT_SEQUENCE + 1} arrived, {FAULT_SEQUENCE} was next',
                                  self.group('--fault', 'order'), 20, size, 200.0)

    def test_the_wrong_transport_fails(self):
        mode = dataclasses.replace(TCPROS, transport='SHMROS')
        with self.assertRaisesRegex(bench.BenchError, 'not connected as required .* expected over SHMROS'):
            self.group(mode=mode, connect_s=2.0)

    def test_a_transport_that_changes_fails(self):
        with self.assertRaisesRegex(bench.BenchError, 'the transport changed during the run'):
            with self.group() as group:
                group.mode = dataclasses.replace(TCPROS, transport='SHMROS')
                group.verify_links()

    def test_a_node_that_dies_fails(self):
        group = self.group()
        os.kill(group.subscribers[1].pid, signal.SIGKILL)
        self.assert_fails('subscriber_1 ended with signal SIGKILL', group, 20, 64, 200.0)


class FiguresTest(unittest.TestCase):

    def test_percentiles_are_nearest_rank(self):
        values = list(range(1, 101))
        self.assertEqual([50, 90, 99, 100], [bench.percentile(values, p) for p in (50, 90, 99, 100)])
        self.assertEqual(7, bench.percentile([7], 99))
        self.assertEqual(2, bench.percentile([3, 1, 2], 50))

    def test_smaps_counts_the_pool_apart(self):
        text = '\n'.join((
            '55e0-55e1 r-xp 00000000 08:01 12 /usr/bin/node', 'Rss: 8 kB', 'Private_Clean: 4 kB', 'Private_Dirty: 2 kB',
            '7f00-7f10 rw-s 00000000 00:01 77 /memfd:pi_os_pool (deleted)', 'Rss: 300 kB', 'Private_Dirty: 200 kB',
            '7f20-7f30 rw-p 00000000 00:00 0 ', 'Rss: 16 kB', 'Private_Dirty: 16 kB',
            '7f40-7f50 rw-s 00000000 00:01 78 /memfd:other (deleted)', 'Rss: 1 kB', 'Private_Dirty: 1 kB'))
        self.assertEqual({'private': 23 * 1024, 'pool': 300 * 1024}, bench.parse_smaps(text))

    def rows(self, nodelay, pi_os):
        return [{'round': i, 'measure': 'latency', 'mode': mode, 'size': 64, 'subscribers': 1, 'p50_us': value}
                for mode, values in (('nodelay', nodelay), ('pi_os', pi_os)) for i, value in enumerate(values)]

    def test_ratios_are_paired_by_round(self):
        results = bench.Results(self.rows([10.0, 40.0, 60.0], [10.0, 20.0, 20.0]))
        self.assertEqual((2.0, 1.0, 3.0), results.ratio('latency', 'p50_us', 'nodelay', 'pi_os', size=64))

    def test_a_bar_is_met_or_missed_by_its_median(self):
        met = bench.bars(bench.Results(self.rows([12.1, 30.0], [10.0, 10.0])))
        self.assertEqual([True], [bar.met() for bar in met])
        missed = bench.bars(bench.Results(self.rows([11.9, 11.0], [10.0, 10.0])))
        self.assertEqual([False], [bar.met() for bar in missed])
        self.assertIn('MISSED', missed[0].line())

    def test_nothing_measured_decides_no_bar(self):
        self.assertEqual([], bench.bars(bench.Results([])))


if __name__ == '__main__':
    rostest.rosrun('pi_os_transport', 'bench_finds_faults', '__main__')
