"""Statistics over the measured rows, the bars they meet or miss, and the machine they come from."""

import contextlib
import dataclasses
import os
import platform
import re
import statistics
import subprocess

from .modes import FULL_HD, format_size


class Results:
    """Medians and ratios over the rows of a comparison."""

    def __init__(self, rows):
        self.rows = rows

    def values(self, measure, field, **match):
        """{round: value}"""
        return {row.get('round', 0): row[field] for row in self.rows
                if row['measure'] == measure and all(row.get(key) == value for key, value in match.items())
                and row[field] is not None}

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
    for cell in dict.fromkeys(row['cell'] for row in results.rows if row['measure'] == 'small'):
        add(f'small messages, {cell}: CPU of all nodes π-OS/TCPROS',
            results.ratio('small', 'all_us', 'pi_os', 'tcpros', cell=cell), 1.0, False)
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
