#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares stock TCPROS, TCPROS with tcpNoDelay and π-OS between unmodified roscpp nodes, alternating in one run."""

import argparse
import json
import os
import shlex
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)

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


def parse_list(parse):
    return lambda text: [parse(part) for part in text.split(',')]


def parse_positive(text):
    if not text.strip().isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r}, must be a whole number of at least 1')
    return int(text)


def parse_mode(text):
    if text not in bench.MODES:
        raise argparse.ArgumentTypeError(f'mode {text!r}, must be one of {", ".join(bench.MODES)}')
    return bench.MODES[text]


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='bench_transport', description=__doc__, epilog='Exit status: 0 when every '
                                     'message arrived intact, in order and over the transport of its mode, whatever '
                                     'the bars say; 1 otherwise.')
    parser.add_argument('--library', help=f'path of {bench.LIBRARY_NAME}; default: that of the same prefix')
    parser.add_argument('--modes', type=parse_list(parse_mode), default=list(bench.MODES.values()),
                        help='comma-separated, of ' + ', '.join(bench.MODES))
    parser.add_argument('--rounds', type=parse_positive, help='alternating rounds (default 3; 1 with --quick)')
    parser.add_argument('--sizes', type=parse_list(parse_size),
                        help='payloads, comma-separated, like 64,16kB,1MB,6.2MB (default 64 B to 16 MB)')
    parser.add_argument('--subscribers', type=parse_list(parse_positive),
                        help='numbers of subscribers, comma-separated (default 1,2,4,5,8)')
    parser.add_argument('--only', action='append', choices=('latency', 'small', 'throughput', 'memory', 'cpu'),
                        help='measure only this; may be given more than once. cpu: time per message and of idle '
                             'nodes; small: CPU time of each node for small messages at control rates')
    parser.add_argument('--quick', action='store_true', help='a small subset, about 20 s')
    parser.add_argument('--json', metavar='FILE', help='write everything measured to FILE')
    parser.add_argument('--plot', metavar='FILE', help='draw latency by size and by subscribers to FILE (PNG)')
    # rosrun and roslaunch add remappings such as __name:=x.
    return parser.parse_args([argument for argument in arguments if ':=' not in argument])


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
    for path in filter(None, (options.json, options.plot)):
        folder = os.path.dirname(os.path.abspath(path))
        if not os.access(folder, os.W_OK):
            raise bench.BenchError(f'cannot write {path}: {folder} does not exist or is not writable')
    machine = bench.machine()
    command = 'rosrun pi_os_transport bench_transport ' + shlex.join(sys.argv[1:])
    begin = time.monotonic()
    with bench.Master() as master:
        comparison = bench.Comparison(plan, master, library, lambda text: print(text, file=sys.stderr, flush=True))
        comparison.run()
    results = bench.Results(comparison.rows)

    print(f'\n{machine["cpu"]}, {machine["usable_cores"]} core(s), {machine["memory_gb"]} GB, '
          f'Linux {machine["kernel"]} {machine["architecture"]}, governor {machine["governor"]}, '
          f'load average at the start {machine["load_average"][0]:.2f}')
    print(', '.join(f'{name} {version}' for name, version in machine['versions'].items()) +
          ''.join(f', {key}={value}' for key, value in machine['settings'].items()))
    print(f'{plan.rounds} round(s), modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s; '
          f'every message checked\n{command}\n')
    tables = bench.report(results, plan.modes), bench.small_messages.table(results, plan.modes)
    print('\n\n'.join(filter(None, tables)))
    bars = bench.bars(results)
    if bars:
        print('\nBars (median of the rounds, spread = min..max of the rounds)')
        for bar in bars:
            print('  ' + bar.line())
    for warning in sorted(set(comparison.warnings)):
        print('node wrote: ' + warning, file=sys.stderr)
    if options.json:
        with open(options.json, 'w') as file:
            json.dump({'command': command, 'machine': machine, 'library': library, 'rounds': plan.rounds,
                       'rows': comparison.rows,
                       'bars': [{'text': bar.text, 'median': bar.value[0], 'min': bar.value[1], 'max': bar.value[2],
                                 'bound': bar.bound, 'at_least': bar.at_least, 'unit': bar.unit, 'met': bar.met(),
                                 'note': bar.note} for bar in bars]}, file, indent=1, ensure_ascii=False)
        print(f'\nwritten: {options.json}')
    if options.plot:
        bench.plot(results, plan.modes, options.plot,
                   f'{machine["cpu"]}, {machine["usable_cores"]} core(s), Linux {machine["kernel"]}, '
                   f'median of {plan.rounds} round(s)')
        print(f'written: {options.plot}')


def main():
    options = parse_arguments(sys.argv[1:])
    try:
        run(options)
    except bench.BenchError as error:
        print(f'bench_transport: FAILED: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('bench_transport: interrupted', file=sys.stderr)
        return 130
    return 0


if __name__ == '__main__':
    sys.exit(main())
