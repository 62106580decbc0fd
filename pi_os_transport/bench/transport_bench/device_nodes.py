"""Bench nodes on devices: groups of one publisher and its subscribers, and flows that may drop messages."""

import contextlib
import dataclasses
import os

from .devices import await_state
from .group import Group
from .modes import BenchError, Mode, program_folder
from .nodes import CONNECT_DEADLINE_S, Node

PROTECTED = 'pi_os_tls'  # the mode in which the bridges use TLS
SHIPPED = ('--nice', '-10')  # as bridge.launch starts bridges

# What links between devices have to show; bridges run where the library is preloaded.
DEVICE_MODES = {mode.key: mode for mode in (
    Mode('tcpros', 'TCPROS', 'TCPROS', False),
    Mode('nodelay', 'tcpNoDelay', 'TCPROS', False, ('--tcp-no-delay',)),
    Mode('pi_os', 'π-OS', 'NNROS', True, bridge_args=SHIPPED),
    Mode(PROTECTED, 'π-OS, TLS', 'NNROS', True, bridge_args=SHIPPED),
    Mode('nanomsg', 'libnanomsg', 'NNROS', True, bridge_args=(*SHIPPED, '--wire', 'nanomsg')),
)}


class DeviceMaster:
    """The master of a test bed, as Group and Node want to see one."""

    def __init__(self, testbed):
        self.testbed = testbed
        self.env = {'ROS_LOG_DIR': testbed.folder, 'ROS_MASTER_URI': testbed.master_uri}

    def node_uri(self, name):
        return self.testbed.call_master('lookupNode', name)


class DeviceNode(Node):
    """A bench node on a device."""

    def __init__(self, device, *args):
        self.device = device
        self._uri = None
        with device.entered():
            super().__init__(*args)
        device.processes.append(self)

    def bus(self):
        self._uri = self._uri or self.group.master.node_uri(self.name)
        return self.device.testbed.bus_info(self.device, self.name, self._uri)

    # What a device needs to end its processes.

    @property
    def popen(self):
        return self.process

    def alive(self):
        return self.process.poll() is None

    def close(self):
        self.kill()


class DeviceGroup(Group):
    """A group whose publisher and subscribers run on devices of their own."""

    def __init__(self, testbed, mode, publisher_device, subscriber_devices, library=None, **kwargs):
        self._places = [publisher_device] + list(subscriber_devices)
        super().__init__(DeviceMaster(testbed), mode, len(subscriber_devices), library, **kwargs)

    def _start(self, name, program, args, env):
        device = self._places[len(self.nodes)]
        preload = {'LD_PRELOAD': env['LD_PRELOAD']} if 'LD_PRELOAD' in env else {}
        node = DeviceNode(device, self, name, program, list(args), device.environment(preload))
        self.nodes.append(node)
        return node


class FlowNode:
    """A bench_flow on a device."""

    serial = 0

    def __init__(self, device, name, mode, library=None, env=None):
        FlowNode.serial += 1
        self.device = device
        self.name = f'/flow_{name}_{FlowNode.serial}'
        command = [os.path.join(program_folder(), 'bench_flow'), f'__name:={self.name[1:]}', *mode.subscriber_args]
        self.process = device.start(*command, env=env, preload=library if mode.preload else '')
        self._uri = None
        self.process.answer()

    def ask(self, event, *words):
        """Sends a command. @return the answer, which has to be `event`."""
        self.process.say(*words)
        answer = self.process.answer()
        if answer['event'] != event:
            raise BenchError(f'{self.name}: {answer} is no answer to {words}')
        return answer

    def advertise(self, topic, size, queue):
        self.ask('advertised', 'advertise', topic, size, queue)

    def subscribe(self, topic, size, queue):
        self.ask('subscribed', 'subscribe', topic, size, queue)

    def start(self, topic, rate_hz):
        self.ask('started', 'start', topic, rate_hz)

    def stop(self, topic):
        """@return the number of messages published in all."""
        return self.ask('stopped', 'stop', topic)['published']

    def published(self, topic):
        return self.ask('published', 'published', topic)['published']

    def take(self, topic):
        """@return [Arrival] since the last call, in order of arrival. Raises BenchError if a message was damaged."""
        answer = self.ask('taken', 'take', topic)
        if answer['damaged']:
            raise BenchError(f'{self.name}: {answer["damaged"]} damaged messages on {topic}')
        return [Arrival(*row) for row in answer['rows']]

    def transports(self, topic, direction):
        self._uri = self._uri or self.device.testbed.call_master('lookupNode', self.name)
        links = self.device.testbed.bus_info(self.device, self.name, self._uri)
        return sorted(transport for way, transport, name in links if name == topic and way == direction)

    def await_transports(self, topic, direction, expected, timeout_s=CONNECT_DEADLINE_S):
        expected = sorted(expected)
        await_state(lambda: self.transports(topic, direction) == expected,
                    lambda: f'{self.name}: links of {topic} are {self.transports(topic, direction)}, expected '
                            f'{expected}; {self.process.describe()}', timeout_s)

    def quit(self):
        self.process.say('quit')
        status = self.process.wait()
        if status != 0:
            raise BenchError(self.process.describe())

    def close(self):
        self.process.close()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        with contextlib.ExitStack() as stack:
            stack.callback(self.close)
            if kind is None:
                self.quit()


@dataclasses.dataclass(frozen=True)
class Arrival:
    """One message as its subscriber saw it."""
    sequence: int
    publish_ns: int
    arrival_ns: int

    def latency_ms(self):
        return (self.arrival_ns - self.publish_ns) / 1e6


def check_order(arrivals, what):
    """Raises BenchError if a message came twice or after a later one. @return the number of messages that are missing
    between the first and the last."""
    for before, after in zip(arrivals, arrivals[1:]):
        if after.sequence <= before.sequence:
            raise BenchError(f'{what}: message {after.sequence} arrived after {before.sequence}: '
                             f'{"repeated" if after.sequence == before.sequence else "repeated or out of order"}')
    return arrivals[-1].sequence - arrivals[0].sequence + 1 - len(arrivals) if arrivals else 0


def longest_gap_ms(arrivals):
    """Longest time between two arrivals [ms]."""
    return max((after.arrival_ns - before.arrival_ns for before, after in zip(arrivals, arrivals[1:])),
               default=0) / 1e6
