"""What is measured between devices, and the plan that measures it over modes and rounds."""

import contextlib
import dataclasses
import time

from .device_keys import make_keys
from .device_nodes import PROTECTED, DeviceGroup, FlowNode, check_order, longest_gap_ms
from .devices import Testbed, await_state
from .hostile import Attacker, Recorder
from .measurements import measure_latency, percentile
from .modes import FULL_HD, BenchError

MEASURES = ('wire', 'throughput', 'latency', 'priority', 'cut', 'kill', 'hostile')
MB = 1000000
FIVE = 5

WIRE_HZ = 20.0
GIGABIT = 1000              # [Mbit/s]
THROUGHPUT_WINDOW = 8       # messages ahead of the slowest acknowledgement

IMU_BYTES, IMU_HZ, IMU_QUEUE = 320, 200.0, 1000
IMAGE_HZ, IMAGE_QUEUE = 10.0, 2
PRIORITY_MBIT = (100, 300)

CUT_BYTES, CUT_HZ, CUT_QUEUE = 100000, 50.0, 10
CUT_RESUME_DEADLINE_S = 60.0
CUT_AFTERWARDS_S = 2.0      # how long arrivals are recorded once traffic has resumed: old messages come late as well

KILL_BYTES, KILL_HZ, KILL_QUEUE = 50000, 100.0, 1000
KILL_DEADLINE_S = 20.0

HOSTILE_BYTES, HOSTILE_HZ = 100000, 100.0
HOSTILE_SEED = 20
RECORD_S = 1.0              # of traffic whose frames are mutated
ARRIVAL_DEADLINE_S = 20.0


@dataclasses.dataclass
class DevicePlan:
    """What one comparison measures."""
    modes: list
    rounds: int = 3
    measures: tuple = MEASURES
    wire_subscribers: tuple = (1, 2, 4, 8)
    wire_messages: int = 60
    throughput_bytes: int = 300 * MB
    latency_sizes: tuple = (1000, 100000, MB)
    latency_subscribers: tuple = (1, FIVE)
    latency_s: float = 2.0
    priority_s: float = 10.0
    priority_mbit: tuple = PRIORITY_MBIT
    cut_s: float = 10.0
    kills: int = 100
    frames: int = 10000

    @classmethod
    def quick(cls, modes):
        return cls(modes=modes, rounds=1, wire_subscribers=(1, 4), wire_messages=20, throughput_bytes=50 * MB,
                   latency_s=0.5, priority_s=3.0, priority_mbit=PRIORITY_MBIT[-1:], cut_s=4.0, kills=4, frames=500)


class Flow:
    """One topic from a device to another one, with a process at each end; records what arrives."""

    def __init__(self, comparison, mode, name, size, queue, source, target, subscriber_queue=1000):
        self.topic = '/' + name
        self.arrivals = []
        self._stack = contextlib.ExitStack()
        try:
            self.out, self.into = (
                self._stack.enter_context(FlowNode(device, f'{name}_{way}', mode, comparison.library))
                for device, way in ((source, 'out'), (target, 'in')))
            self.out.advertise(self.topic, size, queue)
            self.into.subscribe(self.topic, size, subscriber_queue)
            self.await_transport(mode.transport)
        except BaseException:
            self._stack.close()
            raise

    def await_transport(self, transport, timeout_s=KILL_DEADLINE_S):
        self.into.await_transports(self.topic, 'i', [transport], timeout_s)
        self.out.await_transports(self.topic, 'o', [transport], timeout_s)

    def take(self):
        """Adds what has arrived. @return the new arrivals, after a check of the order of all."""
        new = self.into.take(self.topic)
        check_order(self.arrivals[-1:] + new, self.topic)
        self.arrivals += new
        return new

    def await_arrival(self, published_ns, timeout_s, what):
        """Waits for a message published at or after a time. @return it."""
        def arrived():
            self.take()
            return next((arrival for arrival in reversed(self.arrivals) if arrival.publish_ns >= published_ns), None)
        return await_state(arrived, what, timeout_s)

    def finish(self):
        """Stops the publisher and waits for its last message. @return (published, lost)"""
        published = self.out.stop(self.topic)

        def last_arrived():
            self.take()
            return self.arrivals and self.arrivals[-1].sequence == published - 1
        await_state(last_arrived, lambda: f'{self.topic}: last message of {published}, newest is '
                    f'{self.arrivals[-1].sequence if self.arrivals else "none"}', ARRIVAL_DEADLINE_S)
        return published, check_order(self.arrivals, self.topic)

    def __enter__(self):
        return self

    def __exit__(self, *raised):
        return self._stack.__exit__(*raised)


