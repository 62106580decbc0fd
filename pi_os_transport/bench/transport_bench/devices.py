"""Several devices on one machine: network namespaces around a router, and the processes that run on them.

Each device is a network namespace with one address on its `eth0`; a further namespace is the router that their cables
lead to. It routes because a bridge device would let a sender's TCP feel the queues behind it, as no real network does.
The namespaces have no name and no keeper: they live as long as this process holds them open or a process runs
in them, and every process started here is ended by the kernel together with this one. So nothing of them is ever seen
in the namespace of the machine, test beds run beside each other, and nothing stays after a SIGKILL. All devices share
CLOCK_MONOTONIC. To look into one: nsenter --net=/proc/<pid of the test>/fd/<n> ip addr.
"""

import contextlib
import ctypes
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

import roslib.packages

from .modes import BenchError, environment, program_folder

NEW_NETWORK = 0x40000000  # CLONE_NEWNET of sched.h
INTERFACE = 'eth0'
MASTER_PORT = 11311
BRIDGE_PORT = 8814
BRIDGE_PROGRAM = 'pi_os_bridge'
CONGESTION_CONTROLS = ('cubic', 'reno')  # what a Debian device runs; where a namespace may not choose it, its ancestor
START_DEADLINE_S = 30.0
POLL_S = 0.01             # for states of other processes that raise no event
SEGMENT_BYTES = 1500

_libc = ctypes.CDLL(None, use_errno=True)


class Unsupported(BenchError):
    """This machine does not let us make devices, or a kernel module for what is asked is missing."""


def _system_call(function, *args):
    if function(*args) != 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))


def await_state(reached, what, timeout_s=START_DEADLINE_S):
    """Returns the first true value of reached(); raises BenchError after the deadline."""
    deadline = time.monotonic() + timeout_s
    while True:
        value = reached()
        if value:
            return value
        if time.monotonic() > deadline:
            raise BenchError(f'not within {timeout_s:.1f} s: {what() if callable(what) else what}')
        time.sleep(POLL_S)


class Namespace:
    """A network namespace that is gone when it is closed and no process is left in it."""

    def __init__(self):
        with open('/proc/thread-self/ns/net') as before:
            try:
                _system_call(_libc.unshare, NEW_NETWORK)
            except OSError as error:
                raise Unsupported(f'no network namespace of its own here (needs root): {error.strerror}') from None
            try:
                self._file = os.open('/proc/thread-self/ns/net', os.O_RDONLY | os.O_CLOEXEC)
            finally:
                _system_call(_libc.setns, before.fileno(), NEW_NETWORK)
        self.path = f'/proc/{os.getpid()}/fd/{self._file}'

    @contextlib.contextmanager
    def entered(self):
        """Inside, the calling thread makes its sockets in this namespace and starts its processes there."""
        with open('/proc/thread-self/ns/net') as before:
            _system_call(_libc.setns, self._file, NEW_NETWORK)
            try:
                yield self
            finally:
                _system_call(_libc.setns, before.fileno(), NEW_NETWORK)

    def run(self, *command):
        """Runs a command to its end. @return its output. Raises BenchError if it fails."""
        with self.entered():
            done = subprocess.run(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  text=True)
        if done.returncode != 0:
            raise BenchError(f'{" ".join(command)}: {done.stdout.strip()}')
        return done.stdout

    def set_kernel(self, name, value):
        """Sets a variable of /proc/sys/net in this namespace."""
        try:
            with self.entered(), open('/proc/sys/' + name, 'w') as file:
                file.write(str(value))
        except OSError as error:
            raise BenchError(f'/proc/sys/{name}: {error.strerror}') from None

    def close(self):
        if self._file is not None:
            os.close(self._file)
            self._file = None


