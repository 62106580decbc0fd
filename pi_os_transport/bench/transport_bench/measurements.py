"""What is measured of a group, and the plan that measures it over sizes, subscribers, modes and rounds."""

import contextlib
import dataclasses
import json
import os
import subprocess
import time

from . import small_messages
from .group import Group
from .modes import FULL_HD, environment, format_size, program_folder
from .nodes import EVENT_PREFIX

DEFAULT_SIZES = [64, 1000, 16000, 256000, 1000000, FULL_HD, 16000000]
DEFAULT_SUBSCRIBERS = [1, 2, 4, 8]


def percentile(values, percent):
    """Nearest-rank percentile; the maximum for 100."""
    ordered = sorted(values)
    rank = -(-len(ordered) * percent // 100)
    return ordered[max(int(rank), 1) - 1]


def rate_hz(size, subscribers=1):
    """Publishing rate for the latency runs: far below what stock TCPROS sustains, so that no queue builds up."""
    for limit, rate in ((16000, 500.0), (256000, 200.0), (1000000, 60.0), (FULL_HD, 30.0)):
        if size <= limit:
            break
    else:
        rate = 15.0
    return rate / 2 if size * subscribers > 32e6 else rate


def window_size(size):
    """Messages in flight in the throughput runs: about 8 MB, 4 to 512 messages."""
    return min(max(int(8e6 / size), 4), 512)


def measure_latency(group, size, seconds):
    """Latency and CPU time of one size at the fixed rate."""
    subscribers = len(group.subscribers)
    rate = rate_hz(size, subscribers)
    count = max(int(rate * seconds), 20)
    group.run(max(int(rate * 0.1), 5), size, rate)  # warm-up
    begin = time.monotonic()
    publisher, answers, cpu_ns = group.run(count, size, rate)
    wall_s = time.monotonic() - begin
    latencies_ns = [latency for answer in answers for latency in answer['latencies_ns']]
    last_ns = [max(row) for row in zip(*(answer['latencies_ns'] for answer in answers))]
    bench_cpu_ns = publisher['bench_cpu_ns'] + sum(answer['bench_cpu_ns'] for answer in answers)
    return {
        'measure': 'latency', 'mode': group.mode.key, 'subscribers': subscribers, 'size': size, 'rate_hz': rate,
        'messages': count, 'late': publisher['late'],
        'p50_us': percentile(latencies_ns, 50) / 1e3, 'p90_us': percentile(latencies_ns, 90) / 1e3,
        'p99_us': percentile(latencies_ns, 99) / 1e3, 'max_us': max(latencies_ns) / 1e3,
        'last_p50_us': percentile(last_ns, 50) / 1e3, 'publish_p50_us': publisher['publish_p50_ns'] / 1e3,
        'cpu_us': (cpu_ns - bench_cpu_ns) / count / 1e3, 'bench_cpu_us': bench_cpu_ns / count / 1e3, 'wall_s': wall_s,
    }


def measure_throughput(group, size, volume):
    """Back to back with a window of acknowledgements: nothing may be lost. Samples of every message are checked in the
    timed burst, every byte in an untimed one after it."""
    window = window_size(size)
    count = min(max(int(volume / size), 5 * window), 30000)
    group.run(max(count // 10, window), size, window=window, period=3, check='sample')  # warm-up
    publisher, answers, _ = group.run(count, size, window=window, period=3, check='sample')
    group.run(max(count // 4, window), size, window=window, period=3, check='full')
    seconds = (max(answer['last_ns'] for answer in answers) - publisher['start_ns']) / 1e9
    return {'measure': 'throughput', 'mode': group.mode.key, 'subscribers': len(group.subscribers), 'size': size,
            'messages': count, 'window': window, 'messages_per_s': count / seconds,
            'gigabytes_per_s': count * size / seconds / 1e9}


def measure_idle(groups, seconds):
    """CPU time and voluntary context switches of connected, idle nodes; all groups over the same interval."""
    for group in groups:
        group.run(10, 1000, 100.0)
    nodes = [(group, node) for group in groups for node in group.nodes]
    before = [(node.cpu_ns(), node.voluntary_switches()) for _, node in nodes]
    begin = time.monotonic()
    time.sleep(seconds)  # the interval over which idleness is measured
    after = [(node.cpu_ns(), node.voluntary_switches()) for _, node in nodes]
    wall_s = time.monotonic() - begin
    rows = []
    for group in groups:
        of_group = [i for i, (owner, _) in enumerate(nodes) if owner is group]
        rows.append({
            'measure': 'idle', 'mode': group.mode.key, 'seconds': wall_s,
            'cpu_percent': max((after[i][0] - before[i][0]) / wall_s / 1e7 for i in of_group),
            'switches_per_s': max((after[i][1] - before[i][1]) / wall_s for i in of_group)})
    return rows


def measure_memory(group, endpoints):
    """Private bytes of the nodes, and per further publisher and subscriber, each connected and used once."""
    publisher, subscriber = group.publisher, group.subscribers[0]
    group.doing = f'{endpoints} further publishers and subscribers'
    idle = {node: node.memory() for node in (publisher, subscriber)}
    publisher.tell('advertise', endpoints)
    subscriber.tell('listen', endpoints)
    group.await_events({publisher: 'advertised', subscriber: 'listening'}, group.answer_s)
    group.extra = endpoints
    group.await_links()
    connected = {node: node.memory() for node in (publisher, subscriber)}
    publisher.tell('touch', 1000)
    group.await_events({publisher: 'touched', subscriber: 'heard'}, group.answer_s)
    used = {node: node.memory() for node in (publisher, subscriber)}
    row = {'measure': 'memory', 'mode': group.mode.key, 'endpoints': endpoints}
    for name, node in (('publisher', publisher), ('subscriber', subscriber)):
        row[f'{name}_private_kb'] = idle[node]['private'] / 1e3
        row[f'{name}_pool_kb'] = idle[node]['pool'] / 1e3
        row[f'{name}_pool_used_kb'] = used[node]['pool'] / 1e3
        row[f'per_{name}_connected_kb'] = (connected[node]['private'] - idle[node]['private']) / endpoints / 1e3
        row[f'per_{name}_kb'] = (used[node]['private'] - idle[node]['private']) / endpoints / 1e3
    return row


def measure_copy_floor(cells):
    """Time of one serialisation and the deserialisations alone, for [(size, subscribers)], at the rate of the latency
    runs and, as warm_..., back to back."""
    command = [os.path.join(program_folder(), 'bench_copy_floor')]
    command += [f'{size}:{subscribers}:{rate_hz(size, subscribers)}' for size, subscribers in cells]
    output = subprocess.run(command, env=environment(), check=True, capture_output=True, text=True).stdout
    rows = []
    for line in output.splitlines():
        event = json.loads(line[len(EVENT_PREFIX):])
        rows.append({'measure': 'floor', 'size': event['size'], 'subscribers': event['subscribers'],
                     'workers': event['workers'],
                     **{prefix + field + '_us': event[run][key + '_ns'] / 1e3
                        for prefix, run in (('', 'paced'), ('warm_', 'warm'))
                        for field, key in (('serialise', 'serialise'), ('p50', 'each'), ('last_p50', 'last'))}})
    return rows


@dataclasses.dataclass
class Plan:
    """What one comparison measures."""
    modes: list
    rounds: int = 3
    sizes: list = dataclasses.field(default_factory=lambda: list(DEFAULT_SIZES))
    fan_out_sizes: list = dataclasses.field(default_factory=lambda: [1000000, FULL_HD])
    subscribers: list = dataclasses.field(default_factory=lambda: list(DEFAULT_SUBSCRIBERS))
    five_subscribers: bool = True  # the bars ask for five
    measures: tuple = ('latency', 'small', 'throughput', 'memory', 'cpu')
    latency_s: float = 1.2
    small_s: float = 2.0
    throughput_volume: float = 500e6
    idle_s: float = 3.0
    endpoints: int = 100

    def latency_cells(self):
        """[(subscribers, [sizes])]: every size with one subscriber, the fan-out sizes with each further number."""
        numbers = sorted(set(self.subscribers) | ({5} if self.five_subscribers else set()))
        cells = [(number, self.sizes if number == 1 else [s for s in self.fan_out_sizes if s in self.sizes])
                 for number in numbers]
        return [(number, sizes) for number, sizes in cells if sizes]


class Comparison:
    """Runs a plan; rows of all rounds collect in `rows`."""

    def __init__(self, plan, master, library=None, progress=lambda text: None):
        self.plan, self.master, self.library, self.progress = plan, master, library, progress
        self.rows = []
        self.warnings = []

    def run(self):
        for round_number in range(self.plan.rounds):
            shift = round_number % len(self.plan.modes)
            modes = self.plan.modes[shift:] + self.plan.modes[:shift]
            self.progress(f'round {round_number + 1} of {self.plan.rounds}: ' +
                          ', '.join(mode.label for mode in modes))
            if {'latency', 'cpu'} & set(self.plan.measures):
                self._traffic(round_number, modes)
            if 'small' in self.plan.measures:
                self.progress('  small messages')
                for row in small_messages.measure_all(self.master, modes, self.library, self.plan.small_s):
                    self._keep(round_number, row)
            if 'throughput' in self.plan.measures:
                self._throughput(round_number, modes)
            if {'memory', 'cpu'} & set(self.plan.measures):
                self._at_rest(round_number, [mode for mode in modes if mode.key != 'nodelay'])
        if 'latency' in self.plan.measures:
            self.progress('copy floor')
            cells = [(size, number) for number, sizes in self.plan.latency_cells() for size in sizes]
            self.rows += measure_copy_floor(cells)
        return self.rows

    @contextlib.contextmanager
    def _groups(self, modes, subscribers):
        """One group per mode, all alive at once, so that a cell can be measured in one mode right after another."""
        with contextlib.ExitStack() as stack:
            groups = [stack.enter_context(Group(self.master, mode, subscribers, self.library)) for mode in modes]
            yield groups
            for group in groups:
                group.verify_links()
                self.warnings += group.warnings()

    def _keep(self, round_number, row):
        self.rows.append({'round': round_number, **row})

    def _traffic(self, round_number, modes):
        for number, sizes in self.plan.latency_cells():
            with self._groups(modes, number) as groups:
                for size in sizes:
                    self.progress(f'  latency: {number} subscriber(s), {format_size(size)}')
                    for group in groups:
                        self._keep(round_number, measure_latency(group, size, self.plan.latency_s))

    def _throughput(self, round_number, modes):
        with self._groups(modes, 1) as groups:
            for size in self.plan.sizes:
                self.progress(f'  throughput: {format_size(size)}')
                for group in groups:
                    self._keep(round_number, measure_throughput(group, size, self.plan.throughput_volume))

    def _at_rest(self, round_number, modes):
        self.progress('  idle nodes, memory')
        with self._groups(modes, 1) as groups:
            for row in measure_idle(groups, self.plan.idle_s):
                self._keep(round_number, row)
            if 'memory' in self.plan.measures:
                for group in groups:
                    self._keep(round_number, measure_memory(group, self.plan.endpoints))
