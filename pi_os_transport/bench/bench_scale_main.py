#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""The graph of a whole vehicle, 60 nodes with 600 topics and 1,500 links, images and inertial measurements among them,
over TCPROS and over π-OS, alternating: what arrives, CPU, memory, descriptors, time to start and to end."""

import argparse
import os
import statistics
import sys
import time

sys.path.insert(0, os.path.dirname(os.path.realpath(__file__)))  # of the modules, too
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import fleet, output, program  # noqa: E402

COLUMNS = (('links up after [s]', 'start_s'), ('received', 'received'), ('missing', 'missing'),
           ('repeated', 'repeated'), ('damaged', 'damaged'), ('latency, mean [us]', 'latency_us'),
           ('latency, worst [ms]', 'slowest_ms'), ('CPU [cores]', 'cpu'), ('memory, begin [MB]', 'memory_begin_mb'),
           ('memory, end [MB]', 'memory_mb'), ('descriptors, all', 'descriptors'),
           ('descriptors, most of a node', 'descriptors_most'), ('all ended after [s]', 'end_s'))


def parse_arguments():
    parser = argparse.ArgumentParser(prog='bench_scale', description=__doc__,
                                     epilog='Exit status: 0 if every message arrived once and undamaged.')
    parser.add_argument('--nodes', type=program.parse_positive, default=60)
    parser.add_argument('--topics', type=program.parse_positive, default=600)
    parser.add_argument('--links', type=program.parse_positive, default=1500)
    parser.add_argument('--seconds', type=program.parse_positive, default=30, help='of traffic, of each mode and round')
    parser.add_argument('--rounds', type=program.parse_positive, default=1)
    parser.add_argument('--modes', type=program.parse_list(str), default=['tcpros', 'pi_os'],
                        help='of: ' + ', '.join(bench.MODES))
    program.add_library(parser)
    program.add_json(parser)
    options = program.parse(parser)
    unknown = [mode for mode in options.modes if mode not in bench.MODES]
    if unknown:
        parser.error(f'--modes: {unknown[0]!r} is none of {", ".join(bench.MODES)}')
    if options.nodes < 2 or options.links > options.topics * (options.nodes - 1):
        parser.error(f'--nodes {options.nodes} --topics {options.topics} --links {options.links}: at least two nodes, '
                     'and no node subscribes twice to a topic or to its own')
    return options


def measure(master, mode, options, library):
    flows = fleet.plan_flows(options.nodes, options.topics, options.links)
    group = fleet.Fleet(master, mode, flows, options.nodes, library)
    try:
        group.start()
        memory_begin_mb = group.memory_mb()
        cpu_ns, begin = group.cpu_ns(), time.monotonic()
        time.sleep(options.seconds)  # the traffic that is measured
        row = {'mode': mode.key, 'start_s': group.start_s, 'memory_begin_mb': memory_begin_mb,
               'cpu': (group.cpu_ns() - cpu_ns) / 1e9 / (time.monotonic() - begin), 'memory_mb': group.memory_mb()}
        counts = [sum(kinds.values()) for kinds in group.descriptors()]
        row.update(descriptors=sum(counts), descriptors_most=max(counts), **group.stop())
        row['end_s'] = group.close()
        return row
    except BaseException:
        group.abandon()
        raise


def run(options):
    modes = [bench.MODES[key] for key in options.modes]
    library = bench.find_library(options.library) if any(mode.preload for mode in modes) else None
    program.require_writable(options.json)
    machine = bench.machine()
    rows = []
    for number in range(options.rounds):
        for mode in modes if number % 2 == 0 else reversed(modes):
            program.progress(f'round {number + 1}: {mode.label}')
            with bench.Master() as master:
                rows.append(measure(master, mode, options, library))
    program.print_machine(machine)
    command = program.command('bench_scale')
    print(f'{options.nodes} nodes, {options.topics} topics, {options.links} links, {options.seconds} s of traffic, '
          f'{options.rounds} round(s), medians\n{command}\n')
    table = [[text] + [output.format_number(statistics.median(row[key] for row in rows if row['mode'] == mode.key))
                       for mode in modes] for text, key in COLUMNS]
    print(output.format_table([''] + [mode.label for mode in modes], table))
    program.write_json(options.json, {'command': command, 'machine': machine, 'rows': rows})
    return [f'{row["mode"]}: {row[key]} messages {key}' for row in rows for key in ('missing', 'repeated', 'damaged')
            if row[key]]


if __name__ == '__main__':
    sys.exit(program.exit_status('bench_scale', run, parse_arguments()))