class DeviceProcess:
    """A process on a device. Lines of its output that start with '@' are answers, the others collect in `lines`."""

    def __init__(self, device, command, env=None, preload=''):
        self.device, self.command = device, list(command)
        # setpriv ends it together with this process, and the empty line tells that it has seen to that; env sets the
        # preload, so that it reaches no helper before.
        full = ['setpriv', '--pdeathsig', 'KILL', 'sh', '-c', 'echo && exec "$@"', 'sh', 'env']
        full += [f'LD_PRELOAD={preload}'] if preload else []
        with device.entered():
            self.popen = subprocess.Popen(full + self.command, env=device.environment(env), stdin=subprocess.PIPE,
                                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True)
        self.pid = self.popen.pid
        self.popen.stdout.readline()
        self.lines = []
        self._answers = []
        self._changed = threading.Condition()
        self._ended = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        device.processes.append(self)

    def _read(self):
        for raw in self.popen.stdout:
            line = raw.decode('utf-8', 'replace').rstrip('\n')
            with self._changed:
                if line.startswith('@'):
                    self._answers.append(json.loads(line[1:]))
                elif line:
                    self.lines.append(re.sub('\x1b\\[[0-9;]*m', '', line))
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def describe(self):
        status = self.popen.poll()
        return (f'{os.path.basename(self.command[0])} on {self.device.name} '
                f'({"running" if status is None else f"ended with {status}"}), output:\n' + '\n'.join(self.lines[-20:]))

    def _await(self, reached, what, timeout_s):
        with self._changed:
            self._changed.wait_for(lambda: reached() or self._ended, timeout_s)
            value = reached()
        if not value:
            raise BenchError(f'no {what} within {timeout_s:.0f} s from {self.describe()}')
        return value

    def await_line(self, pattern, timeout_s=START_DEADLINE_S):
        """Waits for a line of output, as of the start of the process, and returns it."""
        return self._await(lambda: next((line for line in self.lines if re.search(pattern, line)), None),
                           f'line "{pattern}"', timeout_s)

    def answer(self, timeout_s=START_DEADLINE_S):
        self._await(lambda: bool(self._answers), 'answer', timeout_s)
        with self._changed:
            return self._answers.pop(0)

    def say(self, *words):
        with contextlib.suppress(BrokenPipeError):  # answer() reports the end of the process
            self.popen.stdin.write((' '.join(str(word) for word in words) + '\n').encode())
            self.popen.stdin.flush()

    def alive(self):
        return self.popen.poll() is None

    def signal(self, number):
        self.popen.send_signal(number)

    def wait(self, timeout_s=START_DEADLINE_S):
        try:
            return self.popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise BenchError(f'no end within {timeout_s:.0f} s of {self.describe()}') from None

    def kill(self):
        """SIGKILL, and returns once the process is gone."""
        if self.alive():
            self.popen.kill()
        self.popen.wait()

    def close(self):
        self.kill()
        self._reader.join()
        for stream in (self.popen.stdin, self.popen.stdout):
            with contextlib.suppress(BrokenPipeError):
                stream.close()

    def resident_kb(self):
        with open(f'/proc/{self.pid}/status') as status:
            return int(re.search(r'^VmRSS:\s*(\d+)', status.read(), re.M).group(1))


def pi_os_program():
    """Path of `pi_os`: a script, in the devel space where the sources are."""
    beside = os.path.join(program_folder(), 'pi_os')
    return beside if os.path.exists(beside) else roslib.packages.find_node('pi_os_transport', 'pi_os')[0]


class Bridge(DeviceProcess):
    """pi_os_bridge on a device; made when it serves."""

    def __init__(self, device, *args, env=None):
        super().__init__(device, [os.path.join(program_folder(), BRIDGE_PROGRAM), *args], env)
        self.args = args
        try:
            self.await_line('^pi_os_bridge: serving')
        except BaseException:
            self.close()
            raise

    def status(self):
        """What `pi_os status --json` says."""
        return self.device.pi_os('status')

    def refused(self):
        return self.status()['refused']

    def pause(self):
        self.signal(signal.SIGSTOP)

    def resume(self):
        self.signal(signal.SIGCONT)

    def terminate(self):
        """SIGTERM, as by roslaunch. @return its exit status."""
        self.signal(signal.SIGTERM)
        return self.wait()


