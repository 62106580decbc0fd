#!/usr/bin/python3 -B
"""Judge of bridge_tunnel.test."""
import collections
import os
import pathlib
import shutil
import socket
import struct
import subprocess
import sys
import threading

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from device_testbed import bench, devices  # noqa: E402

NEAR, FAR = '10.99.0.1', '10.99.0.2'  # inside the tunnel: of vehicle and edge_a
SSH_PORT, WIREGUARD_PORT = 2222, 51820
HERE_IS_THERE, THERE_IS_HERE = 18814, 18815  # on edge_a the bridge of vehicle, and the other way round
COUNT, SIZE = 40, 200000
TCP, UDP = 6, 17
SNIFFED = 512 << 20  # more than any test sends: the reading thread may get no processor time while it does
SO_RCVBUFFORCE, SOL_PACKET, PACKET_STATISTICS = 33, 263, 6  # socket.h and if_packet.h of Linux; not in Python's socket


class Sniffer:
    """Counts what crosses the router by protocol and ports, as somebody on the network would see it."""

    def __init__(self, router):
        with router.entered():
            self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(3))  # ETH_P_ALL
        self._socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, SNIFFED)
        self._socket.settimeout(0.05)
        self._flows = collections.Counter()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        while True:
            try:
                packet = self._socket.recv(65536)
            except socket.timeout:
                if self._ended.is_set():
                    return  # and nothing waits any more
                continue
            if len(packet) < 24 or packet[0] >> 4 != 4:
                continue
            header = (packet[0] & 15) * 4
            protocol = packet[9]
            ports = struct.unpack_from('>HH', packet, header) if protocol in (TCP, UDP) else (0, 0)
            self._flows[(protocol, *sorted(ports))] += len(packet)

    def stop(self):
        """@return bytes by (protocol, lower port, higher port); each packet counts where it comes in and goes out."""
        self._ended.set()
        self._thread.join()
        packets, drops = struct.unpack('II', self._socket.getsockopt(SOL_PACKET, PACKET_STATISTICS, 8))
        self._socket.close()
        assert drops == 0, 'the sniffer missed %d of %d packets' % (drops, packets)
        return self._flows


def of_port(flows, protocol, port):
    return sum(size for (found, *ports), size in flows.items() if found == protocol and port in ports)


