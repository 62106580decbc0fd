"""Compares transports between unmodified roscpp nodes: stock TCPROS, TCPROS with tcpNoDelay, and π-OS.

The nodes (bench_publisher, bench_subscriber) know only the topic API of roscpp; whether a round runs over π-OS is
decided by LD_PRELOAD alone and verified afterwards by getBusInfo of every node. Nodes are steered by lines on their
standard input and answer on standard output, so nothing here depends on timing: the script waits for answers, with
deadlines.
"""

import contextlib
import dataclasses
import json
import os
import platform
import queue
import re
import shutil
import signal
import socket
import statistics
import subprocess
import tempfile
import threading
import time
import xmlrpc.client

LIBRARY_NAME = 'libpi_os_transport.so'
EVENT_PREFIX = '@ '
CONNECT_DEADLINE_S = 20.0
QUIT_DEADLINE_S = 10.0
ANSWER_DEADLINE_S = 30.0  # beyond the time that the traffic itself takes
FULL_HD = 1920 * 1080 * 3
DEFAULT_SIZES = [64, 1000, 16000, 256000, 1000000, FULL_HD, 16000000]
DEFAULT_SUBSCRIBERS = [1, 2, 4, 8]


class BenchError(Exception):
    """The comparison is void: a message was lost, corrupt or out of order, a node died, or a transport was wrong."""


@dataclasses.dataclass(frozen=True)
class Mode:
    key: str              # in options and JSON
    label: str            # in tables
    transport: str        # what getBusInfo must say of every link
    preload: bool
    subscriber_args: tuple = ()


MODES = {mode.key: mode for mode in (
    Mode('tcpros', 'TCPROS', 'TCPROS', False),
    Mode('nodelay', 'tcpNoDelay', 'TCPROS', False, ('--tcp-no-delay',)),
    Mode('pi_os', 'π-OS', 'SHMROS', True),
)}


# --- where things are ------------------------------------------------------------------------------------------------

def program_folder():
    """Folder of bench_publisher and its siblings: that of this module, in the devel space as in the install space."""
    folder = os.path.dirname(os.path.realpath(__file__))
    if not os.access(os.path.join(folder, 'bench_publisher'), os.X_OK):
        raise BenchError(f'bench_publisher is not beside {__file__}: build the package and start bench_transport from '
                         'its devel or install space (rosrun pi_os_transport bench_transport)')
    return folder


def find_library(given=None):
    """Path of the library to preload: the one given, or the one of the prefix that this module was started from."""
    if given:
        candidates = [os.path.abspath(given)]
    else:
        prefixes = [os.path.dirname(os.path.dirname(program_folder()))]
        prefixes += [p for p in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if p]
        candidates = [os.path.join(prefix, 'lib', LIBRARY_NAME) for prefix in dict.fromkeys(prefixes)]
    for candidate in candidates:
        if os.path.isfile(candidate):
            return candidate
    raise BenchError(f'{LIBRARY_NAME} not found, looked for ' + ', '.join(candidates) +
                     '; build the package, name the file with --library, or leave π-OS out with --modes tcpros,nodelay')


# --- master and nodes ------------------------------------------------------------------------------------------------

def environment(extra=None):
    """Environment of the nodes: that of the caller without any preload of π-OS."""
    env = dict(os.environ)
    preload = [p for p in re.split(r'[:\s]+', env.pop('LD_PRELOAD', '')) if p and LIBRARY_NAME not in p]
    if preload:
        env['LD_PRELOAD'] = ':'.join(preload)
    env.update(extra or {})
    return env


def spawn(command, env, **kwargs):
    """Starts a process that the kernel ends together with this one and that Ctrl-C on the terminal does not reach."""
    setpriv = shutil.which('setpriv')
    preload = env.get('LD_PRELOAD')
    if setpriv:
        # env sets the preload, so that it reaches the node and no helper before it.
        command = [setpriv, '--pdeathsig', 'KILL', 'env'] + ([f'LD_PRELOAD={preload}'] if preload else []) + command
        env = {key: value for key, value in env.items() if key != 'LD_PRELOAD'}
    return subprocess.Popen(command, env=env, start_new_session=True, **kwargs)


