#!/usr/bin/python3
# Debian's own interpreter: the ROS packages of the distribution belong to it, whatever python3 comes first in PATH.
"""Compares pi_core with roscore, which is roslaunch, rosmaster and rosout, alternating in one run: time to start, time
to register many topics, memory."""

import argparse
import json
import os
import shlex
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import xmlrpc.client

FOLDER = os.path.dirname(os.path.realpath(__file__))  # of the other programs, too
sys.path.insert(0, FOLDER)
import transport_bench as bench  # noqa: E402  (found through the line above)
from transport_bench import nodes, output  # noqa: E402

START_LIMIT_S = 180.0
CLIENT_LIMIT_S = 600.0
POLL_S = 0.0005
MEMORY_BAR_MB = 4.0
START_BAR_MS = 50.0


def free_port():
    with socket.socket() as probe:
        probe.bind(('localhost', 0))
        return probe.getsockname()[1]


def family(pid):
    """{pid: program} of a process and all its descendants."""
    found = {}
    with open(f'/proc/{pid}/comm') as file:
        found[pid] = file.read().strip()
    for task in os.listdir(f'/proc/{pid}/task'):
        with open(f'/proc/{pid}/task/{task}/children') as file:
            for child in file.read().split():
                found.update(family(int(child)))
    return found


def memory_mb(pid):
    """(RSS, PSS) [MB] of one process."""
    values = {}
    with open(f'/proc/{pid}/smaps_rollup') as rollup:
        for line in rollup:
            key, _, rest = line.partition(':')
            if key in ('Rss', 'Pss'):
                values[key] = int(rest.split()[0]) / 1024
    return values['Rss'], values['Pss']


