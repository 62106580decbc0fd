#!/usr/bin/python3 -B
"""Judge of services_killed.test."""
import random

import services_judge
import transport_harness as harness

PROMPT_S = 3.0  # a waiting call is woken by the end of a socket; the rest is the load of the machine
ROUNDS = 20


class ServicesKilled(services_judge.ServiceTest):

    def test_a_waiting_call_fails_when_the_server_is_killed(self):
        for size in (80, 1000000):
            with self.subTest(size=size):
                server, client = self.pair(mode='hold', threads=2)
                client.call('call', service=self.service, count=1, persistent=True, background=True, size=size)
                server.call('await_served', service=self.service, n=1)
                server.kill()
                report = client.call('await_failed', n=1, timeout=PROMPT_S)
                self.assertEqual((report['failed'], report['wrong'], report['valid']), (1, 0, False), report)
                server.close()
                client.close()

    def test_servers_killed_at_any_moment(self):
        chosen = random.Random(11)
        self.service = self.topic('service')
        persistent, single = self.peers('persistent', 'single', kind='service_peer')
        server = self.service_peer('server')
        server.call('serve', service=self.service)
        for client in (persistent, single):
            client.call('await_service', service=self.service)
            client.call('call', service=self.service, count=0, size=2000, answer=3000, persistent=client is persistent,
                        renew=True, background=True)
        for life in range(ROUNDS):
            for client in (persistent, single):
                client.call('await_calls', n=chosen.randrange(1, 40))
            server.kill()
            server.close()
            server = self.service_peer('server')
            server.call('serve', service=self.service)
        for client in (persistent, single):
            client.call('await_calls', n=20)
            report = client.call('stop_calls')
            self.assertEqual(report['wrong'], 0, report)
        self.assertEqual(server.call('served', service=self.service)['wrong'], 0)
        self.await_rings(persistent, single, server, of=0)

    def test_clients_killed_at_any_moment(self):
        chosen = random.Random(12)
        server, steady = self.pair(threads=2)
        self.start_calls(steady, size=2000, answer=3000)
        before = None
        for life in range(ROUNDS):
            victim = self.service_peer('victim')
            victim.call('call', service=self.service, count=0, size=200000, answer=300000,
                        persistent=life % 2 == 0, background=True)
            victim.call('await_calls', n=chosen.randrange(1, 20))
            victim.kill()
            victim.close()
            self.await_rings(server, of=1)
            if life == 4:
                before = harness.Footprint(server.pid)
        after = harness.Footprint(server.pid)
        self.assertLessEqual(after.files, before.files + 4, (before, after))
        self.assertLessEqual(after.memfd, before.memfd + 2048, (before, after))
        report = steady.call('stop_calls')
        self.assertEqual((report['failed'], report['wrong']), (0, 0), report)
        self.assertEqual(server.call('served', service=self.service)['wrong'], 0)


if __name__ == '__main__':
    harness.main(ServicesKilled)
