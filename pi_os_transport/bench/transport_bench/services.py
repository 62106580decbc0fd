"""Services and actions: a client and a server over the transport of one mode, alternating."""

import statistics

from .group import Group
from .measurements import percentile
from .modes import BenchError, MODES, format_size
from .output import format_number, format_ratio, format_table
from .results import Bar

SIZES = (64, 1000, 16000, 256000, 1000000, 6220800)
FEEDBACK = 5             # messages of one goal
VOLUME = 200e6           # bytes of one measurement at most, and
CALLS = (30, 1000)       # calls of one measurement, least and most
SINGLE_SHOT_CALLS = 100  # each asks the master
GOALS = 100
WARM_UP = 10
CALL_S = 0.1             # more than one call takes, for the deadline
PERSISTENT_BAR = 1.5
ACTION_BAR = 1.0


class Pair(Group):
    """One client and one server of the services bench."""

    def __init__(self, master, mode, library):
        super().__init__(master, mode, 0, library)

    def _start(self, name, program, args, env):
        if not self.nodes:
            self.server = super()._start('server', 'bench_service', ('--server',), env)
        return super()._start('client', 'bench_service', (), env)

    def wrong_links(self):
        return ''  # services are in no getBusInfo; verify_links() is for topics

    def ask(self, count, answer, *command):
        """@return the times of `count` calls or goals [us], without the first ones"""
        self.publisher.tell(command[0], count + WARM_UP, *command[1:])
        events = self.await_events({self.publisher: answer}, self.answer_s + CALL_S * (count + WARM_UP))
        return events[self.publisher]['times_us'][WARM_UP:]


class ServiceComparison:
    """Alternates the modes, round by round, in rotated order. Rows are as those of Comparison."""

    def __init__(self, master, library, modes, rounds, sizes, say):
        self.master, self.library, self.modes, self.rounds, self.sizes = master, library, modes, rounds, sizes
        self.say = say
        self.rows = []
        self.warnings = []

    def run(self):
        for number in range(self.rounds):
            shift = number % len(self.modes)
            for mode in self.modes[shift:] + self.modes[:shift]:
                self.say(f'round {number + 1} of {self.rounds}: {mode.label}')
                with Pair(self.master, mode, self.library) as pair:
                    self.measure(pair, mode, number)
                    self.warnings += pair.warnings()

    def measure(self, pair, mode, number):
        for size in self.sizes:
            count = int(min(max(VOLUME / size, CALLS[0]), CALLS[1]))
            pair.doing = f'persistent calls of {format_size(size)}'
            for way, request, answer in (('request', size, 20), ('answer', 20, size)):
                self.add('persistent', mode, number, size, way, pair.ask(count, 'called', 'call', request, answer, 1))
                if size == self.sizes[0]:
                    break
        for size in (self.sizes[0], self.sizes[-1]):
            pair.doing = f'single-shot calls of {format_size(size)}'
            count = SINGLE_SHOT_CALLS if size < 1000000 else CALLS[0]
            self.add('single-shot', mode, number, size, 'request', pair.ask(count, 'called', 'call', size, 20, 0))
        pair.doing = 'goals'
        self.add('action', mode, number, 0, f'{FEEDBACK} feedback', pair.ask(GOALS, 'acted', 'act', FEEDBACK))

    def add(self, measure, mode, number, size, way, times_us):
        ordered = sorted(times_us)
        self.rows.append({'measure': measure, 'mode': mode.key, 'round': number, 'size': size, 'way': way,
                          'count': len(ordered), 'mean_us': statistics.mean(ordered),
                          'p50_us': percentile(ordered, 50), 'p90_us': percentile(ordered, 90),
                          'p99_us': percentile(ordered, 99), 'max_us': ordered[-1]})


def table(results, modes):
    kinds = dict.fromkeys((row['measure'], row['size'], row['way']) for row in results.rows)
    rows = []
    for measure, size, way in kinds:
        match = {'size': size, 'way': way}
        cells = [measure, format_size(size) if size else '', way]
        for mode in modes:
            cells.append('/'.join(format_number(results.median(measure, f'{p}_us', mode=mode.key, **match))
                                  for p in ('p50', 'p90', 'p99', 'max')))
        rows.append(cells + [format_ratio(results.ratio(measure, 'p50_us', 'tcpros', 'pi_os', **match)),
                             format_ratio(results.ratio(measure, 'p99_us', 'tcpros', 'pi_os', **match))])
    return ('Round trip of a call, and from goal to result, p50/p90/p99/max [us]; ratios: median of the rounds '
            '(min..max)\n' +
            format_table(['', 'size', 'of'] + [mode.label for mode in modes] +
                         ['p50 TCPROS/π-OS', 'p99 TCPROS/π-OS'], rows))


def bars(results):
    found = []
    for measure, size, way in dict.fromkeys((row['measure'], row['size'], row['way']) for row in results.rows):
        ratio = results.ratio(measure, 'p50_us', 'tcpros', 'pi_os', size=size, way=way)
        if ratio and measure == 'persistent':
            found.append(Bar(f'persistent, {format_size(size)} {way}: p50 TCPROS/π-OS', ratio, PERSISTENT_BAR, True))
        elif ratio and measure == 'action':
            found.append(Bar('action, goal to result: p50 TCPROS/π-OS', ratio, ACTION_BAR, True))
    return found


def stock_and_pi_os():
    return [MODES['tcpros'], MODES['pi_os']]


__all__ = ['BenchError', 'ServiceComparison', 'SIZES', 'bars', 'stock_and_pi_os', 'table']
