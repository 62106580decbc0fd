#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares service calls and actions of unmodified roscpp nodes over stock TCPROS and π-OS, alternating in one run."""

import argparse
import json
import os
import shlex
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import services  # noqa: E402


def parse_positive(text):
    if not text.strip().isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r}, must be a whole number of at least 1')
    return int(text)


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='bench_services', description=__doc__, epilog='Exit status: 0 when every '
                                     'call and goal got its right answer, whatever the bars say; 1 otherwise.')
    parser.add_argument('--library', help=f'path of {bench.LIBRARY_NAME}; default: that of the same prefix')
    parser.add_argument('--rounds', type=parse_positive, default=3, help='alternating rounds (default 3)')
    parser.add_argument('--quick', action='store_true', help='one round of the smallest and the largest size')
    parser.add_argument('--json', metavar='FILE', help='write everything measured to FILE')
    return parser.parse_args([argument for argument in arguments if ':=' not in argument])


def run(options):
    modes = services.stock_and_pi_os()
    library = bench.find_library(options.library)
    sizes = (services.SIZES[0], services.SIZES[-1]) if options.quick else services.SIZES
    rounds = 1 if options.quick else options.rounds
    machine = bench.machine()
    begin = time.monotonic()
    with bench.Master() as master:
        comparison = services.ServiceComparison(master, library, modes, rounds, sizes,
                                                lambda text: print(text, file=sys.stderr, flush=True))
        comparison.run()
    results = bench.Results(comparison.rows)
    print(f'\n{machine["cpu"]}, {machine["usable_cores"]} core(s), {machine["memory_gb"]} GB, '
          f'Linux {machine["kernel"]} {machine["architecture"]}, load average at the start '
          f'{machine["load_average"][0]:.2f}')
    print(', '.join(f'{name} {version}' for name, version in machine['versions'].items()))
    print(f'{rounds} round(s), modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s; every '
          f'answer checked\nrosrun pi_os_transport bench_services {shlex.join(sys.argv[1:])}\n')
    print(services.table(results, modes))
    bars = services.bars(results)
    print('\nBars (median of the rounds, spread = min..max of the rounds)')
    for bar in bars:
        print('  ' + bar.line())
    for warning in sorted(set(comparison.warnings)):
        print('node wrote: ' + warning, file=sys.stderr)
    if options.json:
        with open(options.json, 'w') as file:
            json.dump({'machine': machine, 'rounds': rounds, 'rows': comparison.rows}, file, indent=1)
        print(f'\nwritten: {options.json}')


def main():
    options = parse_arguments(sys.argv[1:])
    try:
        run(options)
    except (bench.BenchError, OSError) as error:
        print(f'bench_services: FAILED: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('bench_services: interrupted', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
