#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares stock TCPROS, TCPROS with tcpNoDelay and π-OS with bridges between devices, alternating in one run.

The devices are network namespaces of this machine (needs root), joined by a router whose cables are limited or cut.
"""

import argparse
import os
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import device_comparison, device_nodes, device_report, program  # noqa: E402


def parse_modes(text):
    unknown = [name for name in text.split(',') if name not in device_nodes.DEVICE_MODES]
    if unknown:
        raise argparse.ArgumentTypeError(f'mode {unknown[0]!r}, must be one of ' +
                                         ', '.join(device_nodes.DEVICE_MODES))
    return [device_nodes.DEVICE_MODES[name] for name in text.split(',')]


def parse_arguments():
    parser = argparse.ArgumentParser(prog='bench_devices', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog='Exit status: 0 when every message that had to arrive did so intact and in '
                                     'order, over the transport of its mode; 1 otherwise.')
    program.add_library(parser)
    parser.add_argument('--modes', type=parse_modes, default=list(device_nodes.DEVICE_MODES.values()),
                        help='comma-separated, of ' + ', '.join(device_nodes.DEVICE_MODES))
    parser.add_argument('--rounds', type=program.parse_positive, help='alternating rounds (default 3; 1 with --quick)')
    parser.add_argument('--kills', type=program.parse_positive, help='SIGKILLs of bridges (default 100; 4 with '
                        '--quick)')
    parser.add_argument('--frames', type=program.parse_positive, help='hostile frames (default 10000; 500 with '
                        '--quick)')
    parser.add_argument('--only', action='append', choices=device_comparison.MEASURES,
                        help='measure only this; may be given more than once')
    parser.add_argument('--quick', action='store_true', help='a small subset, about 2 min')
    program.add_json(parser)
    parser.add_argument('--plot', metavar='FILE', help='draw bytes on the wire by subscribers, and latency, to FILE '
                        '(PNG)')
    return program.parse(parser)


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
    program.require_writable(options.json, options.plot)
    machine = bench.machine()
    command = program.command('bench_devices')
    begin = time.monotonic()
    comparison = device_comparison.DeviceComparison(plan, library, program.progress)
    comparison.run()
    results = bench.Results(comparison.rows)

    program.print_machine(machine)
    print(f'devices: network namespaces around a router, TCP {comparison.congestion_control}; {plan.rounds} round(s), '
          f'modes alternating, order rotated per round; {time.monotonic() - begin:.0f} s\n{command}\n')
    print(device_report.report(results, plan.modes))
    program.write_json(options.json, {'command': command, 'machine': machine, 'library': library,
                                      'rounds': plan.rounds, 'congestion_control': comparison.congestion_control,
                                      'rows': comparison.rows, 'failures': comparison.failures})
    if options.plot:
        device_report.plot(results, plan.modes, options.plot,
                           f'{machine["cpu"]}, {machine["usable_cores"]} core(s), Linux {machine["kernel"]}, '
                           f'median of {plan.rounds} round(s)')
        print(f'written: {options.plot}')
    return comparison.failures


if __name__ == '__main__':
    sys.exit(program.exit_status('bench_devices', run, parse_arguments()))