class Device(Namespace):
    """One computer: an address, a cable to the router, processes."""

    def __init__(self, testbed, name, number):
        super().__init__()
        self.testbed, self.name = testbed, name
        self.address = f'{testbed.network}.{number}.1'
        self._gateway = f'{testbed.network}.{number}.254'
        self.processes = []
        self._cut = None
        testbed.router.run('ip', 'link', 'add', name, 'type', 'veth', 'peer', 'name', INTERFACE, 'netns', self.path)
        testbed.router.run('ip', 'addr', 'add', f'{self._gateway}/24', 'dev', name)
        testbed.router.run('ip', 'link', 'set', name, 'addrgenmode', 'none', 'up')
        self._choose_congestion_control()
        self.run('ip', 'link', 'set', 'lo', 'up')
        self.run('ip', 'addr', 'add', f'{self.address}/24', 'dev', INTERFACE)
        self._plug_in()

    def _choose_congestion_control(self):
        """Makes devices alike on all machines: what the machine itself runs may avoid queues or fill them."""
        for name in CONGESTION_CONTROLS:
            try:
                self.set_kernel('net/ipv4/tcp_congestion_control', name)
            except BenchError as error:
                refusal = error
            else:
                self.congestion_control = name
                return
        raise refusal

    def environment(self, extra=None):
        """Of this device's processes: no preload and no π-OS variable but those of `extra`."""
        env = {key: value for key, value in environment().items()
               if key != 'ROS_HOSTNAME' and not key.startswith('PI_OS_')}
        env.update(ROS_IP=self.address, ROS_MASTER_URI=self.testbed.master_uri, ROS_LOG_DIR=self.testbed.folder)
        env.update(extra or {})
        return env

    def start(self, *command, env=None, preload=''):
        return DeviceProcess(self, command, env, preload)

    def start_bridge(self, *args, env=None):
        return Bridge(self, *args, env=env)

    def pi_os(self, *words):
        """What `pi_os WORDS --json` says on this device."""
        return json.loads(self.run(pi_os_program(), *words, '--json'))

    def kill_all(self):
        """Every process at once, as when the device's container is killed: the kernel still closes their sockets."""
        for process in self.processes:
            if process.alive():
                process.popen.kill()
        for process in self.processes:
            process.popen.wait()

    def power_off(self):
        """As kill_all(), but nothing more leaves the device: no other device is told. restore() plugs it in again."""
        self.cut('loss')
        self.kill_all()

    # -------------------------------------------------------------------------------------------------------- the cable

    def counters(self):
        """Bytes that this device has sent and received over its cable."""
        with self.entered(), open('/proc/thread-self/net/dev') as table:
            fields = re.search(rf'^\s*{INTERFACE}:(.*)$', table.read(), re.M).group(1).split()
        return {'sent': int(fields[8]), 'received': int(fields[0])}

    def shape(self, rate_mbit, queue_ms=50.0, delay_ms=0.0, loss_percent=0.0):
        """Limits the cable in both directions, each for itself.

        @param rate_mbit     [Mbit/s]
        @param queue_ms      longest that a packet waits for its turn; what comes then is dropped [ms]
        @param delay_ms      further delay of each packet [ms]; needs the kernel module sch_netem, as does:
        @param loss_percent  random loss of packets [%]
        """
        rate_bytes = rate_mbit * 1e6 / 8
        if delay_ms or loss_percent:
            packets = max(int(rate_bytes * (queue_ms + delay_ms) / 1e3 / SEGMENT_BYTES), 10)
            qdisc = ['netem', 'rate', f'{rate_mbit}mbit', 'delay', f'{delay_ms}ms', 'loss', f'{loss_percent}%',
                     'limit', str(packets)]
        else:
            burst = max(int(rate_bytes / 500), 16 * 1024)  # 2 ms, and enough for the largest packet of one segment
            qdisc = ['tbf', 'rate', f'{rate_mbit}mbit', 'burst', str(burst),
                     'limit', str(int(burst + rate_bytes * queue_ms / 1e3))]
        for namespace, interface in ((self, INTERFACE), (self.testbed.router, self.name)):
            try:
                namespace.run('tc', 'qdisc', 'replace', 'dev', interface, 'root', *qdisc)
            except BenchError as error:
                if 'qdisc kind is unknown' in str(error):
                    raise Unsupported(f'this kernel has no sch_{qdisc[0]}: {error}') from None
                raise

    def unshape(self):
        for namespace, interface in ((self, INTERFACE), (self.testbed.router, self.name)):
            namespace.run('tc', 'qdisc', 'del', 'dev', interface, 'root')

    def cut(self, how):
        """'loss': every packet is lost on its way, nobody is told. 'down': the interface goes down, as when the
        cable is pulled out."""
        if how == 'loss':
            self._route_nothing(True)
        elif how == 'down':
            self.run('ip', 'link', 'set', INTERFACE, 'down')
        else:
            raise ValueError(f'cut({how!r}): must be loss or down')
        self._cut = how

    def restore(self):
        if self._cut == 'loss':
            self._route_nothing(False)
        elif self._cut == 'down':
            self._plug_in()
        self._cut = None

    def _plug_in(self):
        self.run('ip', 'link', 'set', INTERFACE, 'addrgenmode', 'none', 'up')
        self.run('ip', 'route', 'replace', 'default', 'via', self._gateway)

    def _route_nothing(self, on):
        """The router drops what comes from this device and what goes to it, without a word to the senders."""
        self.testbed.router.set_kernel(f'net/ipv4/conf/{self.name}/forwarding', 0 if on else 1)
        self.testbed.router.run('ip', 'route', 'add' if on else 'del', 'blackhole', f'{self.address}/32')

    def close(self):
        for process in self.processes:
            if process.alive():
                process.popen.kill()
        for process in self.processes:
            process.close()
        super().close()


