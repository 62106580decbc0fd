"""Kills a process at every stop of a scenario, one after the other, and judges those who live through it.

    make chaos ARGS="--sweep"
    make chaos ARGS="--sweep --points 300 --seed 1"
    make chaos ARGS="--sweep --only='publisher/mixed:0:712'"

A stop is a system call, or a marked step of the link in shared memory (src/shm/step_mark.h). A point is victim, thread
and number of the stop in that thread: each victim runs to its end first, which tells how many there are. Victims and
scenarios: sweep_worlds.py. Behind every CONTROL_EVERY points a victim runs to its end undisturbed. Each violation is
printed with the command that repeats its point; at point 0:0 nobody was killed. Exit status 0: all held.
"""
import argparse
import collections
import concurrent.futures
import os
import random
import re
import sys
import threading
import time

import sweep_worlds
from sweep_victim import Stop, Violation, marked_steps

BATCH = 100          # points with the same survivors
CONTROL_EVERY = 25   # points between two victims that live to their end
MOST_VIOLATIONS = 20
NOBODY = Stop(0, 0)     # a stop that no victim reaches
ERRORS = (Violation, AssertionError, OSError)
CALLS = '/usr/include/%s/asm/unistd_64.h' % getattr(sys.implementation, '_multiarch', '')

Point = collections.namedtuple('Point', 'kind stop')
Batch = collections.namedtuple('Batch', 'kind stops')


def call_names():
    """Number -> name of the system calls of this machine; empty without the kernel's header."""
    try:
        with open(CALLS) as header:
            return {number: name for name, number in re.findall(r'^#define __NR_(\w+) (\d+)$', header.read(), re.M)}
    except FileNotFoundError:
        return {}


