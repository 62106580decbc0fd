"""A whole vehicle's graph: many nodes, each with many topics, in processes of their own."""

import collections
import contextlib
import dataclasses
import os
import queue
import random
import re
import time

from .modes import BenchError, environment
from .nodes import Node, describe_status, kill_all, quit_all

START_DEADLINE_S = 120.0
ANSWER_DEADLINE_S = 60.0
POLL_S = 0.05
SEED = 1


@dataclasses.dataclass(frozen=True)
class Flow:
    """A topic, the node that publishes it, and the nodes that subscribe to it."""
    topic: str
    size: int
    rate_hz: float
    queue: int
    publisher: int
    subscribers: tuple


def plan_flows(nodes, topics, links):
    """Images, inertial measurements and some state at usual rates, and many topics that are seldom published."""
    kinds = ([(921600, 10.0, 10)] * max(topics // 150, 1) +  # 640x480 in colour
             [(320, 200.0, 400)] * max(topics // 300, 1) +
             [(1000, 20.0, 100)] * max(topics // 40, 1))
    kinds += [(100, 1.0, 20)] * (topics - len(kinds))
    chosen = random.Random(SEED)
    flows = []
    for number, (size, rate_hz, depth) in enumerate(kinds):
        publisher = number % nodes
        count = links * (number + 1) // topics - links * number // topics
        others = [node for node in range(nodes) if node != publisher]
        flows.append(Flow(f'topic_{number}', size, rate_hz, depth, publisher, tuple(chosen.sample(others, count))))
    return flows


class Fleet:
    """The nodes of some flows, connected over the transport of one mode."""

    def __init__(self, master, mode, flows, nodes, library=None):
        self.master, self.mode, self.flows = master, mode, flows
        self.namespace = f'/scale_{os.getpid()}_{mode.key}_{time.monotonic_ns()}'
        self.events = queue.Queue()
        self.nodes = []
        begin = time.monotonic()
        env = environment(master.env)
        if mode.preload:
            env['LD_PRELOAD'] = ':'.join([library] + ([env['LD_PRELOAD']] if 'LD_PRELOAD' in env else []))
        try:
            for number in range(nodes):
                self.nodes.append(Node(self, f'node_{number}', 'bench_flow', mode.subscriber_args, env))
            self._await_answers({node: 1 for node in self.nodes}, START_DEADLINE_S)
            self.ask('advertise', {node: [('advertise', flow.topic, flow.size, flow.queue)
                                          for flow in flows if self.nodes[flow.publisher] is node]
                                   for node in self.nodes})
            self.ask('count', self._subscriptions('count', lambda flow: (flow.size, flow.queue)))
            self._await_links()
        except BaseException:
            self.abandon()
            raise
        self.start_s = time.monotonic() - begin

    def _subscriptions(self, command, words=lambda flow: ()):
        asked = {node: [] for node in self.nodes}
        for flow in self.flows:
            for subscriber in flow.subscribers:
                asked[self.nodes[subscriber]].append((command, flow.topic) + tuple(words(flow)))
        return asked

    def _publications(self, command, words=lambda flow: ()):
        asked = {node: [] for node in self.nodes}
        for flow in self.flows:
            asked[self.nodes[flow.publisher]].append((command, flow.topic) + tuple(words(flow)))
        return asked

    def _await_answers(self, counts, timeout_s):
        """@param counts  {node: number of answers}. @return {node: [answers]}, in the order of the questions."""
        answers = {node: [] for node in counts}
        missing = sum(counts.values())
        deadline = time.monotonic() + timeout_s
        while missing > 0:
            try:
                node, event = self.events.get(timeout=max(deadline - time.monotonic(), 0.0))
            except queue.Empty:
                silent = [node.name for node in counts if len(answers[node]) < counts[node]]
                raise BenchError(f'{self.mode.label}: {missing} answers missing after {timeout_s:.0f} s, from '
                                 f'{", ".join(silent[:4])}') from None
            if event['event'] == 'end':
                node.process.wait()
                raise BenchError(f'{self.mode.label}: {node.name} ended with '
                                 f'{describe_status(node.process.returncode)}: {node.error_output()[-1000:]}')
            answers[node].append(event)
            missing -= 1
        return answers

    def ask(self, what, commands):
        """Sends every node its commands. @return {node: [answers]}"""
        for node, lines in commands.items():
            for words in lines:
                node.tell(*words)
        try:
            return self._await_answers({node: len(lines) for node, lines in commands.items()}, ANSWER_DEADLINE_S)
        except BenchError as error:
            raise BenchError(f'{error} ({what})') from None

    def _await_links(self):
        """Until both ends of each link know of it and all run over the mode's transport: the state of other processes,
        of which there is no event."""
        deadline = time.monotonic() + START_DEADLINE_S
        wanted = sum(len(flow.subscribers) for flow in self.flows)
        while True:
            counts = {direction: 0 for direction in 'io'}
            others = 0
            for node in self.nodes:
                for direction, transport, topic in node.bus():
                    if topic.startswith(self.namespace):
                        counts[direction] += 1
                        others += transport != self.mode.transport
            if counts == {'i': wanted, 'o': wanted} and others == 0:
                return
            if time.monotonic() > deadline:
                raise BenchError(f'{self.mode.label}: after {START_DEADLINE_S:.0f} s {counts["o"]} links at publishers '
                                 f'and {counts["i"]} at subscribers of {wanted}, {others} ends not over '
                                 f'{self.mode.transport}: {self.warnings()}')
            time.sleep(POLL_S)

    def start(self):
        self.ask('start', self._publications('start', lambda flow: (flow.rate_hz,)))

    def stop(self):
        """Publishes no more and waits until every subscriber has the last message of each topic.
        @return {'published', 'received', 'missing', 'repeated', 'damaged', 'latency_us', 'slowest_ms'}"""
        stopped = self.ask('stop', self._publications('stop'))
        published = {}
        for flow in self.flows:
            published[flow.topic] = stopped[self.nodes[flow.publisher]].pop(0)['published']
        deadline = time.monotonic() + ANSWER_DEADLINE_S
        while True:
            tallies = self.ask('tally', self._subscriptions('tally'))
            rows = []
            for flow in self.flows:
                for subscriber in flow.subscribers:
                    row = tallies[self.nodes[subscriber]].pop(0)
                    row['missing'] += published[flow.topic] - row['next']
                    rows.append(row)
            behind = sum(row['missing'] for row in rows)
            if behind == 0 or time.monotonic() > deadline:
                break
            time.sleep(POLL_S)
        totals = {key: sum(row[key] for row in rows) for key in ('received', 'missing', 'repeated', 'damaged')}
        totals['published'] = sum(published.values())
        totals['latency_us'] = sum(row['latency_ns'] for row in rows) / max(totals['received'], 1) / 1e3
        totals['slowest_ms'] = max(row['slowest_ns'] for row in rows) / 1e6
        return totals

    def cpu_ns(self):
        return sum(node.cpu_ns() for node in self.nodes)

    def memory_mb(self):
        """Resident memory, a shared page divided among those that share it."""
        total_kb = 0
        for node in self.nodes:
            with open(f'/proc/{node.pid}/smaps_rollup') as rollup:
                total_kb += next(int(line.split()[1]) for line in rollup if line.startswith('Pss:'))
        return total_kb / 1024

    def descriptors(self):
        """[what each node holds: {kind of descriptor: number}]"""
        def count(pid):
            folder = f'/proc/{pid}/fd'
            kinds = collections.Counter()
            for name in os.listdir(folder):
                with contextlib.suppress(FileNotFoundError):  # closed meanwhile
                    kinds[re.sub(r'[^a-z_]*[0-9]+.*', '', os.readlink(f'{folder}/{name}'))] += 1
            return kinds
        return [count(node.pid) for node in self.nodes]

    def warnings(self):
        texts = [f'{node.name}: {node.error_output().strip()}' for node in self.nodes if node.error_output().strip()]
        return f'{len(texts)} nodes wrote warnings, the first: {texts[0][-500:]}' if texts else 'no node wrote a warning'

    def close(self):
        """@return how long all nodes took to end [s]"""
        begin = time.monotonic()
        quit_all(self.nodes)
        return time.monotonic() - begin

    def abandon(self):
        kill_all(self.nodes)
