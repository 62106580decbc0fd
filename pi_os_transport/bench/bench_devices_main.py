#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares stock TCPROS, TCPROS with tcpNoDelay and π-OS with bridges between devices, alternating in one run.

The devices are network namespaces of this machine (needs root), joined by a router whose cables are limited or cut.
"""

import argparse
import json
import os
import shlex
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import device_comparison, device_nodes, device_report  # noqa: E402


def parse_positive(text):
    if not text.strip().isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r}, must be a whole number of at least 1')
    return int(text)


def parse_modes(text):
    unknown = [name for name in text.split(',') if name not in device_nodes.DEVICE_MODES]
    if unknown:
        raise argparse.ArgumentTypeError(f'mode {unknown[0]!r}, must be one of ' +
                                         ', '.join(device_nodes.DEVICE_MODES))
    return [device_nodes.DEVICE_MODES[name] for name in text.split(',')]


def parse_arguments(arguments):
    parser = argparse.ArgumentParser(prog='bench_devices', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog='Exit status: 0 when every message that had to arrive did so intact and in '
                                     'order, over the transport of its mode; 1 otherwise.')
    parser.add_argument('--library', help=f'path of {bench.LIBRARY_NAME}; default: that of the same prefix')
    parser.add_argument('--modes', type=parse_modes, default=list(device_nodes.DEVICE_MODES.values()),
                        help='comma-separated, of ' + ', '.join(device_nodes.DEVICE_MODES))
    parser.add_argument('--rounds', type=parse_positive, help='alternating rounds (default 3; 1 with --quick)')
    parser.add_argument('--kills', type=parse_positive, help='SIGKILLs of bridges (default 100; 4 with --quick)')
    parser.add_argument('--frames', type=parse_positive, help='hostile frames (default 10000; 500 with --quick)')
    parser.add_argument('--only', action='append', choices=device_comparison.MEASURES,
                        help='measure only this; may be given more than once')
    parser.add_argument('--quick', action='store_true', help='a small subset, about 2 min')
    parser.add_argument('--json', metavar='FILE', help='write everything measured to FILE')
    parser.add_argument('--plot', metavar='FILE', help='draw bytes on the wire by subscribers, and latency, to FILE '
                        '(PNG)')
    # rosrun and roslaunch add remappings such as __name:=x.
    return parser.parse_args([argument for argument in arguments if ':=' not in argument])


def make_plan(options):
    make = device_comparison.DevicePlan.quick if options.quick else device_comparison.DevicePlan
    plan = make(modes=options.modes)
    for name in ('rounds', 'kills', 'frames'):
        if getattr(options, name):
            setattr(plan, name, getattr(options, name))
    if options.only:
        plan.measures = tuple(measure for measure in device_comparison.MEASURES if measure in options.only)
    return plan


def run(options):
    """@return what failed, as texts."""
    plan = make_plan(options)
    library = bench.find_library(options.library) if any(mode.preload for mode in plan.modes) else None
    if options.plot:
        bench.require_matplotlib()
    for path in filter(None, (options.json, options.plot)):
        folder = os.path.dirname(os.path.abspath(path))
        if not os.access(folder, os.W_OK):
            raise bench.BenchError(f'cannot write {path}: {folder} does not exist or is not writable')
    machine = bench.machine()
    command = 'rosrun pi_os_transport bench_devices ' + shlex.join(sys.argv[1:])
    begin = time.monotonic()
    comparison = device_comparison.DeviceComparison(plan, library,
                                                    lambda text: print(text, file=sys.stderr, flush=True))
    comparison.run()
    results = bench.Results(comparison.rows)

    print(f'\n{machine["cpu"]}, {machine["usable_cores"]} core(s), {machine["memory_gb"]} GB, '
          f'Linux {machine["kernel"]} {machine["architecture"]}, governor {machine["governor"]}, '
          f'load average at the start {machine["load_average"][0]:.2f}')
    print(', '.join(f'{name} {version}' for name, version in machine['versions'].items()))
    print(f'devices: network namespaces around a router, TCP {comparison.congestion_control}; {plan.rounds} round(s), '
          f'modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s\n{command}\n')
    print(device_report.report(results, plan.modes))
    if options.json:
        with open(options.json, 'w') as file:
            json.dump({'command': command, 'machine': machine, 'library': library, 'rounds': plan.rounds,
                       'congestion_control': comparison.congestion_control, 'rows': comparison.rows,
                       'failures': comparison.failures}, file, indent=1, ensure_ascii=False)
        print(f'\nwritten: {options.json}')
    if options.plot:
        device_report.plot(results, plan.modes, options.plot,
                           f'{machine["cpu"]}, {machine["usable_cores"]} core(s), Linux {machine["kernel"]}, '
                           f'median of {plan.rounds} round(s)')
        print(f'written: {options.plot}')
    return comparison.failures


def main():
    options = parse_arguments(sys.argv[1:])
    try:
        failures = run(options)
    except bench.BenchError as error:
        failures = [str(error)]
    except KeyboardInterrupt:
        print('bench_devices: interrupted', file=sys.stderr)
        return 130
    for failure in failures:
        print(f'bench_devices: FAILED: {failure}', file=sys.stderr)
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