class Master:
    """A rosmaster: an own one on a free port (own=True), else the one that ROS_MASTER_URI names."""

    def __init__(self, own=True):
        self.log_folder = tempfile.mkdtemp(prefix='bench_transport_')
        self.env = {'ROS_LOG_DIR': self.log_folder}
        self.process = None
        if own:
            with socket.socket() as probe:
                probe.bind(('localhost', 0))
                port = probe.getsockname()[1]
            self.uri = f'http://localhost:{port}/'
            self.env.update(ROS_MASTER_URI=self.uri, ROS_HOSTNAME='localhost')
            self.log = open(os.path.join(self.log_folder, 'rosmaster.out'), 'w+')
            self.process = spawn(['rosmaster', '--core', '-p', str(port)], environment(self.env),
                                 stdin=subprocess.DEVNULL, stdout=self.log, stderr=subprocess.STDOUT)
        else:
            self.uri = os.environ['ROS_MASTER_URI']
        self.proxy = xmlrpc.client.ServerProxy(self.uri)
        try:
            self._await_answer()
        except BaseException:
            self.close()
            raise

    def _await_answer(self):
        deadline = time.monotonic() + CONNECT_DEADLINE_S
        while True:
            try:
                self.proxy.getPid('/bench_transport')
                return
            except OSError as error:
                if self.process and self.process.poll() is not None:
                    self.log.seek(0)
                    raise BenchError(f'rosmaster ended with status {self.process.returncode}: {self.log.read()[-500:]}')
                if time.monotonic() > deadline:
                    raise BenchError(f'no master answers at {self.uri} within {CONNECT_DEADLINE_S} s: {error}')
                time.sleep(0.02)  # an external process that has no event to wait for

    def node_uri(self, name):
        code, text, uri = self.proxy.lookupNode('/bench_transport', name)
        if code != 1:
            raise BenchError(f'the master does not know node {name}: {text}')
        return uri

    def close(self):
        if self.process:
            self.process.terminate()
            try:
                self.process.wait(QUIT_DEADLINE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            self.log.close()
        shutil.rmtree(self.log_folder, ignore_errors=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Node:
    """One bench node. Its answers go into the queue of its group, as (node, event)."""

    def __init__(self, group, name, program, args, env):
        self.group = group
        self.name = f'{group.namespace}/{name}'
        self.stderr = tempfile.TemporaryFile('w+')
        command = [os.path.join(program_folder(), program), f'__ns:={group.namespace}', f'__name:={name}', *args]
        self.process = spawn(command, env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.stderr,
                             text=True)
        self.pid = self.process.pid
        self.proxy = None
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self):
        for line in self.process.stdout:
            if line.startswith(EVENT_PREFIX):
                self.group.events.put((self, json.loads(line[len(EVENT_PREFIX):])))
        self.group.events.put((self, {'event': 'end'}))

    def tell(self, *words):
        try:
            self.process.stdin.write(' '.join(str(word) for word in words) + '\n')
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # the reader reports the end of the process

    def error_output(self):
        self.stderr.seek(0)
        return self.stderr.read()

    def bus(self):
        """[(direction, transport, topic)] of all connected links."""
        if self.proxy is None:
            self.proxy = xmlrpc.client.ServerProxy(self.group.master.node_uri(self.name))
        _, _, info = self.proxy.getBusInfo('/bench_transport')
        return [(entry[2], entry[3], entry[4]) for entry in info if len(entry) < 6 or entry[5]]

    def cpu_ns(self):
        """CPU time of all threads so far, user and system [ns]; exact, unlike the ticks of /proc/PID/stat."""
        return time.clock_gettime_ns((~self.pid << 3) | 2)  # CLOCK_PROCESS_CPUTIME_ID of that process

    def voluntary_switches(self):
        total = 0
        for task in os.listdir(f'/proc/{self.pid}/task'):
            with open(f'/proc/{self.pid}/task/{task}/status') as status:
                total += int(re.search(r'^voluntary_ctxt_switches:\s*(\d+)', status.read(), re.M).group(1))
        return total

    def memory(self):
        """Private bytes without the pool, and resident bytes of the pool."""
        with open(f'/proc/{self.pid}/smaps') as smaps:
            return parse_smaps(smaps.read())

    def quit(self):
        self.tell('quit')
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(QUIT_DEADLINE_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise BenchError(f'{self.name} did not end within {QUIT_DEADLINE_S} s of being told to')
        if self.process.returncode != 0:
            raise BenchError(f'{self.name} ended with {describe_status(self.process.returncode)}: '
                             + self.error_output()[-1000:])

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def describe_status(code):
    return f'signal {signal.Signals(-code).name}' if code < 0 else f'status {code}'


def parse_smaps(text):
    """{'private': bytes without the pool, 'pool': resident bytes of the pool} from the text of /proc/PID/smaps."""
    private = pool = 0
    in_pool = False
    for line in text.splitlines():
        mapping = re.match(r'[0-9a-f]+-[0-9a-f]+ \S+ \S+ \S+ \d+\s*(.*)$', line)
        if mapping:
            in_pool = mapping.group(1).startswith('/memfd:pi_os')
            continue
        field = re.match(r'(\w+):\s+(\d+) kB', line)
        if field and field.group(1) in ('Private_Clean', 'Private_Dirty') and not in_pool:
            private += int(field.group(2)) * 1024
        elif field and field.group(1) == 'Rss' and in_pool:
            pool += int(field.group(2)) * 1024
    return {'private': private, 'pool': pool}


class Group:
    """One publisher and some subscribers in processes of their own, connected over the transport of one mode."""

    serial = 0

    def __init__(self, master, mode, subscribers, library=None, publisher_args=(), connect_s=CONNECT_DEADLINE_S,
                 answer_s=ANSWER_DEADLINE_S):
        Group.serial += 1
        self.connect_s, self.answer_s = connect_s, answer_s
        self.master, self.mode = master, mode
        self.namespace = f'/bench_{os.getpid()}_{Group.serial}'
        self.events = queue.Queue()
        self.nodes = []
        self.extra = 0
        self.pending = []
        self.subscribers = []
        self.doing = 'starting'
        env = environment(master.env)
        if mode.preload:
            env['LD_PRELOAD'] = ':'.join([library] + ([env['LD_PRELOAD']] if 'LD_PRELOAD' in env else []))
        try:
            self.publisher = self._start('publisher', 'bench_publisher', publisher_args, env)
            self.subscribers = [self._start(f'subscriber_{i}', 'bench_subscriber', mode.subscriber_args, env)
                                for i in range(subscribers)]
            self.await_events({node: 'up' for node in self.nodes}, self.connect_s)
            self.await_links()
        except BaseException:
            self.abandon()
            raise

    def _start(self, name, program, args, env):
        node = Node(self, name, program, list(args), env)
        self.nodes.append(node)
        return node

    def await_events(self, wanted, timeout_s):
        """Waits for one event of each node in {node: event name}. @return {node: event}. An error event of any node,
        or the end of one, raises at once."""
        answers = {}
        deadline = time.monotonic() + timeout_s
        while len(answers) < len(wanted):
            if self.pending:
                node, event = self.pending.pop(0)
            else:
                try:
                    node, event = self.events.get(timeout=max(deadline - time.monotonic(), 0.0))
                except queue.Empty:
                    missing = [f'{node.name} ({name})' for node, name in wanted.items() if node not in answers]
                    raise BenchError(f'{self.describe()}: no answer within {timeout_s:.0f} s from ' +
                                     ', '.join(missing) + self._received_text()) from None
            if event['event'] == 'error':
                raise BenchError(f'{self.describe()}: {node.name}: {event["text"]}')
            if event['event'] == 'end':
                node.process.wait()
                raise BenchError(f'{self.describe()}: {node.name} ended with '
                                 f'{describe_status(node.process.returncode)}: {node.error_output()[-1000:]}')
            if wanted.get(node) == event['event']:
                answers[node] = event
        return answers

    def _received_text(self):
        """How many messages each subscriber has, for the message about a time-out."""
        texts = []
        for node in self.subscribers:
            node.tell('report')
        deadline = time.monotonic() + 2.0
        with contextlib.suppress(queue.Empty):
            while len(texts) < len(self.subscribers):
                node, event = self.events.get(timeout=max(deadline - time.monotonic(), 0.0))
                if event['event'] == 'report':
                    texts.append(f'{node.name} has received {event["received"]} messages')
        return '; lost messages? ' + ', '.join(texts) if texts else ''

    def describe(self):
        return f'{self.mode.label}, {self.doing}'

    def expected_links(self):
        count = len(self.subscribers)
        data, ack = self.namespace + '/data', self.namespace + '/ack'
        expected = {self.publisher: [('o', data)] * count + [('i', ack)] * count}
        for node in self.subscribers:
            expected[node] = [('i', data), ('o', ack)]
        extra = [f'{self.namespace}/extra_{i}' for i in range(self.extra)]
        expected[self.publisher] += [('o', topic) for topic in extra]
        if extra:
            expected[self.subscribers[0]] += [('i', topic) for topic in extra]
        return expected

    def wrong_links(self):
        """What differs from 'every link is connected over the transport of the mode', as text; empty if nothing."""
        for node, expected in self.expected_links().items():
            links = [link for link in node.bus() if link[2].startswith(self.namespace)]
            wanted = sorted((direction, self.mode.transport, topic) for direction, topic in expected)
            if sorted(links) != wanted:
                missing = [f'{d} {topic} {transport}' for d, transport, topic in wanted
                           if (d, transport, topic) not in links]
                return (f'{node.name}: {len(links)} links, {len(wanted)} expected over {self.mode.transport}; ' +
                        f'missing {", ".join(missing[:4])}; there are ' +
                        ', '.join(f'{d} {topic} {transport}' for d, transport, topic in links[:4]))
        return ''

    def await_links(self):
        """Waits until getBusInfo of every node shows all links on the mode's transport."""
        deadline = time.monotonic() + self.connect_s
        while True:
            wrong = self.wrong_links()
            if not wrong:
                return
            with contextlib.suppress(queue.Empty):
                node, event = self.events.get_nowait()
                if event['event'] == 'end':
                    node.process.wait()
                    raise BenchError(f'{self.describe()}: {node.name} ended while connecting: ' +
                                     node.error_output()[-1000:])
                self.pending.append((node, event))
            if time.monotonic() > deadline:
                output = ' '.join(node.error_output()[-300:] for node in self.nodes)
                raise BenchError(f'{self.describe()}: not connected as required within {self.connect_s:.0f} s: '
                                 f'{wrong}. {output}')
            time.sleep(0.01)  # an external condition without an event: the state of another process

    def verify_links(self):
        """Raises unless the links are still what they were: a silent fall-back would falsify the comparison."""
        wrong = self.wrong_links()
        if wrong:
            raise BenchError(f'{self.describe()}: the transport changed during the run: {wrong}')

    def run(self, count, size, rate_hz=0.0, window=0, period=4093, check='full'):
        """Publishes `count` messages and waits until every subscriber has received and checked them.
        @return (the publisher's answer, [each subscriber's answer], CPU time of all processes [ns])"""
        self.doing = f'{len(self.subscribers)} subscriber(s), {format_size(size)}'
        for node in self.subscribers:
            node.tell('expect', count, size, check, window, period)
        self.await_events({node: 'ready' for node in self.subscribers}, self.answer_s)
        cpu_before_ns = [node.cpu_ns() for node in self.nodes]
        self.publisher.tell('run', count, size, rate_hz, window, period)
        wanted = {self.publisher: 'done', **{node: 'complete' for node in self.subscribers}}
        answers = self.await_events(wanted, self.answer_s + (2.0 * count / rate_hz if rate_hz else 0.0))
        cpu_ns = sum(node.cpu_ns() - before for node, before in zip(self.nodes, cpu_before_ns))
        return answers[self.publisher], [answers[node] for node in self.subscribers], cpu_ns

    def warnings(self):
        """What the nodes wrote to standard error, one text per node that wrote anything."""
        return [f'{node.name}: {text.strip()}' for node in self.nodes for text in [node.error_output()] if text.strip()]

    def close(self):
        try:
            for node in self.nodes:
                node.tell('quit')
            for node in self.nodes:
                node.quit()
        finally:
            self.abandon()

    def abandon(self):
        for node in self.nodes:
            node.kill()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.close() if kind is None else self.abandon()


# --- measurements ----------------------------------------------------------------------------------------------------

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
    measures: tuple = ('latency', 'throughput', 'memory', 'cpu')
    latency_s: float = 1.2
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


# --- results ---------------------------------------------------------------------------------------------------------

def format_size(size):
    if size == FULL_HD:
        return '6.2 MB'
    for unit, factor in (('MB', 1e6), ('kB', 1e3)):
        if size >= factor:
            return f'{size / factor:.3g} {unit}'
    return f'{size} B'


class Results:
    """Medians and ratios over the rows of a comparison."""

    def __init__(self, rows):
        self.rows = rows

    def values(self, measure, field, **match):
        """{round: value}"""
        return {row.get('round', 0): row[field] for row in self.rows
                if row['measure'] == measure and all(row.get(key) == value for key, value in match.items())}

    def median(self, measure, field, **match):
        values = self.values(measure, field, **match)
        return statistics.median(values.values()) if values else None

    def ratio(self, measure, field, over, under, **match):
        """Median, minimum and maximum of the per-round ratios mode `over` / mode `under`; None without both."""
        top = self.values(measure, field, mode=over, **match)
        bottom = self.values(measure, field, mode=under, **match)
        ratios = [top[r] / bottom[r] for r in sorted(top.keys() & bottom.keys()) if bottom[r] > 0]
        return (statistics.median(ratios), min(ratios), max(ratios)) if ratios else None

    def difference(self, measure, field, minuend, subtrahend, **match):
        """As ratio(), of the per-round differences."""
        top = self.values(measure, field, mode=minuend, **match)
        bottom = self.values(measure, field, mode=subtrahend, **match)
        values = [top[r] - bottom[r] for r in sorted(top.keys() & bottom.keys())]
        return (statistics.median(values), min(values), max(values)) if values else None

    def sizes(self, measure, subscribers):
        return sorted({row['size'] for row in self.rows
                       if row['measure'] == measure and row['subscribers'] == subscribers})

    def fan_outs(self, measure):
        return sorted({row['subscribers'] for row in self.rows if row['measure'] == measure})


@dataclasses.dataclass
class Bar:
    """One requirement and what was measured."""
    text: str
    value: tuple           # median, minimum, maximum over the rounds
    bound: float
    at_least: bool
    unit: str = ''
    note: str = ''

    def met(self):
        return self.value[0] >= self.bound if self.at_least else self.value[0] <= self.bound

    def line(self):
        value, low, high = (number + 0.0 if abs(number) >= 5e-4 else 0.0 for number in self.value)  # no -0.000
        relation = '>=' if self.at_least else '<='
        digits = 1 if self.unit == ' kB' else 2 if self.at_least else 3
        return (f'{"met   " if self.met() else "MISSED"}  {self.text} = {value:.{digits}f}{self.unit} '
                f'(spread {low:.{digits}f}..{high:.{digits}f}), bar {relation} {self.bound:g}{self.unit}'
                + (f'; {self.note}' if self.note else ''))


def bars(results):
    """The requirements that the rows can decide."""
    found = []

    def add(text, value, *args, **kwargs):
        if value:
            found.append(Bar(text, value, *args, **kwargs))

    for size, bound in ((64, 1.2), (1000000, 3.0), (FULL_HD, 4.0)):
        add(f'{format_size(size)}, 1 subscriber: p50 TCPROS(tcpNoDelay)/π-OS',
            results.ratio('latency', 'p50_us', 'nodelay', 'pi_os', size=size, subscribers=1), bound, True)
    five = {'size': 1000000, 'subscribers': 5}
    note = ''
    floor = results.median('floor', 'p50_us', **five)
    latency = results.median('latency', 'p50_us', mode='pi_os', **five)
    if floor and latency:
        workers = results.median('floor', 'workers', **five)
        note = (f'floor (1 serialisation, 5 deserialisations on {workers:g} core(s)) {floor:.0f} us, '
                f'π-OS {latency:.0f} us = {latency / floor:.1f} x floor')
    add('1 MB, 5 subscribers: p50 TCPROS(tcpNoDelay)/π-OS',
        results.ratio('latency', 'p50_us', 'nodelay', 'pi_os', **five), 4.0, True, note=note)
    for size, subscribers, bound in ((1000000, 1, 0.5), (FULL_HD, 5, 1 / 3)):
        add(f'{format_size(size)}, {subscribers} subscriber(s): CPU per message π-OS/TCPROS',
            results.ratio('latency', 'cpu_us', 'pi_os', 'tcpros', size=size, subscribers=subscribers),
            round(bound, 3), False)
    add('idle node: CPU added', results.difference('idle', 'cpu_percent', 'pi_os', 'tcpros'), 0.05, False, ' %',
        'of one core; 0 % when rounded to 0.1')
    added = [results.difference('memory', f'{name}_private_kb', 'pi_os', 'tcpros')
             for name in ('publisher', 'subscriber')]
    if all(added):
        add('node: private memory added by the library', max(added), 300.0, False, ' kB', 'pool apart')
    for name in ('publisher', 'subscriber'):
        field = f'per_{name}_kb'
        note = ''
        if results.values('memory', field, mode='pi_os'):
            note = (f'pool apart; in all {results.median("memory", field, mode="pi_os"):.1f} kB, stock '
                    f'{results.median("memory", field, mode="tcpros") or 0.0:.1f} kB')
        add(f'each further {name}: private memory added by the library',
            results.difference('memory', field, 'pi_os', 'tcpros'), 10.0, False, ' kB', note)
    return found


def machine():
    """What a reader needs to judge the figures."""
    def read(path, default='not exposed'):
        try:
            with open(path) as file:
                return file.read().strip()
        except OSError:
            return default

    model = re.search(r'^(?:model name|Model)\s*:\s*(.*)$', read('/proc/cpuinfo', ''), re.M)
    memory = re.search(r'^MemTotal:\s*(\d+)', read('/proc/meminfo', ''), re.M)
    versions = {}
    for package in ('roscpp', 'pi_os_transport'):
        with contextlib.suppress(OSError):
            found = subprocess.run(['rosversion', package], capture_output=True, text=True)
            versions[package] = found.stdout.strip() if found.returncode == 0 else 'unknown'
    return {
        'cpu': model.group(1) if model else platform.processor(), 'cores': os.cpu_count(),
        'usable_cores': len(os.sched_getaffinity(0)),
        'memory_gb': round(int(memory.group(1)) / 1e6, 1) if memory else 0,
        'architecture': platform.machine(), 'kernel': platform.release(),
        'governor': read('/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor'),
        'load_average': list(os.getloadavg()), 'versions': versions,
        'settings': {key: value for key, value in sorted(os.environ.items()) if key.startswith('PI_OS_')},
    }


def format_table(header, rows):
    widths = [max(len(str(row[i])) for row in [header] + rows) for i in range(len(header))]
    lines = ['  '.join(str(cell).rjust(width) for cell, width in zip(row, widths)) for row in [header] + rows]
    return '\n'.join([lines[0], '-' * len(lines[0])] + lines[1:])


def format_number(value):
    if value is None:
        return '-'
    return f'{value:.0f}' if value >= 100 else f'{value:.1f}' if value >= 10 else f'{value:.2f}'


def format_ratio(ratio):
    return '-' if ratio is None else f'{ratio[0]:.2f} ({ratio[1]:.2f}..{ratio[2]:.2f})'


def report(results, modes):
    """All tables as one text."""
    texts = []
    labels = [mode.label for mode in modes]
    fan_outs = results.fan_outs('latency')
    if fan_outs:
        rows, cpu_rows = [], []
        for subscribers in fan_outs:
            for size in results.sizes('latency', subscribers):
                match = {'size': size, 'subscribers': subscribers}
                cells = [format_size(size), subscribers, format_number(results.median('latency', 'rate_hz', **match))]
                for mode in modes:
                    cells.append('/'.join(format_number(results.median('latency', f'{p}_us', mode=mode.key, **match))
                                          for p in ('p50', 'p90', 'p99', 'max')))
                floor = results.median('floor', 'p50_us', **match)
                latency = results.median('latency', 'p50_us', mode='pi_os', **match)
                rows.append(cells + [format_ratio(results.ratio('latency', 'p50_us', 'tcpros', 'pi_os', **match)),
                                     format_ratio(results.ratio('latency', 'p50_us', 'nodelay', 'pi_os', **match)),
                                     format_number(results.median('floor', 'warm_p50_us', **match)),
                                     format_number(floor),
                                     format_number(latency / floor if latency and floor else None)])
                cpu = [format_size(size), subscribers]
                cpu += [format_number(results.median('latency', 'cpu_us', mode=mode.key, **match)) for mode in modes]
                cpu += [format_ratio(results.ratio('latency', 'cpu_us', 'pi_os', 'tcpros', **match))]
                cpu += [format_number(results.median('latency', 'last_p50_us', mode=mode.key, **match))
                        for mode in modes]
                cpu += [format_number(results.median('latency', 'publish_p50_us', mode=mode.key, **match))
                        for mode in modes]
                cpu_rows.append(cpu)
        texts.append('Latency publish() -> callback, p50/p90/p99/max [us] over all subscribers; ratios of p50, median '
                     'of the rounds (min..max);\nfloor: p50 of one serialisation and the deserialisations alone, '
                     'spread over the cores, at the same rate (warm: back to back) [us]\n' +
                     format_table(['size', 'subs', 'Hz'] + labels +
                                  ['TCPROS/π-OS', 'tcpNoDelay/π-OS', 'warm floor', 'floor', 'π-OS/floor'], rows))
        texts.append('CPU time per message, all processes together, without the benchmark\'s own filling and '
                     'checking [us];\np50 until the last subscriber has the message [us]; '
                     'p50 of publish() itself [us]\n' +
                     format_table(['size', 'subs'] + [f'CPU {label}' for label in labels] + ['CPU π-OS/TCPROS'] +
                                  [f'last {label}' for label in labels] + [f'publish {label}' for label in labels],
                                  cpu_rows))
        behind = [f'{MODES[row["mode"]].label} {format_size(row["size"])} to {row["subscribers"]}: {row["late"]} of '
                  f'{row["messages"]}' for row in results.rows
                  if row['measure'] == 'latency' and row['late'] > 0.05 * row['messages']]
        if behind:
            texts.append('The publisher fell behind its rate by more than one interval: ' + '; '.join(behind))
    for subscribers in results.fan_outs('throughput'):
        rows = []
        for size in results.sizes('throughput', subscribers):
            match = {'size': size, 'subscribers': subscribers}
            cells = [format_size(size), format_number(results.median('throughput', 'window', **match))]
            for mode in modes:
                cells += [format_number(results.median('throughput', 'messages_per_s', mode=mode.key, **match)),
                          format_number(results.median('throughput', 'gigabytes_per_s', mode=mode.key, **match))]
            rows.append(cells + [format_ratio(results.ratio('throughput', 'messages_per_s', 'pi_os', stock, **match))
                                 for stock in ('tcpros', 'nodelay')])
        header = ['size', 'window'] + [text for label in labels for text in (f'{label} msg/s', 'GB/s')]
        texts.append(f'Throughput, {subscribers} subscriber(s), back to back, at most `window` messages ahead of the '
                     'subscriber\'s acknowledgements\n' +
                     format_table(header + ['π-OS/TCPROS', 'π-OS/tcpNoDelay'], rows))
    rest = [mode for mode in modes if results.values('idle', 'cpu_percent', mode=mode.key)]
    if rest:
        fields = [('idle', 'cpu_percent', 'idle, connected: CPU of one core [%]'),
                  ('idle', 'switches_per_s', 'idle, connected: voluntary context switches [1/s]')]
        for name in ('publisher', 'subscriber'):
            fields += [('memory', f'{name}_private_kb', f'{name} node: private memory [kB]'),
                       ('memory', f'{name}_pool_kb', f'{name} node: pool, resident [kB]'),
                       ('memory', f'{name}_pool_used_kb', f'{name} node: pool after the further ones [kB]'),
                       ('memory', f'per_{name}_connected_kb', f'per further {name}, connected: private [kB]'),
                       ('memory', f'per_{name}_kb', f'per further {name}, used once: private [kB]')]
        rows = [[text.ljust(max(len(t) for _, _, t in fields))] +
                [format_number(results.median(measure, field, mode=mode.key)) for mode in rest] +
                [format_ratio(results.difference(measure, field, 'pi_os', 'tcpros'))]
                for measure, field, text in fields if results.values(measure, field)]
        texts.append('Nodes at rest\n' + format_table([''] + [mode.label for mode in rest] + ['π-OS - TCPROS'], rows))
    return '\n\n'.join(texts)


def require_matplotlib():
    try:
        import matplotlib
    except ImportError:
        raise BenchError('--plot needs matplotlib: apt-get install python3-matplotlib') from None
    return matplotlib


def plot(results, modes, path, subtitle):
    """Latency by size and by number of subscribers as PNG."""
    require_matplotlib().use('Agg')
    from matplotlib import pyplot

    styles = {'tcpros': ('tab:red', 'o'), 'nodelay': ('tab:orange', 's'), 'pi_os': ('tab:blue', '^')}
    figure, (by_size, by_number) = pyplot.subplots(1, 2, figsize=(13, 5.2))
    sizes = results.sizes('latency', 1)
    for mode in modes:
        color, marker = styles[mode.key]
        for field, style, alpha in (('p50_us', '-', 1.0), ('p99_us', ':', 0.6)):
            values = [results.median('latency', field, mode=mode.key, size=size, subscribers=1) for size in sizes]
            by_size.plot(sizes, values, style, color=color, marker=marker, alpha=alpha, markersize=4,
                         label=f'{mode.label}, {field[:3]}')
    floors = [results.median('floor', 'p50_us', size=size, subscribers=1) for size in sizes]
    if all(floors):
        by_size.plot(sizes, floors, '--', color='gray', label='copy floor')
    by_size.set(xscale='log', yscale='log', xlabel='payload [bytes]', ylabel='latency publish() to callback [us]',
                title='one subscriber')
    fan_outs = results.fan_outs('latency')
    fan_out_sizes = sorted({size for number in fan_outs if number > 1 for size in results.sizes('latency', number)})
    for style, size in zip(('-', '--', '-.', ':'), fan_out_sizes):
        for mode in modes:
            color, marker = styles[mode.key]
            numbers = [n for n in fan_outs if size in results.sizes('latency', n)]
            values = [results.median('latency', 'p50_us', mode=mode.key, size=size, subscribers=n) for n in numbers]
            by_number.plot(numbers, values, style, color=color, marker=marker, markersize=4,
                           label=f'{mode.label}, {format_size(size)}')
    by_number.set(yscale='log', xlabel='subscribers', ylabel='p50 latency [us]', title='by number of subscribers',
                  xticks=fan_outs)
    for axes in (by_size, by_number):
        axes.grid(True, which='both', alpha=0.25)
        if axes.lines:
            axes.legend(fontsize=8, loc='upper left', ncol=2 if axes is by_number else 1)
    figure.suptitle(subtitle, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
