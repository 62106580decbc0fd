#!/usr/bin/python3 -B
"""Zero-copy messages beside stock roscpp and a bare futex wake-up, alternating within one run.

Latency: publish() to callback at a fixed rate; every byte of a message is written before the clock starts. Throughput:
back to back, one subscriber that touches one byte of every page. The transport of every link is proved by getBusInfo.
Needs roscore's programs, no running master."""

import argparse
import contextlib
import queue
import statistics
import subprocess
import sys
import time

from transport_bench import program
from transport_bench.modes import BenchError, environment, find_library, format_size, program_folder
from transport_bench.nodes import Master, Node
from transport_bench.results import machine

SIZES = [64, 16384, 1000000, 6220800, 16000000]
THROUGHPUT_SIZE = 6220800
WINDOW = 4
DEADLINE_S = 60.0
FLAT = 0.2             # p50 of the sizes may differ by this much of the smallest message's
LATENCY_US = 25.0      # where the floor is at most FLOOR_US
FLOOR_US = 6.0
THROUGHPUT_GB_S = 10.0
FORMS = {  # name in the table: form of the nodes, preloaded, transport
    'TCPROS': ('stock', False, 'TCPROS'),
    'π-OS': ('stock', True, 'SHMROS'),
    'zero copy': ('zero_copy', True, 'SHMROS'),
}


class Pair:
    """A talker and a listener of one form."""

    serial = 0

    def __init__(self, master, name, library):
        form, preload, self.transport = FORMS[name]
        Pair.serial += 1
        self.master = master
        self.name = name
        self.namespace = f'/bench_zero_copy_{Pair.serial}'
        self.events = queue.Queue()
        env = environment({**master.env, **({'LD_PRELOAD': library} if preload else {})})
        self.nodes = []
        try:
            for role in ('talker', 'listener'):
                self.nodes.append(Node(self, role, 'bench_zero_copy_node', [role, form], env))
            for node in self.nodes:
                self.await_event(node, 'up')
            self.await_links()
        except BaseException:
            self.close()
            raise
        self.talker, self.listener = self.nodes

    def await_event(self, wanted_node, wanted):
        deadline = time.monotonic() + DEADLINE_S
        kept = []
        while True:
            try:
                node, event = self.events.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise BenchError(f'{self.name}: no "{wanted}" from {wanted_node.name} within {DEADLINE_S} s') from None
            if event['event'] in ('error', 'end'):
                raise BenchError(f'{node.name}: {event.get("text", "ended")} {node.error_output()[-500:]}')
            if node is wanted_node and event['event'] == wanted:
                for other in kept:
                    self.events.put(other)
                return event
            kept.append((node, event))

    def await_links(self):
        wanted = {(direction, self.transport, f'{self.namespace}/{topic}') for direction in 'io'
                  for topic in ('data', 'ack')}
        deadline = time.monotonic() + DEADLINE_S
        while True:
            links = {link for node in self.nodes for link in node.bus() if link[2].startswith(self.namespace)}
            if links == wanted:
                return
            if time.monotonic() > deadline:
                raise BenchError(f'{self.name}: links are {links}, must be {wanted}')
            time.sleep(0.01)  # the state of another process, without an event

    def run(self, expect, publish):
        self.listener.tell('expect', *expect)
        self.await_event(self.listener, 'ready')
        self.talker.tell(*publish)
        published = self.await_event(self.talker, 'published')
        complete = self.await_event(self.listener, 'complete')
        return published['ns'], complete['latencies_ns']

    def latency_us(self, count, size, rate):
        _, latencies = self.run((count, 0), ('latency', count, size, rate))
        self.await_links()
        return statistics.median(latencies) / 1e3

    def throughput_gb_s(self, count, size, fill):
        duration_ns, _ = self.run((count, 1), ('throughput', count, size, WINDOW, fill))
        self.await_links()
        return count * size / duration_ns

    def close(self):
        for node in self.nodes:
            with contextlib.suppress(BenchError):
                node.quit()


def floor_us(count, rate):
    node = f'{program_folder()}/bench_zero_copy_node'
    try:
        output = subprocess.run([node, 'floor', str(count), str(rate)], check=True, capture_output=True, text=True,
                                timeout=DEADLINE_S + count / rate).stdout
    except subprocess.SubprocessError as error:
        raise BenchError(f'{error} {(getattr(error, "stderr", None) or "")[-500:]}'.rstrip()) from error
    latencies = output.split('[')[1].split(']')[0].split(',')
    return statistics.median(int(value) for value in latencies) / 1e3


def spread(values, digits=3):
    return (f'{statistics.median(values):.{digits}g} ({min(values):.{digits}g}..{max(values):.{digits}g})')


