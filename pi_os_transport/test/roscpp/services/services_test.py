#!/usr/bin/python3 -B
"""Judge of services.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import services_judge  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

MB = 1000000


class Services(services_judge.ServiceTest):

    def test_calls_of_all_sizes(self):
        server, client = self.pair()
        calls = 0
        for persistent in (True, False):
            for size, answer in ((0, 0), (8, 1), (80, 20), (4096, 70000), (MB, MB), (6 * MB, 20), (80, 6 * MB)):
                with self.subTest(persistent=persistent, size=size, answer=answer):
                    count = 20 if max(size, answer) < MB else 4
                    calls += count
                    self.assert_calls(client.call('call', service=self.service, count=count, size=size, answer=answer,
                                                  persistent=persistent), count)
        report = server.call('served', service=self.service)
        self.assertEqual((report['calls'], report['wrong']), (calls, 0))
        self.assertEqual(sorted(report['header']), ['callerid', 'md5sum', 'persistent', 'service'])
        self.assert_no_warning(server, client)

    def test_a_persistent_client_uses_shared_memory(self):
        server, client = self.pair()
        self.start_calls(client, rate=100)
        self.await_rings(server)
        report = client.call('stop_calls')
        self.assertEqual((report['failed'], report['wrong'], report['reconnected']), (0, 0, 0), report)

    def test_a_single_shot_client_uses_shared_memory(self):
        server, client = self.pair()
        client.call('call', service=self.service, count=0, background=True, rate=100)
        self.await_rings(client, server)
        report = client.call('stop_calls')
        self.assertEqual((report['failed'], report['wrong']), (0, 0), report)

    def test_single_shot_calls_of_several_nodes_at_once(self):
        server, client = self.pair(threads=4)
        others = self.peers('second', 'third', kind='service_peer')
        for size in (80, 200000):
            for peer in [client] + others:
                peer.send('call', service=self.service, count=300, size=size, answer=900)
            for peer in [client] + others:
                self.assert_calls(peer.result(), 300)
        self.assertEqual(server.call('served', service=self.service)['wrong'], 0)

    def test_single_shot_clients_leave_nothing_behind(self):
        server, client = self.pair()
        self.assert_calls(client.call('call', service=self.service, count=1), 1)
        before = self.files(client), self.files(server)
        self.assert_calls(client.call('call', service=self.service, count=200, size=8000), 200)
        self.await_rings(client, server, of=0)  # the connection that was kept ends some seconds after its last call
        harness.await_state(lambda: self.files(client) <= before[0] + 1 and self.files(server) <= before[1] + 1,
                            lambda: 'descriptors: %s before, now %d and %d'
                            % (before, self.files(client), self.files(server)))

    def test_several_threads_on_one_persistent_handle(self):
        server, client = self.pair(threads=4)
        report = client.call('share', service=self.service, threads=6, count=200, size=800, answer=2000)
        self.assertEqual((report['failed'], report['wrong']), (0, 0))
        self.assertEqual(server.call('served', service=self.service)['calls'], 1200)

    def test_many_clients_of_one_server(self):
        server, first = self.pair()
        clients = [first] + self.peers('second', 'third', kind='service_peer')
        for persistent in (True, False):
            for client in clients:
                client.send('call', service=self.service, count=200, size=800, answer=900, persistent=persistent)
            for client in clients:
                self.assert_calls(client.result(), 200)
        self.assertEqual(server.call('served', service=self.service)['wrong'], 0)

    def test_an_exception_in_the_callback(self):
        server, client = self.pair(mode='throw')
        for persistent in (True, False):
            report = client.call('call', service=self.service, count=10, persistent=persistent)
            self.assert_calls(report, 10, failed=10)
            self.assertTrue(report['valid'])
            self.assertEqual(report['reconnected'], 0)
        for peer, text in ((client, 'responded with an error: thrown on purpose'),
                           (server, 'Exception thrown while processing service call: thrown on purpose')):
            harness.await_state(lambda: len(peer.output(text)) == 20, lambda: '%s wrote %s' % (peer.name, peer.lines))

    def test_a_callback_that_returns_false(self):
        server, client = self.pair(mode='refuse')
        for persistent in (True, False):
            report = client.call('call', service=self.service, count=10, persistent=persistent)
            self.assert_calls(report, 10, failed=10)
            self.assertTrue(report['valid'])
        self.assertEqual(server.call('served', service=self.service)['calls'], 20)

    def test_a_call_of_another_type(self):
        server, client = self.pair()
        for persistent in (True, False):
            self.assertFalse(client.call('call_as_empty', service=self.service, persistent=persistent)['called'])
        self.assertEqual(server.call('served', service=self.service)['calls'], 0)
        self.assert_calls(client.call('call', service=self.service, count=10), 10)

    def test_the_server_unadvertises(self):
        server, client = self.pair()
        self.start_calls(client, rate=200)
        server.call('unserve', service=self.service)
        report = client.call('await_failed', n=1)
        self.assertFalse(report['valid'], report)
        server.call('serve', service=self.service)
        report = client.call('await_calls', n=20)   # the caller makes its client anew
        self.assertEqual(report['wrong'], 0)
        self.assertTrue(client.call('stop_calls')['valid'])

    def test_unadvertising_under_single_shot_calls(self):
        server, client = self.pair()
        client.call('call', service=self.service, count=0, background=True)
        for _ in range(10):
            client.call('await_calls', n=20)
            server.call('unserve', service=self.service)
            server.call('serve', service=self.service)
        report = client.call('stop_calls')
        self.assertEqual(report['wrong'], 0, report)
        # A connection that was kept from before must not cost a call that would find the new server.
        server.call('unserve', service=self.service)
        server.call('serve', service=self.service)
        self.assert_calls(client.call('call', service=self.service, count=50), 50)

    def test_the_last_provider_serves(self):
        server, client = self.pair()
        self.assert_calls(client.call('call', service=self.service, count=20), 20)
        second = self.service_peer('second')
        second.call('serve', service=self.service)
        self.assert_calls(client.call('call', service=self.service, count=20), 20)
        self.assertEqual(server.call('served', service=self.service)['calls'], 20)
        self.assertEqual(second.call('served', service=self.service)['calls'], 20)

    def test_shutdown_of_a_client_that_waits(self):
        server, client = self.pair(mode='hold', threads=2)
        client.call('call', service=self.service, count=1, persistent=True, background=True, size=100000)
        server.call('await_served', service=self.service, n=1)
        client.call('shutdown_client')
        self.assertEqual(client.call('await_failed', n=1)['failed'], 1)
        server.call('release', service=self.service)
        client.call('stop_calls')
        self.assert_calls(client.call('call', service=self.service, count=10, persistent=True), 10)

    def test_an_orderly_end_of_a_node_whose_client_waits(self):
        server, client = self.pair(mode='hold', threads=2)
        client.call('call', service=self.service, count=1, persistent=True, background=True, size=100000)
        server.call('await_served', service=self.service, n=1)
        client.exit()
        server.call('release', service=self.service)
        other = self.service_peer('other')
        self.assert_calls(other.call('call', service=self.service, count=10), 10)

    def test_a_server_that_calls_another(self):
        inner, client = self.pair()
        outer = self.service_peer('outer')
        nested = self.topic('nested')
        # Single-shot calls of its own only with the library: the judge cannot tell those that roscpp loses itself.
        for onward in (True, False) if self.preload else (True,):
            outer.call('serve', service=nested, mode='forward', to=self.service, persistent=onward)
            for persistent in (True, False):
                before = inner.call('served', service=self.service)['calls']
                self.assert_calls(client.call('call', service=nested, count=50, size=800, answer=900,
                                              persistent=persistent), 50)
                self.assertEqual(inner.call('served', service=self.service)['calls'], before + 50)
            outer.call('unserve', service=nested)

    def test_a_node_calls_its_own_service(self):
        server, client = self.pair()
        for persistent in (True, False):
            self.assert_calls(server.call('call', service=self.service, count=100, size=8000, answer=9000,
                                          persistent=persistent), 100)
        del client

    def test_rospy_client(self):
        server, _ = self.pair()
        python = self.peer('python', kind='rospy', preload='')
        for persistent in (True, False):
            self.assert_calls(python.call('call', service=self.service, count=20, size=800, answer=900,
                                          persistent=persistent), 20)
        self.await_rings(server, of=0)

    def test_rospy_server(self):
        self.service = self.topic('service')
        python = self.peer('python', kind='rospy', preload='')
        client = self.service_peer('client')
        python.call('serve', service=self.service)
        for persistent in (True, False):
            self.assert_calls(client.call('call', service=self.service, count=20, size=800, answer=900,
                                          persistent=persistent), 20, over_tcp=True)
        report = python.call('served', service=self.service)
        self.assertEqual((report['calls'], report['wrong']), (40, 0))

    def test_one_side_without_the_library(self):
        for side in ('server', 'client'):
            with self.subTest(without=side):
                self.service = self.topic('service_' + side)
                server = self.service_peer('server_' + side, preload='' if side == 'server' else None)
                client = self.service_peer('client_' + side, preload='' if side == 'client' else None)
                server.call('serve', service=self.service)
                client.call('await_service', service=self.service)
                for persistent in (True, False):
                    self.assert_calls(client.call('call', service=self.service, count=50, size=800, answer=900,
                                                  persistent=persistent), 50, over_tcp=True)
                self.assertEqual((services_judge.rings(server), services_judge.rings(client)), (0, 0))

    def test_excluded_services_stay_on_tcpros(self):
        for side in ('server', 'client'):
            with self.subTest(excluded_by=side):
                env = {'PI_OS_EXCLUDE': '/service_*'}
                self.service = self.topic('service_excluded_' + side)
                server = self.service_peer('server_' + side, env=env if side == 'server' else {})
                client = self.service_peer('client_' + side, env=env if side == 'client' else {})
                server.call('serve', service=self.service)
                client.call('call', service=self.service, count=0, persistent=True, background=True)
                client.call('await_calls', n=50)
                self.assertEqual((services_judge.rings(server), services_judge.rings(client)), (0, 0))
                self.assertEqual(client.call('stop_calls')['failed'], 0)

    def test_a_pool_too_small_for_a_request_or_an_answer(self):
        server, client = self.pair(env={'PI_OS_POOL_LIMIT_MB': '2'},
                                   client_options={'env': {'PI_OS_POOL_LIMIT_MB': '2'}})
        for persistent in (True, False):
            for size, answer in ((6 * MB, 20), (80, 6 * MB), (6 * MB, 6 * MB), (80, 20), (500000, 500000)):
                with self.subTest(persistent=persistent, size=size, answer=answer):
                    self.assert_calls(client.call('call', service=self.service, count=5, size=size, answer=answer,
                                                  persistent=persistent), 5, over_tcp=True)
        self.assertEqual(server.call('served', service=self.service)['wrong'], 0)

    def test_more_connections_than_a_server_has_shared_memory_for(self):
        server, client = self.pair()
        report = client.call('share', service=self.service, handles=80, threads=1, count=320, size=800, answer=900)
        self.assertEqual((report['failed'], report['wrong']), (0, 0))
        self.assertEqual(server.call('served', service=self.service)['calls'], 320)


if __name__ == '__main__':
    harness.main(Services)