class DeviceComparison:
    """Runs a plan on a test bed of its own; rows of all rounds collect in `rows`, what failed in `failures`."""

    def __init__(self, plan, library=None, progress=lambda text: None):
        self.plan, self.library, self.progress = plan, library, progress
        self.rows = []
        self.failures = []
        self.congestion_control = None

    def run(self):
        for round_number in range(self.plan.rounds):
            shift = round_number % len(self.plan.modes)
            modes = self.plan.modes[shift:] + self.plan.modes[:shift]
            self.progress(f'round {round_number + 1} of {self.plan.rounds}: ' + ', '.join(mode.label for mode in modes))
            for measure in self.plan.measures:
                if measure in ('kill', 'hostile'):
                    # Each is one long campaign of what only bridges have; it is not repeated per round.
                    modes_here = [mode for mode in modes if mode.key == 'pi_os'] if round_number == 0 else []
                else:
                    modes_here = modes
                for mode in modes_here:
                    self.progress(f'  {measure}: {mode.label}')
                    self._measure(round_number, measure, mode)
        return self.rows

    def _measure(self, round_number, measure, mode):
        """One measure in one mode, on devices of its own. What fails does not keep the others from being measured."""
        try:
            with Testbed() as testbed:
                self.congestion_control = testbed.vehicle.congestion_control
                bridges = {}
                if mode.preload:
                    keys = make_keys(testbed) if mode.key == PROTECTED else {}
                    bridges = {name: device.start_bridge(*mode.bridge_args, *keys.get(name, ()))
                               for name, device in testbed.devices.items()}
                for row in getattr(self, '_' + measure)(testbed, mode, bridges):
                    self.rows.append({'round': round_number, 'measure': measure, 'mode': mode.key, **row})
                for bridge in bridges.values():
                    if bridge.terminate() != 0:
                        raise BenchError(f'the bridge did not end in order: {bridge.describe()}')
        except BenchError as error:
            self.failures.append(f'{measure}, {mode.label}, round {round_number + 1}: {error}')
            self.progress('    FAILED: ' + self.failures[-1])

    def _group(self, testbed, mode, subscribers):
        return DeviceGroup(testbed, mode, testbed.vehicle, [testbed.edge_a] * subscribers, self.library)

    def _wire(self, testbed, mode, _):
        """Bytes on the vehicle's cable per message of 1 MB."""
        for number in self.plan.wire_subscribers:
            with self._group(testbed, mode, number) as group:
                group.run(5, MB, WIRE_HZ)
                before = testbed.vehicle.counters()
                group.run(self.plan.wire_messages, MB, WIRE_HZ)
                after = testbed.vehicle.counters()
                group.verify_links()
                yield {'subscribers': number, 'size': MB, 'messages': self.plan.wire_messages,
                       'sent_per_message': (after['sent'] - before['sent']) / self.plan.wire_messages,
                       'received_per_message': (after['received'] - before['received']) / self.plan.wire_messages}

    def _throughput(self, testbed, mode, _):
        testbed.edge_a.shape(rate_mbit=GIGABIT)
        with self._group(testbed, mode, FIVE) as group:
            count = max(self.plan.throughput_bytes // MB, 5 * THROUGHPUT_WINDOW)
            group.run(THROUGHPUT_WINDOW, MB, window=THROUGHPUT_WINDOW, period=3, check='sample')
            publisher, answers, _ = group.run(count, MB, window=THROUGHPUT_WINDOW, period=3, check='sample')
            group.verify_links()
        seconds = (max(answer['last_ns'] for answer in answers) - publisher['start_ns']) / 1e9
        yield {'subscribers': FIVE, 'size': MB, 'messages': count, 'window': THROUGHPUT_WINDOW,
               'messages_per_s': count / seconds, 'delivered_mbit': FIVE * count * MB * 8 / seconds / 1e6}

    def _latency(self, testbed, mode, _):
        for number in self.plan.latency_subscribers:
            with self._group(testbed, mode, number) as group:
                for size in self.plan.latency_sizes:
                    row = measure_latency(group, size, self.plan.latency_s)
                    del row['cpu_us'], row['bench_cpu_us']  # without the bridges they would not compare
                    yield row
                group.verify_links()

    def _priority(self, testbed, mode, _):
        for mbit in self.plan.priority_mbit:
            testbed.edge_a.shape(rate_mbit=mbit)
            yield {'mbit': mbit, **self._measure_priority(testbed, mode, mbit)}

    def _measure_priority(self, testbed, mode, mbit):
        ends = (testbed.vehicle, testbed.edge_a)
        with Flow(self, mode, f'imu{mbit}', IMU_BYTES, IMU_QUEUE, *ends) as imu, \
                Flow(self, mode, f'image{mbit}', FULL_HD, IMAGE_QUEUE, *ends) as image:
            image.out.start(image.topic, IMAGE_HZ)
            await_state(image.take, 'first image', ARRIVAL_DEADLINE_S)
            begin_ns = time.monotonic_ns()
            imu.out.start(imu.topic, IMU_HZ)
            time.sleep(self.plan.priority_s)  # the interval that is measured
            published, lost = imu.finish()
            image.take()
            seconds = (time.monotonic_ns() - begin_ns) / 1e9
            images = sum(arrival.arrival_ns >= begin_ns for arrival in image.arrivals)
            image.out.stop(image.topic)
        if lost or len(imu.arrivals) != published:
            raise BenchError(f'{published - len(imu.arrivals)} of {published} small messages were lost')
        latencies = [arrival.latency_ms() for arrival in imu.arrivals]
        return {'messages': published, 'p50_ms': percentile(latencies, 50), 'p99_ms': percentile(latencies, 99),
                'max_ms': max(latencies), 'image_mbit': images * FULL_HD * 8 / 1e6 / seconds}

    def _cut(self, testbed, mode, _):
        with Flow(self, mode, 'cut', CUT_BYTES, CUT_QUEUE, testbed.vehicle, testbed.edge_a) as flow:
            flow.out.start(flow.topic, CUT_HZ)
            for how in ('loss', 'down'):
                flow.await_arrival(time.monotonic_ns(), ARRIVAL_DEADLINE_S, 'traffic before the cut')
                testbed.edge_a.cut(how)
                time.sleep(self.plan.cut_s)  # the length of the cut
                flow.take()
                seen = len(flow.arrivals)
                restored_ns = time.monotonic_ns()
                testbed.edge_a.restore()
                await_state(lambda: len(flow.arrivals) > seen or flow.take(), 'message after the cut',
                            CUT_RESUME_DEADLINE_S)
                fresh = flow.await_arrival(restored_ns, CUT_RESUME_DEADLINE_S, 'new message after the cut')
                time.sleep(CUT_AFTERWARDS_S)  # what is still old arrives meanwhile
                flow.take()
                after = flow.arrivals[seen:]
                yield {'how': how, 'seconds': self.plan.cut_s,
                       'first_ms': (after[0].arrival_ns - restored_ns) / 1e6,
                       'fresh_ms': (fresh.arrival_ns - restored_ns) / 1e6,
                       'oldest_ms': max(arrival.latency_ms() for arrival in after),
                       'old': sum(arrival.publish_ns < restored_ns for arrival in after)}
            flow.finish()

    def _kill(self, testbed, mode, bridges):
        """SIGKILL to the bridge of either side in turn; a new one is started as soon as traffic goes on."""
        with Flow(self, mode, 'kill', KILL_BYTES, KILL_QUEUE, testbed.vehicle, testbed.edge_a) as flow:
            flow.out.start(flow.topic, KILL_HZ)
            flow.await_arrival(time.monotonic_ns(), ARRIVAL_DEADLINE_S, 'traffic before the first kill')
            gaps = []
            for number in range(self.plan.kills):
                name = ('vehicle', 'edge_a')[number % 2]
                flow.take()
                seen = len(flow.arrivals)
                killed_ns = time.monotonic_ns()
                bridges[name].kill()
                flow.await_arrival(killed_ns, KILL_DEADLINE_S,
                                   f'message after kill {number + 1}, of the bridge on {name}')
                bridges[name] = testbed.devices[name].start_bridge()
                flow.await_transport(mode.transport)
                flow.await_arrival(time.monotonic_ns(), KILL_DEADLINE_S, f'message over the new bridge on {name}')
                gaps.append(longest_gap_ms(flow.arrivals[seen - 1:]))
            published, lost = flow.finish()
        yield {'kills': self.plan.kills, 'messages': published, 'lost': lost, 'gap_max_ms': max(gaps),
               'gap_p50_ms': percentile(gaps, 50), 'gaps_ms': gaps}

    def _hostile(self, testbed, mode, bridges):
        recorder = Recorder(testbed, testbed.vehicle)
        with Flow(self, mode, 'hostile', HOSTILE_BYTES, KILL_QUEUE, testbed.edge_a, testbed.vehicle) as flow:
            flow.out.start(flow.topic, HOSTILE_HZ)
            time.sleep(RECORD_S)  # the traffic that is recorded
            attacker = Attacker(testbed.edge_b, testbed.vehicle.address, recorder.stop(), HOSTILE_SEED)
            # Whoever overhears a session could go on with it: what is recorded is of an earlier one.
            bridges['vehicle'].kill()
            bridge = bridges['vehicle'] = testbed.vehicle.start_bridge()
            flow.await_transport(mode.transport)
            flow.await_arrival(time.monotonic_ns(), KILL_DEADLINE_S, 'traffic over the new bridge')
            flow.arrivals.clear()
            before = flow.await_arrival(time.monotonic_ns(), KILL_DEADLINE_S, 'traffic before the attack').sequence
            refused, resident_kb = bridge.refused(), bridge.resident_kb()
            begin = time.monotonic()
            attacker.send(self.plan.frames)
            seconds = time.monotonic() - begin
            refused = {reason: count - refused[reason] for reason, count in bridge.refused().items()}
            growth_kb = bridge.resident_kb() - resident_kb
            published, lost = flow.finish()
            flow.await_transport(mode.transport)
        if lost:
            raise BenchError(f'{lost} of {published - before} messages were lost under attack')
        yield {'frames': sum(attacker.sent.values()), 'unended': attacker.unended, 'seconds': seconds,
               'messages': published - before, 'gap_max_ms': longest_gap_ms(flow.arrivals), 'growth_kb': growth_kb,
               'refused': refused, 'kinds': dict(attacker.sent)}