def measure(options, library):
    """{(form, size): [p50 of each round]}, {(form, fill): [GB/s of each round]}; the floor is a form."""
    latencies = {}
    throughputs = {}
    names = list(FORMS)
    with Master() as master:
        for turn in range(options.rounds):
            order = names[turn % len(names):] + names[:turn % len(names)]
            for size in options.sizes:
                latencies.setdefault(('floor', size), []).append(floor_us(options.count, options.rate))
                for name in order:
                    pair = Pair(master, name, library)
                    with contextlib.closing(pair):
                        pair.latency_us(20, size, options.rate)  # the pool and the caches as they are later
                        latencies.setdefault((name, size), []).append(pair.latency_us(options.count, size, options.rate))
            for name in order:
                pair = Pair(master, name, library)
                with contextlib.closing(pair):
                    for fill in ('pages', 'all'):
                        pair.throughput_gb_s(20, THROUGHPUT_SIZE, fill)
                        throughputs.setdefault((name, fill), []).append(
                            pair.throughput_gb_s(options.count, THROUGHPUT_SIZE, fill))
    return latencies, throughputs


def report(options, latencies, throughputs):
    def ratios(numerator, denominator):
        return [a / b for a, b in zip(numerator, denominator)]

    print(f'\npublish() -> callback, p50 [us], and ratios: median of {options.rounds} rounds (min..max); '
          f'{options.count} messages at {options.rate:g} Hz')
    print(f'{"size":>7} | {"futex floor":^19} | {"TCPROS":^21} | {"π-OS":^19} | {"zero copy":^19} | '
          f'{"zero copy/floor":^19} | {"TCPROS/zero copy":^19}')
    for size in options.sizes:
        row = {name: latencies[name, size] for name in ['floor', *FORMS]}
        print(f'{format_size(size):>7} | {spread(row["floor"]):^19} | {spread(row["TCPROS"]):^21} | '
              f'{spread(row["π-OS"]):^19} | {spread(row["zero copy"]):^19} | '
              f'{spread(ratios(row["zero copy"], row["floor"])):^19} | '
              f'{spread(ratios(row["TCPROS"], row["zero copy"])):^19}')
    print(f'\nmessages of {format_size(THROUGHPUT_SIZE)} to one subscriber that touches every page, at most {WINDOW} '
          'ahead: payload [GB/s]')
    for fill, text in (('pages', 'one byte of every page written'), ('all', 'every byte written')):
        print(f'  {text:31} ' + '   '.join(f'{name}: {spread(throughputs[name, fill])}' for name in FORMS))

    print('\nBars')
    ours = {size: statistics.median(latencies['zero copy', size]) for size in options.sizes}
    over_floor = {size: statistics.median(ratios(latencies['zero copy', size], latencies['floor', size]))
                  for size in options.sizes}
    floor = statistics.median(value for size in options.sizes for value in latencies['floor', size])
    flat = max(ours.values()) / min(ours.values()) - 1
    rows = [(flat <= FLAT, f'p50 flat from {format_size(min(ours))} to {format_size(max(ours))}: differs by '
                           f'{100 * flat:.0f} %, bar {100 * FLAT:.0f} %')]
    if floor <= FLOOR_US:
        rows.append((max(ours.values()) <= LATENCY_US, f'p50 at most {max(ours.values()):.1f} us, bar '
                                                       f'{LATENCY_US:g} us'))
    else:
        rows.append((None, f'p50 at most {max(ours.values()):.1f} us; the bar of {LATENCY_US:g} us holds where a bare '
                           f'futex wake-up takes {FLOOR_US:g} us, here it takes {floor:.1f} us; at most '
                           f'{max(over_floor.values()):.2f} times the floor'))
    handed = statistics.median(throughputs['zero copy', 'pages'])
    rows.append((handed >= THROUGHPUT_GB_S, f'{handed:.3g} GB/s of {format_size(THROUGHPUT_SIZE)} messages handed over, '
                                            f'bar {THROUGHPUT_GB_S:g} GB/s'))
    for met, text in rows:
        print(f'  {"open  " if met is None else "met   " if met else "MISSED"} {text}')


def run(options):
    library = find_library(options.library)
    program.print_machine(machine())
    report(options, *measure(options, library))


def parse_arguments():
    parser = argparse.ArgumentParser(prog='bench_zero_copy', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog='Exit status: 0 when every message came over the transport of its form, '
                                     'whatever the bars say; 1 otherwise.')
    program.add_library(parser)
    parser.add_argument('--rounds', type=program.parse_positive, default=3, help='alternating rounds (default 3)')
    parser.add_argument('--count', type=program.parse_positive, default=100,
                        help='messages of each measurement (default 100)')
    parser.add_argument('--rate', type=float, default=30.0, help='of the latency measurements [Hz] (default 30)')
    parser.add_argument('--sizes', type=program.parse_list(program.parse_positive), default=SIZES,
                        help='payloads [B], comma-separated')
    return program.parse(parser)


if __name__ == '__main__':
    sys.exit(program.exit_status('bench_zero_copy', run, parse_arguments()))