class Sweep:
    def __init__(self, preload, options, say):
        self.preload, self.options, self.say = preload, options, say
        self.lock = threading.Lock()
        self.stops = {}                       # victim -> stops of each thread
        self.done = collections.Counter()     # victim -> points at which it was killed
        self.unreached = collections.Counter()
        self.at = collections.Counter()       # what was killed at -> how often
        self.steps = collections.Counter()    # marked step -> how often a victim came across
        self.controls = 0
        self.checked = 0
        self.spared = 0                       # losses of a bridge that was taken for hung
        self.violations = []
        self.worlds = 0
        self.deadline = time.monotonic() + 60 * options.minutes

    # ---------------------------------------------------------------------------------------------------------- running

    def world(self, kind):
        with self.lock:
            self.worlds += 1
            name = str(self.worlds)
        return sweep_worlds.world_of(kind)(self.preload, kind, name)

    def close(self, world):
        world.close()
        with self.lock:
            self.checked += world.checked
            self.spared += world.spared

    def measure(self, kind):
        """How many stops each thread of a victim has."""
        world = self.world(kind)
        try:
            reports = world.warm_up()
        finally:
            self.close(world)
        longest = max(len(report['stops']) for report in reports)
        stops = [max((report['stops'] + [0] * longest)[thread] for report in reports) for thread in range(longest)]
        with self.lock:
            self.stops[kind] = stops
            for report in reports:
                self.steps.update(report['steps'])

    def note(self, kind, report):
        with self.lock:
            self.steps.update(report['steps'])
            if report['killed']:
                self.done[kind] += 1
                self.at[report['at']] += 1
            else:
                self.unreached[kind] += 1

    def violation(self, kind, stop, what):
        with self.lock:
            self.violations.append((kind, stop))
            self.say('VIOLATION make chaos ARGS="--sweep --only=\'%s:%s\'": %s'
                     % (kind, stop, ' '.join(str(what).split())))

    def points(self, kind, stops):
        """Runs points of one victim in a world of their own. @return what does not hold, and the points that may be to
        blame: one, all since the last victim that lived, or none"""
        world = None
        suspects = []
        try:
            world = self.world(kind)
            world.warm_up()
            for number, stop in enumerate(stops, 1):
                if time.monotonic() > self.deadline:
                    break
                suspects.append(stop)
                try:
                    self.note(kind, world.run(stop))
                except ERRORS as error:
                    return error, [stop]
                if number % CONTROL_EVERY == 0 or number == len(stops):
                    world.control()
                    self.controls += 1
                    suspects = []
        except ERRORS as error:
            return error, suspects
        finally:
            if world:
                self.close(world)
        return None, []

    def batch(self, batch):
        """Runs a batch; where something does not hold, finds its point and goes on behind it."""
        stops = list(batch.stops)
        while stops and len(self.violations) < MOST_VIOLATIONS and time.monotonic() < self.deadline:
            error, suspects = self.points(batch.kind, stops)
            if error is None:
                return
            blamed = NOBODY if not suspects else suspects[0] if len(suspects) == 1 else next(
                (stop for stop in reversed(suspects) if self.points(batch.kind, [stop])[0]), suspects[-1])
            self.violation(batch.kind, blamed, error)
            stops = stops[stops.index(suspects[-1]) + 1:] if suspects else stops

    # ----------------------------------------------------------------------------------------------------------- points

    def choose(self):
        """The points of this run, as batches."""
        points = [Point(kind, Stop(thread, number)) for kind in self.options.victims
                  for thread, count in enumerate(self.stops[kind]) for number in range(1, count + 1)]
        if self.options.points:
            points = sorted(random.Random(self.options.seed).sample(points, min(self.options.points, len(points))))
        for kind in self.options.victims:
            own = [point.stop for point in points if point.kind == kind]
            for begin in range(0, len(own), BATCH):
                yield Batch(kind, own[begin:begin + BATCH])

    def run(self):
        begun = time.monotonic()
        shm = set(os.listdir('/dev/shm'))
        with concurrent.futures.ThreadPoolExecutor(self.options.jobs) as pool:
            list(pool.map(self.measure, self.options.victims))
            for kind in self.options.victims:
                self.say('%-16s %5d stops: %s' % (kind, sum(self.stops[kind]), self.stops[kind]))
            list(pool.map(self.batch, list(self.choose())))
        left = set(os.listdir('/dev/shm')) - shm
        if left:
            self.violation('all', '', 'left in /dev/shm: %s' % sorted(left))
        self.report(time.monotonic() - begun)
        return not self.violations

    def only(self, point):
        """One point, with a victim that lives to its end before and behind it."""
        kind, thread, number = re.fullmatch(r'(.+):(\d+):(\d+)', point).groups()
        stop = Stop(int(thread), int(number))
        for _ in range(self.options.repeat):
            error, _ = self.points(kind, [stop])
            if error:
                self.violation(kind, stop, error)
        self.say('%s:%s: killed %d times at %s'
                 % (kind, stop, self.done[kind], ', '.join(self.places(10)) or 'no stop'))
        return not self.violations

    def places(self, most):
        names = call_names()

        def place(at):
            kind, what = at.split()
            return '%s %s' % (kind, names.get(what, what) if kind == 'call' else what)
        return ['%d %s' % (times, place(at)) for at, times in self.at.most_common(most)]

    def report(self, took):
        total = sum(self.done.values())
        self.say('\n%d points in %.0f s (%.0f per minute), %d controls'
                 % (total, took, 60 * total / took, self.controls))
        for kind in self.options.victims:
            self.say('  %6d  %s%s' % (self.done[kind], kind, ', %d that this run did not reach' % self.unreached[kind]
                                      if self.unreached[kind] else ''))
        missed = sum(map(sum, self.stops.values())) - total - sum(self.unreached.values())
        if missed and not self.options.points:
            self.say('  %6d  not run: the time was over, or there were too many violations' % missed)
        calls = sum(times for at, times in self.at.items() if at.startswith('call'))
        self.say('  %6d  system calls, most often %s' % (calls, ', '.join(self.places(12))))
        self.say('  %6d  marked steps' % (total - calls))
        never = marked_steps(self.preload) - set(self.steps)
        self.say('marked steps that no victim came across: %s' % (', '.join(sorted(never)) or 'none'))
        if self.spared:
            self.say('%d times messages were lost because a bridge had stood still and was taken for hung' % self.spared)
        self.say('%d messages checked; %d violations%s'
                 % (self.checked, len(self.violations), '' if self.violations else
                    ': 0 hangs, 0 lost, damaged or out of order between survivors, 0 leftovers'))


def victims(text):
    chosen = [kind for kind in sweep_worlds.VICTIMS if re.search(text, kind)]
    if not chosen:
        raise argparse.ArgumentTypeError('%s: none of %s' % (text, ', '.join(sweep_worlds.VICTIMS)))
    return chosen


def main(preload, arguments):
    """@return the exit status of the program."""
    parser = argparse.ArgumentParser(prog='chaos.py', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--sweep', action='store_true')
    parser.add_argument('--points', type=int, default=0, help='a random choice of so many points; 0: all')
    parser.add_argument('--seed', type=int, default=1, help='of that choice')
    parser.add_argument('--victims', type=victims, default=sweep_worlds.VICTIMS, help='those that match an expression')
    parser.add_argument('--only', help='VICTIM:THREAD:N: one point')
    parser.add_argument('--repeat', type=int, default=1, help='of --only')
    parser.add_argument('--minutes', type=float, default=600, help='ends after that')
    parser.add_argument('--jobs', type=int, default=3 * os.cpu_count(), help='victims at a time')
    options, _ = parser.parse_known_args(arguments)
    sweep = Sweep(preload, options, lambda line: print(line, flush=True))
    return 0 if (sweep.only(options.only) if options.only else sweep.run()) else 1