class Core:
    """One of the two, from its start on."""

    def __init__(self, name):
        self.name = name
        self.folder = tempfile.mkdtemp(prefix='bench_master_')
        self.uri = f'http://localhost:{free_port()}/'
        self.port = self.uri.rsplit(':', 1)[1].strip('/')
        program = os.path.join(FOLDER, 'pi_core') if name == 'pi_core' else shutil.which('roscore')
        if not program or not os.access(program, os.X_OK):
            raise bench.BenchError(f'{name} is not installed')
        begin = time.monotonic()
        self.log = open(os.path.join(self.folder, 'output'), 'w+')
        self.process = nodes.spawn([program, '-p', self.port],
                                   nodes.environment({'ROS_MASTER_URI': self.uri, 'ROS_HOSTNAME': 'localhost',
                                                      'ROS_LOG_DIR': self.folder, 'ROS_HOME': self.folder}),
                                   stdin=subprocess.DEVNULL, stdout=self.log, stderr=subprocess.STDOUT)
        try:
            self._await(begin)
        except BaseException:
            self.close()
            raise
        self.start_s = time.monotonic() - begin

    def _await(self, begin):
        """Until master and rosout answer: there is no event for that in roscore."""
        while True:
            try:
                with xmlrpc.client.ServerProxy(self.uri) as master:
                    if master.lookupNode('/bench', '/rosout')[0] == 1:
                        return
            except OSError:
                pass
            if self.process.poll() is not None or time.monotonic() - begin > START_LIMIT_S:
                self.log.seek(0)
                raise bench.BenchError(f'{self.name} does not answer at {self.uri}: {self.log.read()[-500:]}')
            time.sleep(POLL_S)

    def memory(self):
        """{program: (RSS, PSS)} [MB]"""
        found = {}
        for pid, program in family(self.process.pid).items():
            rss, pss = memory_mb(pid)
            before = found.get(program, (0.0, 0.0))
            found[program] = (before[0] + rss, before[1] + pss)
        return found

    def register(self, topics):
        """[s] by phase, see bench_master_client.cpp."""
        result = subprocess.run([os.path.join(FOLDER, 'bench_master_client'), self.uri, str(topics)],
                                env=nodes.environment({'ROS_MASTER_URI': self.uri, 'ROS_HOSTNAME': 'localhost'}),
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                timeout=CLIENT_LIMIT_S)
        if result.returncode != 0:
            raise bench.BenchError(f'{self.name}: {result.stderr.strip()}')
        phases = json.loads(result.stdout)
        phases['register_s'] = phases['subscribers_s'] + phases['publishers_s']
        return phases

    def close(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()
        self.log.close()
        shutil.rmtree(self.folder, ignore_errors=True)


def measure(name, topics):
    core = Core(name)
    try:
        row = {'core': name, 'start_s': core.start_s, 'memory': core.memory()}
        row.update(core.register(topics))
        row['memory_after'] = core.memory()
        return row
    finally:
        core.close()


def spread(values):
    return f'{output.format_number(statistics.median(values))} ({output.format_number(min(values))}..' \
           f'{output.format_number(max(values))})'


def total(memory, kind):
    return sum(both[kind] for both in memory.values())


def report(rows, topics):
    """The table and the bars; True if all bars are met."""
    by_core = {name: [row for row in rows if row['core'] == name] for name in ('roscore', 'pi_core')}
    lines = []
    for text, value in (('start to ready [ms]', lambda row: 1000 * row['start_s']),
                        (f'{topics} subscribers [ms]', lambda row: 1000 * row['subscribers_s']),
                        (f'{topics} publishers [ms]', lambda row: 1000 * row['publishers_s']),
                        ('until all subscribers know [ms]', lambda row: 1000 * row['told_s']),
                        ('RSS, started [MB]', lambda row: total(row['memory'], 0)),
                        ('PSS, started [MB]', lambda row: total(row['memory'], 1)),
                        ('RSS, registered [MB]', lambda row: total(row['memory_after'], 0)),
                        ('PSS, registered [MB]', lambda row: total(row['memory_after'], 1))):
        values = [[value(row) for row in by_core[name]] for name in ('roscore', 'pi_core')]
        ratios = [stock / ours for stock, ours in zip(*values)]
        lines.append([text, spread(values[0]), spread(values[1]), spread(ratios)])
    print(output.format_table(['median (min..max)', 'roscore', 'pi_core', 'roscore/pi_core'], lines))
    print('\nroscore is, by RSS [MB]: ' + ', '.join(
        f'{program} {rss:.1f}' for program, (rss, _) in sorted(by_core['roscore'][0]['memory'].items())))
    ratio = statistics.median(stock['register_s'] / ours['register_s']
                              for stock, ours in zip(by_core['roscore'], by_core['pi_core']))
    start_ms = statistics.median(1000 * row['start_s'] for row in by_core['pi_core'])
    rss = statistics.median(total(row['memory'], 0) for row in by_core['pi_core'])
    bars = [(f'registration of {topics} subscribers and publishers: {ratio:.1f} times faster, bar 5', ratio >= 5.0),
            (f'start to ready: {start_ms:.1f} ms, bar {START_BAR_MS:.0f} ms', start_ms <= START_BAR_MS),
            (f'resident, whole: {rss:.1f} MB, bar {MEMORY_BAR_MB:.0f} MB', rss <= MEMORY_BAR_MB)]
    print()
    for text, met in bars:
        print(f'{"met   " if met else "MISSED"} {text}')
    return all(met for _, met in bars)


def main():
    parser = argparse.ArgumentParser(prog='bench_master', description=__doc__,
                                     epilog='Exit status: 0 if all bars are met.')
    parser.add_argument('--topics', type=int, default=1000)
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--json', help='file for the figures of each round')
    options = parser.parse_args()
    if options.topics < 1 or options.rounds < 1:
        parser.error('--topics and --rounds must be at least 1')
    machine = bench.machine()
    rows = []
    for number in range(options.rounds):
        for name in ('roscore', 'pi_core') if number % 2 == 0 else ('pi_core', 'roscore'):
            print(f'round {number + 1}: {name}', file=sys.stderr, flush=True)
            rows.append(measure(name, options.topics))
    print(f'\n{machine["cpu"]}, {machine["usable_cores"]} core(s), Linux {machine["kernel"]}, load average at the start '
          f'{machine["load_average"][0]:.2f}\nrosrun pi_os_transport bench_master {shlex.join(sys.argv[1:])}\n')
    met = report(rows, options.topics)
    if options.json:
        with open(options.json, 'w') as file:
            json.dump({'machine': machine, 'rows': rows}, file, indent=1)
    return 0 if met else 1


if __name__ == '__main__':
    try:
        sys.exit(main())
    except bench.BenchError as error:
        sys.exit(f'bench_master: {error}')
    except KeyboardInterrupt:
        sys.exit(130)