class Testbed:
    """The devices, the router between them and a ROS master on the first device, which is running when this is made."""

    def __init__(self, names=('vehicle', 'edge_a', 'edge_b'), network='10.88'):
        self.network = network
        self.devices = {}
        self.router = None
        self.folder = tempfile.mkdtemp(prefix='pi_os_devices_')
        # Removes the logs of the nodes when this process ends, however it does.
        self._remover = subprocess.Popen(['sh', '-c', 'read line; rm -rf -- "$0"', self.folder], stdin=subprocess.PIPE,
                                         start_new_session=True)
        self.master_uri = f'http://{network}.1.1:{MASTER_PORT}'
        try:
            for program in ('ip', 'tc', 'setpriv'):
                if not shutil.which(program):
                    raise Unsupported(f'{program} is not installed: apt-get install iproute2 util-linux')
            self.router = Namespace()
            try:
                self.router.set_kernel('net/ipv4/ip_forward', 1)
                for number, name in enumerate(names, 1):
                    self.devices[name] = Device(self, name, number)
            except BenchError as error:
                raise Unsupported(f'no devices of network namespaces here: {error}') from None
            self.first = self.devices[names[0]]
            self.master = self.first.start(os.path.join(program_folder(), 'pi_master'), '-p', str(MASTER_PORT))
            await_state(self._master_answers, lambda: 'master: ' + self.master.describe())
        except BaseException:
            self.close()
            raise

    def __getattr__(self, name):
        try:
            return self.__dict__['devices'][name]
        except KeyError:
            raise AttributeError(name) from None

    def call_master(self, method, *args):
        """One call of the master's API. Raises OSError where nobody answers, BenchError where it answers no."""
        with self.first.entered(), xmlrpc.client.ServerProxy(self.master_uri) as proxy:
            code, text, value = getattr(proxy, method)('/judge', *args)
        if code != 1:
            raise BenchError(f'master: {method}{args}: {text}')
        return value

    def _master_answers(self):
        if not self.master.alive():
            raise BenchError(self.master.describe())
        try:
            return self.call_master('getPid')
        except OSError:
            return None

    def bus_info(self, device, node_name, uri=None):
        """[(direction, transport, topic)] of a node's links on `device`. `uri` spares the question to the master."""
        uri = uri or self.call_master('lookupNode', node_name)
        with device.entered(), xmlrpc.client.ServerProxy(uri) as proxy:
            code, text, info = proxy.getBusInfo('/judge')
        if code != 1:
            raise BenchError(f'{node_name}: getBusInfo: {text}')
        return [(entry[2], entry[3], entry[4]) for entry in info if len(entry) < 6 or entry[5]]

    def close(self):
        for device in self.devices.values():
            device.close()
        if self.router:
            self.router.close()
        self._remover.stdin.close()
        self._remover.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
