#!/usr/bin/python3 -B
"""Judge of services_fork.test."""
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import services_judge  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402


class ServicesFork(services_judge.ServiceTest):

    def test_children_of_both_sides_during_calls(self):
        server, client = self.pair()
        self.start_calls(client, size=20000, answer=20000)
        for peer in (server, client):
            child = self.idle_child(peer)
            client.call('await_calls', n=50)
            harness.end_process(child)
            client.call('await_calls', n=50)
        report = client.call('stop_calls')
        self.assertEqual((report['failed'], report['wrong'], report['reconnected']), (0, 0, 0), report)

    def test_death_of_a_forked_server_is_seen(self):
        if not self.preload:
            self.skipTest('TCPROS does not see it: the child holds a copy of the socket')
        server, client = self.pair(mode='hold', threads=2)
        client.call('call', service=self.service, count=1, persistent=True, background=True, size=100000)
        server.call('await_served', service=self.service, n=1)
        self.await_rings(client, server)
        child = self.idle_child(server)
        server.kill()
        report = client.call('await_failed', n=1)
        self.assertFalse(report['valid'], report)
        os.kill(child, 0)

    def test_death_of_a_forked_client_is_seen(self):
        if not self.preload:
            self.skipTest('TCPROS does not see it: the child holds a copy of the socket')
        server, client = self.pair()
        self.start_calls(client)
        child = self.idle_child(client)
        client.kill()
        self.await_rings(server, of=0)
        os.kill(child, 0)


if __name__ == '__main__':
    harness.main(ServicesFork)
