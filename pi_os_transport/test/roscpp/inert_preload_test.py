#!/usr/bin/python3 -B
"""Judge of inert_preload.test."""
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)

REPORT = '''
import json, os
files = sorted({line.split(None, 5)[5].strip() for line in open("/proc/self/maps") if "/" in line})
print(json.dumps({"maps": files, "threads": len(os.listdir("/proc/self/task")),
                  "descriptors": len(os.listdir("/proc/self/fd"))}))
'''


class InertPreload(harness.TransportTest):

    def run_with(self, preload, command, **options):
        environment = dict(os.environ)
        environment.pop('LD_PRELOAD', None)
        if preload:
            environment['LD_PRELOAD'] = preload
        return subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              timeout=harness.DEADLINE_S, **options)

    def test_same_result(self):
        for command in (['/bin/true'], ['/bin/false'], ['/bin/ls', '/'], ['/bin/bash', '-c', 'echo "$((6*7))"; exit 5'],
                        ['/bin/sh', '-c', '/bin/echo one | /bin/cat; exit 3'],
                        ['/usr/bin/python3', '-c', 'import sys, threading; print(7); sys.exit(9)'],
                        ['/usr/bin/python3', '-c', 'import rospy, rosgraph; print(rospy.__name__)']):
            plain, preloaded = (self.run_with(library, command) for library in ('', self.preload))
            self.assertEqual((plain.returncode, plain.stdout, plain.stderr),
                             (preloaded.returncode, preloaded.stdout, preloaded.stderr), command)

    def test_nothing_but_the_library_is_mapped(self):
        plain, preloaded = (harness.json.loads(self.run_with(library, ['/usr/bin/python3', '-c', REPORT]).stdout)
                            for library in ('', self.preload))
        more = set(preloaded['maps']) - set(plain['maps'])
        self.assertEqual(more, {os.path.realpath(self.preload)})
        self.assertEqual((preloaded['threads'], preloaded['descriptors']), (plain['threads'], plain['descriptors']))

    def test_program_ended_by_a_signal(self):
        result = self.run_with(self.preload, ['/bin/sh', '-c', 'kill -TERM $$'])
        self.assertEqual(result.returncode, -15)


if __name__ == '__main__':
    harness.main(InertPreload, plain=False, needs_library=True)
