"""What small messages cost at the rates of a vehicle's control loops: CPU time and context switches of each node."""

import contextlib
import dataclasses
import os
import statistics
import time

from .group import Group
from .modes import BenchError, format_size
from .output import format_number, format_ratio, format_table

SIZE = 64


@dataclasses.dataclass(frozen=True)
class Cell:
    """One publishing node and the nodes that subscribe to it."""
    rate_hz: float          # of each topic
    subscribers: int = 1    # with the library, if the mode has it
    outsiders: int = 0      # further ones, always without it
    topics: int = 1         # that each subscriber has; several are published in turn
    work_us: int = 0        # that the publisher computes before each message; not counted
    one_core: bool = False  # all nodes on one core, as when the others are busy

    @property
    def text(self):
        text = f'{self.rate_hz:g} Hz, {self.subscribers} subscriber' + ('s' if self.subscribers > 1 else '')
        if self.outsiders:
            text += f' and {self.outsiders} without the library'
        if self.topics > 1:
            text = f'{self.topics} topics of {text}'
        if self.work_us:
            text += f', after {self.work_us / 1000:g} ms of work'
        return text + ', on one core' if self.one_core else text


CELLS = [Cell(rate_hz, subscribers) for subscribers in (1, 3) for rate_hz in (50.0, 100.0, 200.0)]
CELLS += [Cell(50.0, topics=6)]
CELLS += [Cell(rate_hz, outsiders=1) for rate_hz in (50.0, 200.0)]
CELLS += [Cell(rate_hz, outsiders=1, work_us=1000, one_core=True) for rate_hz in (50.0, 200.0)]


def _heard(group, count):
    """Waits until the one subscriber of a group has had `count` messages of its further topics."""
    node = group.subscribers[0]
    deadline = time.monotonic() + group.answer_s
    heard = 0
    while heard < count:
        node.tell('report')
        heard = group.await_events({node: 'report'}, group.answer_s)[node]['heard']
        if time.monotonic() > deadline:
            raise BenchError(f'{group.describe()}: {heard} of {count} messages came')


def _several_topics(group, cell):
    """@return a function that publishes for some seconds and waits for the last message. @return of it: the number of
    messages, the nanoseconds of the benchmark itself per node, and no latencies."""
    publisher, subscriber = group.publisher, group.subscribers[0]
    publisher.tell('advertise', cell.topics)
    subscriber.tell('listen', cell.topics)
    group.await_events({publisher: 'advertised', subscriber: 'listening'}, group.answer_s)
    group.extra = cell.topics
    group.await_links()
    sent = 0

    def publish(duration_s):
        nonlocal sent
        count = max(int(cell.rate_hz * cell.topics * duration_s), cell.topics)
        publisher.tell('drip', count, SIZE, cell.rate_hz * cell.topics)
        group.await_events({publisher: 'dripped'}, group.answer_s + 2.0 * duration_s)
        sent += count
        _heard(group, sent)
        return count, {node: 0 for node in group.nodes}, {}
    return publish


def _one_topic(group, cell):
    def publish(duration_s):
        count = max(int(cell.rate_hz * duration_s), 5)
        publisher, answers, _ = group.run(count, SIZE, cell.rate_hz, work_us=cell.work_us)
        own_ns = {group.publisher: publisher['bench_cpu_ns'],
                  **{node: answer['bench_cpu_ns'] for node, answer in zip(group.subscribers, answers)}}
        parts = {'p50_us': answers[:cell.subscribers], 'outsider_p50_us': answers[cell.subscribers:]}
        return count, own_ns, {
            field: statistics.median(ns for answer in part for ns in answer['latencies_ns']) / 1e3
            for field, part in parts.items() if part}
    return publish


def measure(group, cell, seconds):
    """One cell: CPU time and context switches per message of the publisher and of each subscriber."""
    group.doing = f'{cell.text}, {format_size(SIZE)}'
    publish = _several_topics(group, cell) if cell.topics > 1 else _one_topic(group, cell)
    publish(0.2)  # warm-up
    before = {node: (node.cpu_ns(), node.voluntary_switches()) for node in group.nodes}
    count, own_ns, latencies = publish(seconds)
    cpu_us = {node: (node.cpu_ns() - before[node][0] - own_ns[node]) / count / 1e3 for node in group.nodes}
    switches = {node: (node.voluntary_switches() - before[node][1]) / count for node in group.nodes}
    inside = group.subscribers[:cell.subscribers]
    return {'measure': 'small', 'mode': group.mode.key, 'cell': cell.text, 'messages': count,
            'publisher_us': cpu_us[group.publisher], 'subscriber_us': statistics.mean(cpu_us[node] for node in inside),
            'all_us': sum(cpu_us.values()), 'publisher_switches': switches[group.publisher],
            'subscriber_switches': statistics.mean(switches[node] for node in inside),
            'p50_us': None, 'outsider_p50_us': None, **latencies}


@contextlib.contextmanager
def _cores(one):
    """What this thread starts meanwhile runs on one core, or on all it may use."""
    usable = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(usable)} if one else usable)
    try:
        yield
    finally:
        os.sched_setaffinity(0, usable)


def measure_all(master, modes, library, seconds, cells=tuple(CELLS)):
    """Yields a row per cell and mode; within a cell the modes follow one another."""
    for cell in cells:
        with contextlib.ExitStack() as stack:
            with _cores(cell.one_core):
                groups = [stack.enter_context(Group(master, mode, cell.subscribers, library, outsiders=cell.outsiders))
                          for mode in modes]
            for group in groups:
                yield measure(group, cell, seconds)
            for group in groups:
                group.verify_links()


def cells_of(results):
    return [cell.text for cell in CELLS if results.values('small', 'all_us', cell=cell.text)]


def table(results, modes):
    """The rows as text; empty without any."""
    rows = []
    for cell in cells_of(results):
        row = [cell]
        for mode in modes:
            row += ['/'.join(format_number(results.median('small', f'{end}_us', cell=cell, mode=mode.key))
                             for end in ('publisher', 'subscriber'))]
        row += [format_ratio(results.ratio('small', f'{end}_us', 'pi_os', 'tcpros', cell=cell))
                for end in ('publisher', 'subscriber', 'all')]
        for mode in modes:
            row += ['/'.join(format_number(results.median('small', f'{end}_switches', cell=cell, mode=mode.key))
                             for end in ('publisher', 'subscriber'))]
        for mode in modes:
            row += ['/'.join(format_number(value) for value in (
                results.median('small', field, cell=cell, mode=mode.key) for field in ('p50_us', 'outsider_p50_us'))
                if value is not None) or '-']
        rows.append(row)
    if not rows:
        return ''
    labels = [mode.label for mode in modes]
    return (f'Small messages ({format_size(SIZE)}): CPU time per message of the publishing node / of a subscribing '
            'node [us];\nπ-OS/TCPROS of the publisher, of a subscriber, of all nodes; voluntary context switches per '
            'message (publisher/subscriber); p50 of the latency (with the library/without) [us]\n' +
            format_table([''] + [f'CPU {label}' for label in labels] + ['publisher', 'subscriber', 'all nodes'] +
                         [f'switches {label}' for label in labels] + [f'p50 {label}' for label in labels], rows))
