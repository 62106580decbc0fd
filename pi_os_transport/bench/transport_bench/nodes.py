"""The processes of a comparison: the master and the bench nodes, and what the kernel tells of them."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import xmlrpc.client

from .modes import BenchError, environment, program_folder

EVENT_PREFIX = '@ '
CONNECT_DEADLINE_S = 20.0
QUIT_DEADLINE_S = 10.0


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
    """An own pi_master on a free port (own=True), else the master that ROS_MASTER_URI names."""

    def __init__(self, own=True):
        self.log_folder = tempfile.mkdtemp(prefix='bench_transport_')
        self.env = {'ROS_LOG_DIR': self.log_folder}
        self.process = None
        if own:
            self._start()
        else:
            self.uri = os.environ['ROS_MASTER_URI']
        self.proxy = xmlrpc.client.ServerProxy(self.uri)
        try:
            self.proxy.getPid('/bench_transport')
        except OSError as error:
            self.close()
            raise BenchError(f'no master answers at {self.uri}: {error}') from None

    def _start(self):
        self.log = open(os.path.join(self.log_folder, 'pi_master.out'), 'w+')
        read_end, write_end = os.pipe()
        with os.fdopen(read_end) as announced:
            try:
                self.process = spawn([os.path.join(program_folder(), 'pi_master'), '-p', '0', '--announce',
                                      str(write_end)],
                                     environment(dict(self.env, ROS_HOSTNAME='localhost')), pass_fds=(write_end,),
                                     stdin=subprocess.DEVNULL, stdout=self.log, stderr=subprocess.STDOUT)
            finally:
                os.close(write_end)
            self.uri = announced.readline().strip()
        if not self.uri:
            self.log.seek(0)
            text = self.log.read()[-500:]
            self.close()
            raise BenchError(f'pi_master ended: {text}')
        self.env.update(ROS_MASTER_URI=self.uri, ROS_HOSTNAME='localhost')

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


def quit_all(nodes):
    """Lets nodes end, together; kills those that do not."""
    try:
        for node in nodes:
            node.tell('quit')
        for node in nodes:
            node.quit()
    finally:
        kill_all(nodes)


def kill_all(nodes):
    for node in nodes:
        node.kill()


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
