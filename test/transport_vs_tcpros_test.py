#!/usr/bin/python3
"""A small comparison of π-OS and stock TCPROS with the nodes of the benchmark, under the master of rostest."""

import os
import sys
import unittest

import rostest

PREFIXES = [prefix for prefix in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if prefix]
sys.path[:0] = [os.path.join(prefix, 'lib', 'pi_os_transport') for prefix in PREFIXES]
import transport_bench as bench  # noqa: E402  (from the devel or install space, where the nodes are)


def option(name):
    values = [argument.split('=', 1)[1] for argument in sys.argv if argument.startswith(name + '=')]
    return values[-1] if values else ''


class TransportVsTcprosTest(unittest.TestCase):

    def test_every_message_arrives_intact_and_in_order(self):
        plan = bench.Plan(modes=list(bench.MODES.values()), rounds=2, sizes=[64, 16000, 1000000, bench.FULL_HD],
                          fan_out_sizes=[64, 1000000], subscribers=[1, 3], five_subscribers=False,
                          measures=('latency', 'throughput'), latency_s=0.4, throughput_volume=50e6)
        with bench.Master(own=False) as master:
            # Raises BenchError on loss, corruption, wrong order, a wrong transport or a dead node.
            rows = bench.Comparison(plan, master, bench.find_library(option('--library'))).run()

        # Each cell of the plan in each mode and round: nothing was left out.
        of_measure = {measure: sorted((row['round'], row['mode'], row['subscribers'], row['size'])
                                      for row in rows if row['measure'] == measure) for measure in plan.measures}
        runs = [(round_number, mode.key) for round_number in range(plan.rounds) for mode in plan.modes]
        self.assertEqual(sorted((*run, number, size) for run in runs for number, sizes in plan.latency_cells()
                                for size in sizes), of_measure['latency'])
        self.assertEqual(sorted((*run, 1, size) for run in runs for size in plan.sizes), of_measure['throughput'])
        print(bench.report(bench.Results(rows), plan.modes))


if __name__ == '__main__':
    rostest.rosrun('pi_edge', 'transport_vs_tcpros', '__main__')
