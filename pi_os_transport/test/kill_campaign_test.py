#!/usr/bin/python3 -B
"""Judge of kill_campaign.test: a short campaign; kill_campaign.py --kills 300 is the long one."""
import os
import re
import socket

import kill_campaign
import transport_harness as harness


class KillCampaign(harness.TransportTest):

    def test_survivors_lose_nothing(self):
        lines = []
        kills = 30 if self.preload else 12
        with kill_campaign.own_master():
            kill_campaign.Campaign(self.preload, kills=kills, seed=20, say=lines.append).run()
        print('\n'.join(lines))
        summary = next(line for line in lines if 'messages checked' in line)
        self.assertGreaterEqual(int(re.match(r'(\d+) kills', summary).group(1)), kills)
        self.assertGreater(int(re.search(r'(\d+) messages checked', summary).group(1)), 1000)

    def test_the_campaign_sees_what_is_left(self):
        # A judge that could not fail would be worth nothing: it must see a leftover of each kind.
        path = '/dev/shm/pi_os_test_%d' % os.getpid()
        before = set(os.listdir('/dev/shm'))
        campaign = kill_campaign.Campaign('', 1, 1)
        with open(path, 'w'):
            pass
        self.addCleanup(os.remove, path)
        with self.assertRaisesRegex(kill_campaign.Violation, 'dev/shm'):
            campaign.judge_leftovers(before)
        now = set(os.listdir('/dev/shm'))
        with socket.socket(socket.AF_UNIX) as left:
            left.bind('\0pi_os_transport_test_%d' % os.getpid())
            campaign.sockets = kill_campaign.sockets_of(os.getpid())
            with self.assertRaisesRegex(kill_campaign.Violation, 'net/unix'):
                campaign.judge_leftovers(now)
        child = self.process(['sleep', '60'])
        with self.assertRaisesRegex(kill_campaign.Violation, 'sleep'):
            campaign.judge_leftovers(now)
        child.close()
        with self.assertRaisesRegex(kill_campaign.Violation, 'lost'):
            campaign.judge('x', {'corrupt': 0, 'flows': {'1': {'lost': 1, 'reordered': 0}}})
        with self.assertRaisesRegex(kill_campaign.Violation, 'damaged'):
            campaign.judge('x', {'corrupt': 2, 'flows': {}})


if __name__ == '__main__':
    harness.main(KillCampaign)
