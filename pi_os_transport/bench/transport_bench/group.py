"""A publisher and its subscribers, connected over the transport of one mode."""

import contextlib
import os
import queue
import time

from .modes import BenchError, environment, format_size
from .nodes import CONNECT_DEADLINE_S, Node, describe_status, kill_all, quit_all

ANSWER_DEADLINE_S = 30.0  # beyond the time that the traffic itself takes


class Group:
    """One publisher and some subscribers in processes of their own, connected over the transport of one mode."""

    serial = 0

    def __init__(self, master, mode, subscribers, library=None, publisher_args=(), connect_s=CONNECT_DEADLINE_S,
                 answer_s=ANSWER_DEADLINE_S, outsiders=0):
        """@param outsiders  further subscribers, without the library whatever the mode."""
        Group.serial += 1
        self.connect_s, self.answer_s = connect_s, answer_s
        self.master, self.mode = master, mode
        self.namespace = f'/bench_{os.getpid()}_{Group.serial}'
        self.events = queue.Queue()
        self.nodes = []
        self.extra = 0
        self.pending = []
        self.subscribers = []
        self.outsiders = []
        self.doing = 'starting'
        plain_env = environment(master.env)
        env = dict(plain_env, **dict(mode.variables))
        if mode.preload:
            env['LD_PRELOAD'] = ':'.join([library] + ([env['LD_PRELOAD']] if 'LD_PRELOAD' in env else []))
        try:
            self.publisher = self._start('publisher', 'bench_publisher', publisher_args, env)
            self.subscribers = [self._start(f'subscriber_{i}', 'bench_subscriber', mode.subscriber_args, env)
                                for i in range(subscribers)]
            self.outsiders = [self._start(f'outsider_{i}', 'bench_subscriber', mode.subscriber_args, plain_env)
                              for i in range(outsiders)]
            self.subscribers += self.outsiders
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
        """{node: [(direction, transport, topic)]}"""
        data, ack = self.namespace + '/data', self.namespace + '/ack'
        expected = {self.publisher: []}
        for node in self.subscribers:
            transport = 'TCPROS' if node in self.outsiders else self.mode.transport
            expected[self.publisher] += [('o', transport, data), ('i', transport, ack)]
            expected[node] = [('i', transport, data), ('o', transport, ack)]
        extra = [f'{self.namespace}/extra_{i}' for i in range(self.extra)]
        expected[self.publisher] += [('o', self.mode.transport, topic) for topic in extra]
        if extra:
            expected[self.subscribers[0]] += [('i', self.mode.transport, topic) for topic in extra]
        return expected

    def wrong_links(self):
        """What differs from 'every link is connected over the transport of the mode', as text; empty if nothing."""
        for node, expected in self.expected_links().items():
            links = [link for link in node.bus() if link[2].startswith(self.namespace)]
            wanted = sorted(expected)
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

    def run(self, count, size, rate_hz=0.0, window=0, period=4093, check='full', work_us=0):
        """Publishes `count` messages and waits until every subscriber has received and checked them. With a rate, the
        publisher computes for `work_us` before each; that is part of its answer's bench_cpu_ns.
        @return (the publisher's answer, [each subscriber's answer], CPU time of all processes [ns])"""
        self.doing = f'{len(self.subscribers)} subscriber(s), {format_size(size)}'
        for node in self.subscribers:
            node.tell('expect', count, size, check, window, period)
        self.await_events({node: 'ready' for node in self.subscribers}, self.answer_s)
        cpu_before_ns = [node.cpu_ns() for node in self.nodes]
        self.publisher.tell('run', count, size, rate_hz, window, period, work_us)
        wanted = {self.publisher: 'done', **{node: 'complete' for node in self.subscribers}}
        answers = self.await_events(wanted, self.answer_s + (2.0 * count / rate_hz if rate_hz else 0.0))
        cpu_ns = sum(node.cpu_ns() - before for node, before in zip(self.nodes, cpu_before_ns))
        return answers[self.publisher], [answers[node] for node in self.subscribers], cpu_ns

    def warnings(self):
        """What the nodes wrote to standard error, one text per node that wrote anything."""
        return [f'{node.name}: {text.strip()}' for node in self.nodes for text in [node.error_output()] if text.strip()]

    def close(self):
        quit_all(self.nodes)

    def abandon(self):
        kill_all(self.nodes)

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        self.close() if kind is None else self.abandon()
