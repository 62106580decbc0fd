#!/usr/bin/python3 -B
"""Judge of chaos_sweep.test."""
import re
import subprocess
import sys

import chaos
import sweep_victim
import sweep_worlds
import transport_harness as harness
from sweep_victim import Stop, Violation

VICTIMS = 'mixed|flood|core'  # one kind of traffic each, and the one that drops its oldest
POINTS = 250
PERIOD = 18  # stops of a thread in which each of its steps comes
RUNS = 3  # of a period until a step has come: each stop is of another run, whose threads take other turns
LEAST = 150  # points that are reached; the last stops of a thread are not there in every run


class ChaosSweep(harness.TransportTest):

    def sweep(self, *arguments):
        command = [sys.executable, '-B', chaos.__file__, '--preload=' + self.preload, '--sweep', *arguments]
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        print(result.stdout)
        return result

    @harness.needs_root
    def test_no_kill_costs_a_survivor_anything(self):
        result = self.sweep('--victims', VICTIMS, '--points', str(POINTS), '--seed', '7')
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertGreaterEqual(int(re.search(r'^(\d+) points in', result.stdout, re.M).group(1)), LEAST)
        self.assertIn('marked steps that no victim came across: none', result.stdout)

    def test_a_point_can_be_repeated(self):
        for kind, at in (('publisher/small', 'step push.tail'), ('subscriber/small', 'step take.head')):
            with self.subTest(kind):
                world = sweep_worlds.world_of(kind)(self.preload, kind, 'repeat')
                self.addCleanup(world.close)
                last = world.warm_up()[1]['stops']
                victim = max(range(len(last)), key=lambda thread: last[thread] if thread else 0)
                stops = [Stop(victim, last[victim] // 2 + number) for number in range(RUNS * PERIOD)]
                self.assertTrue(any(world.run(stop)['at'] == at for stop in stops), at)

    def test_the_sweep_sees_what_is_lost_and_what_is_left(self):
        kind = 'publisher/small'
        world = sweep_worlds.world_of(kind)(self.preload, kind, 'blind')
        self.addCleanup(world.close)
        world.warm_up()
        subscriber = world.subscribers[0]
        with self.assertRaisesRegex(Violation, '1 lost'):
            world.judge_flow(subscriber, {'corrupt': 0, 'flows': {'1': {'lost': 1, 'reordered': 0}}})
        with self.assertRaisesRegex(Violation, '1 out of order or twice'):
            world.judge_flow(subscriber, {'corrupt': 0, 'flows': {'1': {'lost': 0, 'reordered': 1}}})
        held = sweep_victim.Holdings(subscriber.pid)
        before = sweep_victim.Holdings(subscriber.pid)
        self.assertFalse(held.exceeds(before))
        held.exact['pi_os_ring'] += 1
        self.assertTrue(held.exceeds(before))
        with self.assertRaisesRegex(Violation, 'hangs'):
            hanging = sweep_victim.Victim(['/bin/sleep', '1000'], None)
            self.addCleanup(hanging.close)
            hanging.turns = 1
            hanging.finish()


if __name__ == '__main__':
    harness.main(ChaosSweep, plain=False, needs_library=True)