class BridgeTunnel(device_testbed.DeviceTest):

    # ----------------------------------------------------------------------------------------------------- the tunnels

    def need(self, *programs):
        missing = [name for name in programs if not shutil.which(name, path=os.environ['PATH'] + ':/usr/sbin:/sbin')]
        if missing:
            self.skipTest('not installed: %s' % ', '.join(missing))

    def private_run(self, device, folder, command):
        """Starts a server that keeps its files in /run, with a /run of its own."""
        return device.start('unshare', '-m', 'sh', '-c', 'mount -t tmpfs none /run && mkdir -p /run/%s && exec %s'
                            % (folder, command))

    def await_device(self, device, name):
        def there():
            try:
                return device.run('ip', 'link', 'show', name)
            except bench.BenchError:
                return None
        devices.await_state(there, 'interface %s on %s' % (name, device.name))

    def address_tunnel(self, interface):
        for device, own, other in ((self.vehicle, NEAR, FAR), (self.edge_a, FAR, NEAR)):
            device.run('ip', 'addr', 'add', own, 'peer', other, 'dev', interface)
            device.run('ip', 'link', 'set', interface, 'up')

    def open_wireguard(self):
        self.need('wg')
        keys, processes = {}, {}
        for device in (self.vehicle, self.edge_a):
            private = subprocess.run(['wg', 'genkey'], stdout=subprocess.PIPE, check=True).stdout
            public = subprocess.run(['wg', 'pubkey'], input=private, stdout=subprocess.PIPE, check=True).stdout
            keys[device] = os.path.join(self.scratch(), 'key'), public.decode().strip()
            with open(os.open(keys[device][0], os.O_WRONLY | os.O_CREAT, 0o600), 'wb') as file:
                file.write(private)
            try:
                device.run('ip', 'link', 'add', 'wg0', 'type', 'wireguard')
            except bench.BenchError as reason:
                if not shutil.which('wireguard-go') or not os.path.exists('/dev/net/tun'):
                    self.skipTest('this kernel has no WireGuard, and there is no wireguard-go with /dev/net/tun: %s'
                                  % reason)
                processes[device] = self.private_run(device, 'wireguard', 'wireguard-go -f wg0')
                self.await_device(device, 'wg0')
        for device, other in ((self.vehicle, self.edge_a), (self.edge_a, self.vehicle)):
            inside = ['nsenter', '--mount', '-t', str(processes[device].pid)] if device in processes else []
            behind = FAR if device is self.vehicle else NEAR
            command = inside + ['wg', 'set', 'wg0', 'listen-port', str(WIREGUARD_PORT), 'private-key', keys[device][0],
                                'peer', keys[other][1], 'allowed-ips', behind + '/32', 'endpoint',
                                '%s:%d' % (other.address, WIREGUARD_PORT)]
            devices.await_state(lambda: self.succeeds(device, command), ' '.join(command))
        self.address_tunnel('wg0')

    @staticmethod
    def succeeds(device, command):
        """wireguard-go shows its interface a moment before it takes commands."""
        try:
            device.run(*command)
            return True
        except bench.BenchError:
            return False

    def open_ssh(self, *options):
        """sshd on vehicle with keys that only this test has, and an ssh from edge_a with these options."""
        self.need('sshd', 'ssh', 'ssh-keygen')
        folder = self.scratch()
        for name in ('host', 'user'):
            subprocess.run(['ssh-keygen', '-q', '-t', 'ed25519', '-N', '', '-f', os.path.join(folder, name)],
                           check=True)
        with open(os.path.join(folder, 'host.pub')) as key, open(os.path.join(folder, 'known_hosts'), 'w') as known:
            known.write('[%s]:%d %s' % (self.vehicle.address, SSH_PORT, key.read()))
        shutil.copy(os.path.join(folder, 'user.pub'), os.path.join(folder, 'authorized_keys'))
        with open(os.path.join(folder, 'sshd_config'), 'w') as config:
            config.write('Port %d\nListenAddress %s\nHostKey %s/host\nAuthorizedKeysFile %s/authorized_keys\n'
                         'StrictModes no\nUsePAM no\nPasswordAuthentication no\nPermitRootLogin prohibit-password\n'
                         'PermitTunnel point-to-point\nAllowTcpForwarding yes\nPidFile none\n'
                         'ClientAliveInterval 5\nClientAliveCountMax 2\n'  # ends after this test was killed, too
                         % (SSH_PORT, self.vehicle.address, folder, folder))
        server = self.private_run(self.vehicle, 'sshd', '%s -D -e -f %s/sshd_config' % (shutil.which(
            'sshd', path='/usr/sbin:/sbin:' + os.environ['PATH']), folder))
        server.await_line('Server listening')
        client = self.edge_a.start(
            'ssh', '-F', 'none', '-N', '-v', '-p', str(SSH_PORT), '-i', os.path.join(folder, 'user'),
            '-o', 'UserKnownHostsFile=%s/known_hosts' % folder, '-o', 'BatchMode=yes', '-o', 'ExitOnForwardFailure=yes',
            '-o', 'ServerAliveInterval=5', *options, 'root@' + self.vehicle.address)
        # Before the devices are closed: sshd's process for this connection ends with it, and holds sshd's output till
        # then.
        self.addCleanup(client.kill)
        client.await_line('Entering interactive session')
        return client

    def open_ssh_device(self):
        if not os.path.exists('/dev/net/tun'):
            self.skipTest('no tunnel devices here: /dev/net/tun does not exist')
        self.open_ssh('-o', 'Tunnel=point-to-point', '-w', '0:0')
        for device in (self.vehicle, self.edge_a):
            self.await_device(device, 'tun0')
        self.address_tunnel('tun0')

    # ------------------------------------------------------------------------------------------------------- the tests

    def carry_topic(self, interface, protocol, port):
        """Nodes with addresses in the tunnel: their messages cross the network in it and in no other way."""
        if self.preload:
            self.start_bridge(self.vehicle, '--listen', interface, '--allow', FAR)
            self.start_bridge(self.edge_a, '--listen', interface, '--allow', NEAR)
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker', env={'ROS_IP': NEAR})
        listeners = self.nodes(self.edge_a, 'listener0', 'listener1', env={'ROS_IP': FAR})
        talker.call('advertise', topic=topic, queue=1000)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=2)
        self.await_links(talker, listeners, topic)
        sniffer = Sniffer(self.testbed.router)
        talker.call('publish', count=COUNT, sizes=str(SIZE))
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=COUNT), COUNT)
        flows = sniffer.stop()
        copies = 1 if self.preload else 2
        volume = 2 * copies * COUNT * SIZE  # twice: into the router and out of it
        inside = of_port(flows, protocol, port)
        self.assertGreater(inside, volume, flows)
        self.assertLess(inside, 1.45 * volume, flows)  # a busy machine loses packets and repeats them; a copy more is 1.5
        self.assertEqual(of_port(flows, TCP, devices.BRIDGE_PORT), 0, flows)
        self.assertLess(sum(flows.values()) - inside, 0.02 * volume, flows)  # the ROS master, outside the tunnel
        if self.preload:
            peers = {peer['address']: peer['state'] for peer in self.status(self.edge_a)['peers']}
            self.assertEqual(peers, {'%s:%d' % (NEAR, devices.BRIDGE_PORT): 'up'})

    def test_wireguard(self):
        self.open_wireguard()
        self.carry_topic('wg0', UDP, WIREGUARD_PORT)

    def test_ssh_with_tunnel_device(self):
        self.open_ssh_device()
        self.carry_topic('tun0', TCP, SSH_PORT)

    @device_testbed.with_bridges
    def test_ssh_with_forwarded_ports(self):
        sniffer = Sniffer(self.testbed.router)
        client = self.open_ssh('-L', '127.0.0.1:%d:127.0.0.1:%d' % (HERE_IS_THERE, devices.BRIDGE_PORT),
                               '-R', '127.0.0.1:%d:127.0.0.1:%d' % (THERE_IS_HERE, devices.BRIDGE_PORT))
        for device, own, other in ((self.vehicle, HERE_IS_THERE, THERE_IS_HERE),
                                   (self.edge_a, THERE_IS_HERE, HERE_IS_THERE)):
            self.start_bridge(device, '--listen', '127.0.0.1', '--allow', '127.0.0.1',
                              '--advertise', '127.0.0.1:%d' % own, '--peer', '127.0.0.1:%d' % other)
        for device, other in ((self.vehicle, THERE_IS_HERE), (self.edge_a, HERE_IS_THERE)):
            expected = [('127.0.0.1:%d' % other, 'up')]
            devices.await_state(lambda: self.peer_states(device) == expected,
                                lambda: 'peers of %s are %s, expected %s'
                                % (device.name, self.peer_states(device), expected))
        flows = sniffer.stop()
        self.assertGreater(of_port(flows, TCP, SSH_PORT), 0, flows)
        self.assertEqual(of_port(flows, TCP, devices.BRIDGE_PORT), 0, flows)
        # The bridges notice the end of the tunnel as that of any network.
        client.kill()
        for device in (self.vehicle, self.edge_a):
            devices.await_state(lambda: all(state != 'up' for _, state in self.peer_states(device)),
                                lambda: 'peers of %s: %s' % (device.name, self.peer_states(device)))

    def peer_states(self, device):
        return [(peer['address'], peer['state']) for peer in self.status(device)['peers']]


if __name__ == '__main__':
    harness.main(BridgeTunnel)
