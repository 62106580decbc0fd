#!/usr/bin/python3 -B
"""Judge of chaos.test."""
import re
import subprocess
import sys

import chaos
import chaos_disturbances
import transport_harness as harness

KILLS = 100
NODES = 20
LARGEST_MB = 16


class ChaosTest(harness.TransportTest):

    def test_survivors_notice_nothing(self):
        result = subprocess.run([sys.executable, '-B', chaos.__file__, '--preload=' + self.preload,
                                 '--kills=%d' % KILLS, '--seed=7', '--nodes=%d' % NODES, '--largest-mb=%d' % LARGEST_MB],
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        output = result.stdout.decode('utf-8', 'replace')
        print(output)
        self.assertEqual(result.returncode, 0, output)
        self.assertGreaterEqual(int(re.search(r'^(\d+) kills in', output, re.M).group(1)), KILLS)
        for kind in list(chaos_disturbances.DISTURBANCES) + list(chaos_disturbances.RARE):
            self.assertRegex(output, r'(?m)^ +(\d+|none) +%s' % re.escape(kind))
        self.assertGreater(int(re.search(r'^(\d+) messages checked: 0 hangs', output, re.M).group(1)), 1000)


if __name__ == '__main__':
    harness.main(ChaosTest, plain=False, needs_library=True)
