#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares service calls and actions of unmodified roscpp nodes over stock TCPROS and π-OS, alternating in one run."""

import argparse
import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import program, services  # noqa: E402


def parse_arguments():
    parser = argparse.ArgumentParser(prog='bench_services', description=__doc__, epilog='Exit status: 0 when every '
                                     'call and goal got its right answer, whatever the bars say; 1 otherwise.')
    program.add_library(parser)
    parser.add_argument('--rounds', type=program.parse_positive, default=3, help='alternating rounds (default 3)')
    parser.add_argument('--quick', action='store_true', help='one round of the smallest and the largest size')
    program.add_json(parser)
    return program.parse(parser)


def run(options):
    modes = services.stock_and_pi_os()
    library = bench.find_library(options.library)
    program.require_writable(options.json)
    sizes = (services.SIZES[0], services.SIZES[-1]) if options.quick else services.SIZES
    rounds = 1 if options.quick else options.rounds
    machine = bench.machine()
    command = program.command('bench_services')
    begin = time.monotonic()
    with bench.Master() as master:
        comparison = services.ServiceComparison(master, library, modes, rounds, sizes, program.progress)
        comparison.run()
    results = bench.Results(comparison.rows)
    program.print_machine(machine)
    print(f'{rounds} round(s), modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s; every '
          f'answer checked\n{command}\n')
    print(services.table(results, modes))
    bars = services.bars(results)
    program.print_bars(bars)
    program.print_warnings(comparison.warnings)
    program.write_json(options.json, {'command': command, 'machine': machine, 'library': library, 'rounds': rounds,
                                      'rows': comparison.rows}, bars)


if __name__ == '__main__':
    sys.exit(program.exit_status('bench_services', run, parse_arguments()))
