#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares stock TCPROS, TCPROS with tcpNoDelay and π-OS between unmodified roscpp nodes, alternating in one run."""

import argparse
import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import program  # noqa: E402

UNITS = {'': 1, 'b': 1, 'kb': 1000, 'mb': 1000000}


def parse_size(text):
    text = text.strip().lower()
    if text in ('6.2mb', '1080p'):
        return bench.FULL_HD
    number = text.rstrip('bkm ')
    unit = text[len(number):].strip()
    try:
        value = int(float(number) * UNITS[unit + 'b' if unit in ('k', 'm') else unit])
    except (ValueError, KeyError):
        raise argparse.ArgumentTypeError(f'size {text!r}, must be like 64, 16kB or 1MB') from None
    if not 40 <= value <= 512000000:
        raise argparse.ArgumentTypeError(f'size {text!r}, must be in [40 B, 512 MB]')
    return value


def parse_mode(text):
    if text not in bench.MODES:
        raise argparse.ArgumentTypeError(f'mode {text!r}, must be one of {", ".join(bench.MODES)}')
    return bench.MODES[text]


def parse_arguments():
    parser = argparse.ArgumentParser(prog='bench_transport', description=__doc__, epilog='Exit status: 0 when every '
                                     'message arrived intact, in order and over the transport of its mode, whatever '
                                     'the bars say; 1 otherwise.')
    program.add_library(parser)
    parser.add_argument('--modes', type=program.parse_list(parse_mode),
                        default=[mode for mode in bench.MODES.values() if mode.usual],
                        help='comma-separated, of ' + ', '.join(bench.MODES) +
                             ' (PI_OS_SKIP_ZERO_FILL=0; only if named here)')
    parser.add_argument('--rounds', type=program.parse_positive, help='alternating rounds (default 3; 1 with --quick)')
    parser.add_argument('--sizes', type=program.parse_list(parse_size),
                        help='payloads, comma-separated, like 64,16kB,1MB,6.2MB (default 64 B to 16 MB)')
    parser.add_argument('--subscribers', type=program.parse_list(program.parse_positive),
                        help='numbers of subscribers, comma-separated (default 1,2,4,5,8)')
    parser.add_argument('--only', action='append', choices=('latency', 'small', 'throughput', 'memory', 'cpu'),
                        help='measure only this; may be given more than once. cpu: time per message and of idle '
                             'nodes; small: CPU time of each node for small messages at control rates')
    parser.add_argument('--quick', action='store_true', help='a small subset, about 20 s')
    program.add_json(parser)
    parser.add_argument('--plot', metavar='FILE', help='draw latency by size and by subscribers to FILE (PNG)')
    return program.parse(parser)


def make_plan(options):
    plan = bench.Plan(modes=options.modes)
    if options.quick:
        plan = bench.Plan(modes=options.modes, rounds=1, sizes=[64, 1000000, bench.FULL_HD],
                          fan_out_sizes=[1000000], subscribers=[1], latency_s=0.7, throughput_volume=200e6, idle_s=1.0,
                          endpoints=50, measures=('latency', 'throughput', 'memory', 'cpu'))
    if options.rounds:
        plan.rounds = options.rounds
    if options.sizes:
        plan.sizes = sorted(set(options.sizes))
        plan.fan_out_sizes = plan.sizes if options.subscribers else plan.fan_out_sizes
    if options.subscribers:
        plan.subscribers, plan.five_subscribers = sorted(set(options.subscribers)), False
    if options.only:
        plan.measures = tuple(options.only)
    return plan


def run(options):
    plan = make_plan(options)
    library = bench.find_library(options.library) if any(mode.preload for mode in plan.modes) else None
    if options.plot:
        bench.require_matplotlib()
    program.require_writable(options.json, options.plot)
    machine = bench.machine()
    command = program.command('bench_transport')
    begin = time.monotonic()
    with bench.Master() as master:
        comparison = bench.Comparison(plan, master, library, program.progress)
        comparison.run()
    results = bench.Results(comparison.rows)

    program.print_machine(machine)
    print(f'{plan.rounds} round(s), modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s; '
          f'every message checked\n{command}\n')
    tables = bench.report(results, plan.modes), bench.small_messages.table(results, plan.modes)
    print('\n\n'.join(filter(None, tables)))
    bars = bench.bars(results)
    program.print_bars(bars)
    program.print_warnings(comparison.warnings)
    program.write_json(options.json, {'command': command, 'machine': machine, 'library': library,
                                      'rounds': plan.rounds, 'rows': comparison.rows}, bars)
    if options.plot:
        bench.plot(results, plan.modes, options.plot,
                   f'{machine["cpu"]}, {machine["usable_cores"]} core(s), Linux {machine["kernel"]}, '
                   f'median of {plan.rounds} round(s)')
        print(f'written: {options.plot}')


if __name__ == '__main__':
    sys.exit(program.exit_status('bench_transport', run, parse_arguments()))
