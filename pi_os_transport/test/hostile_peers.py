"""Peers that meet the library's local socket and shared memory and do there what they must not.

HostileSubscriber asks a living publisher for a topic over TCPROS, as any subscriber, takes the tokens that it is given
for the local socket, and misbehaves there. HostilePublisher registers a topic and misbehaves towards every subscriber
that comes. Both know the layout of packets and ring (docs/design/shared_memory_link.md) and nothing else; neither uses
the library. KINDS of each lists what they can do; a kind is a method with an underscore in front.
"""
import array
import contextlib
import errno
import fcntl
import mmap
import os
import random
import secrets
import select
import socket
import struct
import threading
import time
import xmlrpc.client
import xmlrpc.server

import rosgraph

PROTOCOL_VERSION = 4
PACKET = struct.Struct('<IIIIQQQ')  # version, type, link, unused, values
HELLO, OFFER, PROOF, SEGMENT, RETIRED, ENDED, WAITING, SPACE, QUERY, STATE, MEET, BELL, DECLINED = range(1, 14)
TO_SENDER = 1 << 31
MAX_UINT64 = (1 << 64) - 1

RING_BYTES = 512 + 32 * 256
CAPACITY = 256
RING_MAGIC = 0x34676e69724f5350
NEWS_BYTES = 640
NEWS_MAGIC = 0x347377656e4f5350
NEWS_SUMMARY, NEWS_LINKS = 64, 128
LINKS = 4096
OUR_LINK = LINKS + 7  # the number that a hostile subscriber gives its link
TAIL, HEAD, ARMED, RELEASE_COUNT, RELEASED, ENTRIES = 64, 128, 132, 192, 256, 512

F_ADD_SEALS = 1033
SEAL_SHRINK, SEAL_GROW = 2, 4

TIMEOUT_S = 20.0
IMAGE_MD5 = '060021388200f6f0f447d0fcd9c64743'
NOBODY = 65534


def packet(kind, *values, link=0, version=PROTOCOL_VERSION):
    return PACKET.pack(version, kind, link, 0, *(list(values) + [0, 0, 0])[:3])


def read_exactly(connection, count):
    data = b''
    while len(data) < count:
        piece = connection.recv(count - len(data))
        if not piece:
            raise ConnectionError('the peer closed the TCPROS connection')
        data += piece
    return data


def read_header(connection):
    body = read_exactly(connection, struct.unpack('<I', read_exactly(connection, 4))[0])
    fields = {}
    while body:
        length, = struct.unpack_from('<I', body)
        name, _, value = body[4:4 + length].partition(b'=')
        fields[name.decode()] = value.decode('utf-8', 'replace')
        body = body[4 + length:]
    return fields


def header(**fields):
    body = b''
    for name, value in fields.items():
        field = ('%s=%s' % (name, value)).encode()
        body += struct.pack('<I', len(field)) + field
    return struct.pack('<I', len(body)) + body


def send(channel, data, descriptors=()):
    ancillary = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array('i', descriptors))] if descriptors else []
    try:
        channel.sendmsg([data], ancillary, socket.MSG_NOSIGNAL | socket.MSG_DONTWAIT)
    except OSError as error:  # being thrown out is what a hostile peer has to expect
        if error.errno not in (errno.EPIPE, errno.ECONNRESET, errno.EAGAIN, errno.ENOTCONN, errno.ETOOMANYREFS):
            raise


def receive(channel, descriptors):
    """One packet, and the descriptors with it appended to the list; b'' when the peer has closed."""
    size = array.array('i').itemsize
    try:
        data, ancillary, _, _ = channel.recvmsg(4096, socket.CMSG_SPACE(8 * size))
    except ConnectionResetError:
        return b''
    for level, kind, content in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
            passed = array.array('i')
            passed.frombytes(content[:len(content) // size * size])
            descriptors.extend(passed)
    return data


def is_query(data):
    return len(data) == PACKET.size and PACKET.unpack(data)[1] == QUERY


def await_packet(channel, kind, descriptors):
    """The next packet of a kind, as the fields of PACKET."""
    while True:
        data = receive(channel, descriptors)
        if len(data) != PACKET.size:
            raise RuntimeError('no packet %d but %r' % (kind, data))
        fields = PACKET.unpack(data)
        if fields[1] == kind:
            return fields


def news_memory(magic=NEWS_MAGIC, length=NEWS_BYTES, **options):
    descriptor = shared_memory(length, **options)
    os.pwrite(descriptor, struct.pack('<Q', magic), 0)
    return descriptor


def meet(channel, memory=None):
    """Introduces this process, and returns the other one's NewsLayout as a mapping."""
    memory = news_memory() if memory is None else memory
    send(channel, packet(MEET, 1, 2), [memory])
    os.close(memory)
    descriptors = []
    await_packet(channel, MEET, descriptors)
    news = mmap.mmap(descriptors[0], NEWS_BYTES)
    for descriptor in descriptors:
        os.close(descriptor)
    return news


def local_socket(name):
    channel = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    channel.settimeout(TIMEOUT_S)
    channel.connect('\0pi_os/' + name)
    return channel


def await_close(channel):
    """Until the peer has thrown us out: it has then read what came before."""
    ignored = []
    while receive(channel, ignored):
        pass
    for descriptor in ignored:
        os.close(descriptor)


class HostileSubscriber:
    KINDS = ['wrong_version', 'truncated', 'oversized', 'empty_with_descriptors', 'many_descriptors', 'unknown_token',
             'no_word', 'no_news_memory', 'leaves_early', 'greets_by_the_thousand', 'wrong_nonce', 'junk_packets',
             'head_ahead', 'head_back', 'releases_what_it_never_took', 'random_ring', 'never_reads', 'two_greetings',
             'foreign_user']

    def __init__(self, publisher_name, topic, seed):
        self.random = random.Random(seed)
        self.stack = contextlib.ExitStack()
        uri = rosgraph.Master('/hostile').lookupNode(publisher_name)
        code, message, contact = xmlrpc.client.ServerProxy(uri).requestTopic('/hostile_subscriber', topic, [['TCPROS']])
        if code != 1:
            raise RuntimeError('%s refuses %s: %s' % (publisher_name, topic, message))
        self.tcp = self.stack.enter_context(socket.create_connection((contact[1], contact[2]), TIMEOUT_S))
        self.tcp.sendall(header(callerid='/hostile_subscriber', topic=topic, md5sum='*', type='*',
                                pi_os=PROTOCOL_VERSION))
        version, self.socket_token, link_token = read_header(self.tcp)['pi_os'].split()
        self.token = (int(link_token[:16], 16), int(link_token[16:], 16))

    def misbehave(self, kind):
        with self.stack:
            getattr(self, '_' + kind)()

    def connect(self):
        return self.stack.enter_context(local_socket(self.socket_token))

    def connect_and_meet(self):
        channel = self.connect()
        self.stack.enter_context(contextlib.closing(meet(channel)))
        return channel

    def hello(self, link=OUR_LINK):
        return packet(HELLO, *self.token, link=link)

    def greet(self):
        """Through the whole hand-shake but the proof. @return channel, ring as a mapping, nonce."""
        channel = self.connect_and_meet()
        send(channel, self.hello())
        descriptors = []
        offer = await_packet(channel, OFFER, descriptors)
        if len(descriptors) != 1 or offer[2] != OUR_LINK:
            raise RuntimeError('no OFFER but %r with %d descriptors' % (offer, len(descriptors)))
        ring = self.stack.enter_context(mmap.mmap(descriptors[0], RING_BYTES))
        for descriptor in descriptors:
            os.close(descriptor)
        return channel, ring, struct.unpack_from('<Q', ring, 8)[0]

    def prove(self, channel, nonce):
        send(channel, packet(PROOF, nonce, link=OUR_LINK | TO_SENDER))

    def await_refusal(self, channel):
        if await_packet(channel, ENDED, [])[2] != OUR_LINK:
            raise RuntimeError('another link was ended')

    def linked(self, messages):
        """As an honest subscriber until that many messages wait in the ring."""
        channel, ring, nonce = self.greet()
        self.prove(channel, nonce)
        ignored = []
        while struct.unpack_from('<I', ring, TAIL)[0] < messages:
            data = receive(channel, ignored)  # a SEGMENT comes before the first message in it
            if not data:
                raise RuntimeError('the publisher closed the link')
            if struct.unpack_from('<I', ring, TAIL)[0] < messages:
                self.drink()
        for descriptor in ignored:
            os.close(descriptor)
        return channel, ring

    def drink(self):
        """Takes what has come over TCPROS meanwhile, so that the publisher's outbox empties and the ring is used."""
        self.tcp.setblocking(False)
        try:
            while self.tcp.recv(1 << 20):
                pass
        except BlockingIOError:
            pass
        finally:
            self.tcp.settimeout(TIMEOUT_S)

    def _wrong_version(self):
        version = PROTOCOL_VERSION + self.random.choice([1, 77, 1 << 31])
        channel = self.connect()
        send(channel, packet(MEET, 1, 2, version=version), [self.tcp.fileno()])
        await_close(channel)
        channel = self.connect_and_meet()
        send(channel, packet(HELLO, *self.token, version=version))
        await_close(channel)

    def _truncated(self):
        for channel in (self.connect(), self.connect_and_meet()):
            send(channel, self.hello()[:self.random.randrange(1, PACKET.size)])
            await_close(channel)

    def _oversized(self):
        for channel in (self.connect(), self.connect_and_meet()):
            send(channel, self.hello() + bytes(self.random.randrange(1, 60000)))
            await_close(channel)

    def _empty_with_descriptors(self):
        for _ in range(20):
            channel = self.connect()
            send(channel, b'', [self.tcp.fileno()] * 3)
            await_close(channel)

    def _many_descriptors(self):
        for _ in range(20):
            for channel in (self.connect(), self.connect_and_meet()):
                send(channel, self.hello(), [self.tcp.fileno()] * 200)
                await_close(channel)

    def _unknown_token(self):
        channel = self.connect_and_meet()
        send(channel, packet(HELLO, self.random.getrandbits(64), self.random.getrandbits(64), link=OUR_LINK))
        self.await_refusal(channel)

    def _no_word(self):
        for _ in range(30):
            self.connect()

    def _no_news_memory(self):
        for memory in (news_memory(seals=0), news_memory(length=NEWS_BYTES - 1), news_memory(magic=0),
                       os.open('/dev/null', os.O_RDONLY)):
            channel = self.connect()
            send(channel, packet(MEET, 1, 2), [memory])
            os.close(memory)
            await_close(channel)

    def _greets_by_the_thousand(self):
        """Reads no answer to questions without end: the process must not keep all of them."""
        channel = self.connect_and_meet()
        channel.setblocking(False)
        sent = 0
        while sent < 100000:
            try:
                channel.send(packet(HELLO, 1, 2, link=OUR_LINK), socket.MSG_NOSIGNAL)
                sent += 1
            except BlockingIOError:
                select.select([], [channel], [], TIMEOUT_S)
            except (BrokenPipeError, ConnectionResetError):
                return
        raise RuntimeError('%d answers are kept for a peer that reads none' % sent)

    def _leaves_early(self):
        channel = self.connect_and_meet()
        send(channel, self.hello())

    def _wrong_nonce(self):
        channel, _, nonce = self.greet()
        self.prove(channel, nonce ^ 1)
        self.await_refusal(channel)

    def _junk_packets(self):
        channel, _, nonce = self.greet()
        self.prove(channel, nonce)
        for _ in range(200):
            link = self.random.choice([0, OUR_LINK, OUR_LINK | TO_SENDER, self.random.getrandbits(32)])
            send(channel, packet(self.random.randrange(0, 16), *[self.random.getrandbits(64) for _ in range(3)],
                                 link=link), [self.tcp.fileno()] * self.random.randrange(0, 4))

    def _head_ahead(self):
        _, ring = self.linked(1)
        struct.pack_into('<I', ring, HEAD, self.random.getrandbits(32))

    def _head_back(self):
        _, ring = self.linked(4)
        struct.pack_into('<I', ring, HEAD, 3)
        for place in range(3):
            ring[RELEASED + place] = 1
        struct.pack_into('<I', ring, RELEASE_COUNT, 3)
        self.linked_until(ring, 6)
        struct.pack_into('<I', ring, HEAD, 0)
        self.linked_until(ring, 7, patience_s=0.3)

    def linked_until(self, ring, messages, patience_s=TIMEOUT_S):
        wait = threading.Event()
        waited = 0.0
        while struct.unpack_from('<I', ring, TAIL)[0] < messages and waited < patience_s:
            self.drink()
            wait.wait(0.01)  # shared memory tells nobody who does not ask
            waited += 0.01

    def _releases_what_it_never_took(self):
        _, ring = self.linked(2)
        for place in range(CAPACITY):
            ring[RELEASED + place] = 1
        struct.pack_into('<I', ring, RELEASE_COUNT, self.random.getrandbits(32) | 1)
        self.linked_until(ring, 6, patience_s=0.3)

    def _random_ring(self):
        _, ring = self.linked(1)
        for _ in range(300):
            offset = self.random.choice([TAIL, HEAD, ARMED, RELEASE_COUNT, ENTRIES + self.random.randrange(0, 6000),
                                         RELEASED + self.random.randrange(0, CAPACITY)])
            struct.pack_into('<I', ring, min(offset, RING_BYTES - 4), self.random.getrandbits(32))
            self.drink()
            threading.Event().wait(0.001)

    def _never_reads(self):
        channel, _, nonce = self.greet()
        self.prove(channel, nonce)
        threading.Event().wait(1.0)  # the publisher must not wait for us meanwhile

    def _two_greetings(self):
        self.greet()
        channel = self.connect_and_meet()
        send(channel, self.hello())
        self.await_refusal(channel)

    def _foreign_user(self):
        """Another user learns the tokens, as it could from the network: the socket must not answer it."""
        if os.geteuid() != 0:
            return
        child = os.fork()
        if child == 0:
            status = 1
            try:
                os.setgid(NOBODY)
                os.setuid(NOBODY)
                channel = local_socket(self.socket_token)
                send(channel, packet(MEET, 1, 2), [news_memory()])
                status = 0 if receive(channel, []) == b'' else 2
            except (ConnectionRefusedError, ConnectionResetError, BrokenPipeError):
                status = 0
            finally:
                os._exit(status)
        _, status = os.waitpid(child, 0)
        if status != 0:
            raise RuntimeError('a process of another user was answered (status %d)' % status)


def shared_memory(length, seals=SEAL_SHRINK | SEAL_GROW):
    descriptor = os.memfd_create('pi_os_hostile', os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.posix_fallocate(descriptor, 0, length)
    if seals:
        fcntl.fcntl(descriptor, F_ADD_SEALS, seals)
    return descriptor


class HostilePublisher:
    KINDS = ['wrong_version', 'truncated', 'oversized', 'no_descriptors', 'unsealed_ring', 'short_ring', 'no_magic',
             'tail_ahead', 'tail_runs', 'unknown_segment', 'offset_beyond', 'length_beyond', 'segment_too_long',
             'unsealed_segment', 'no_segment_memory', 'never_due', 'many_segments', 'foreign_descriptors',
             'leaves_after_offer', 'garbage_in_header', 'random_ring', 'random_news', 'no_introduction']

    def __init__(self, topic, seed):
        self.random = random.Random(seed)
        self.topic = topic
        self.tokens = [secrets.token_hex(16) for _ in range(2)]  # not by the seed: other tests may run at the same time
        self.name = '/hostile_publisher_%d' % os.getpid()
        self.stack = contextlib.ExitStack()
        self.met = []      # names of the subscribers that were told of the local socket
        self.failures = []
        self.threads = []

    def misbehave(self, kind, subscribers):
        """Towards the first `subscribers` subscribers that come."""
        self.kind = kind
        with self.stack:
            self.local = self.stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            self.local.bind('\0pi_os/' + self.tokens[0])
            self.local.listen(64)
            self.local.settimeout(TIMEOUT_S)
            self.tcp = self.stack.enter_context(socket.create_server(('localhost', 0), backlog=64))
            self.tcp.settimeout(TIMEOUT_S)
            api = xmlrpc.server.SimpleXMLRPCServer(('localhost', 0), logRequests=False, allow_none=True)
            self.stack.callback(api.server_close)
            api.register_function(lambda caller, topic, protocols: [1, '', ['TCPROS', 'localhost',
                                                                            self.tcp.getsockname()[1]]], 'requestTopic')
            api.register_function(lambda *_: [1, '', 0], 'publisherUpdate')
            serving = threading.Thread(target=api.serve_forever, kwargs={'poll_interval': 0.01})
            serving.start()
            self.stack.callback(serving.join)
            self.stack.callback(api.shutdown)
            master = rosgraph.Master(self.name)
            uri = 'http://localhost:%d/' % api.server_address[1]
            master.registerPublisher(self.topic, 'sensor_msgs/Image', uri)
            try:
                for _ in range(subscribers):
                    connection = self.stack.enter_context(self.tcp.accept()[0])
                    connection.settimeout(TIMEOUT_S)
                    self.welcome(connection)
            finally:
                master.unregisterPublisher(self.topic, uri)
        if self.failures:
            raise self.failures[0]

    def welcome(self, connection):
        self.met.append(read_header(connection).get('callerid'))
        offer = '%d %s %s' % (PROTOCOL_VERSION, self.tokens[0], self.tokens[1])
        if self.kind == 'garbage_in_header':
            offer = self.random.choice(['', '2', '2 x y', '99999999999999999999 %s %s' % tuple(self.tokens),
                                        '2 %s' % self.tokens[0], 'z' * 100000, '2 %s %s' % (('f' * 33,) * 2)])
        connection.sendall(header(callerid=self.name, topic=self.topic, type='sensor_msgs/Image', md5sum=IMAGE_MD5,
                                  latching=0, message_definition='', pi_os=offer))
        if self.kind == 'garbage_in_header':
            return
        channel, first = self.accept()
        while is_query(first):  # pi_os nodes of another test asks every socket of this user
            channel, first = self.accept()
        if len(first) != PACKET.size or PACKET.unpack(first)[1] != MEET:
            raise RuntimeError('no MEET but %r' % first)
        if self.kind != 'no_introduction':
            memory = news_memory()
            send(channel, packet(MEET), [memory])
            os.close(memory)
        self.link = await_packet(channel, HELLO, [])[2]
        getattr(self, '_' + self.kind)(channel)

    # ------------------------------------------------------------------------------------------------------------ tools

    def accept(self):
        """@return the next channel and the first packet on it"""
        channel = self.stack.enter_context(self.local.accept()[0])
        channel.settimeout(TIMEOUT_S)
        descriptors = []
        first = receive(channel, descriptors)
        if len(descriptors) == 2:
            self.news = self.stack.enter_context(mmap.mmap(descriptors[0], NEWS_BYTES))
        for descriptor in descriptors:
            os.close(descriptor)
        return channel, first

    def memory(self, length, **options):
        descriptor = shared_memory(length, **options)
        self.stack.callback(os.close, descriptor)
        return descriptor

    def ring(self, magic=RING_MAGIC, length=RING_BYTES, **options):
        descriptor = self.memory(length, **options)
        ring = self.stack.enter_context(mmap.mmap(descriptor, length))
        struct.pack_into('<QQ', ring, 0, magic, 42)
        return descriptor, ring

    def offer(self, channel, ring_memory):
        send(channel, packet(OFFER, 1 << 20, link=self.link), [ring_memory])

    def offered(self, channel):
        """Through the whole hand-shake. @return the ring as a mapping."""
        descriptor, ring = self.ring()
        self.offer(channel, descriptor)
        proof = await_packet(channel, PROOF, [])
        if (proof[2], proof[4]) != (self.link | TO_SENDER, 42):
            raise RuntimeError('no PROOF but %r' % (proof,))
        return ring

    def segment(self, channel, length=4096, says=None, number=1, **options):
        send(channel, packet(SEGMENT, number, length if says is None else says), [self.memory(length, **options)])

    def write(self, ring, index, segment, offset, length, after_tcp=0):
        struct.pack_into('<QQQQ', ring, ENTRIES + 32 * (index % CAPACITY), segment << 32 | length,
                         (offset // 4) << 32 | after_tcp, index, time.monotonic_ns())

    def publish(self, channel, ring, tail):
        """The subscriber looks into its ring when the channel ends, if no doorbell has woken it before."""
        struct.pack_into('<I', ring, TAIL, tail & 0xffffffff)
        channel.close()

    # ------------------------------------------------------------------------------------------------------------ kinds

    def _wrong_version(self, channel):
        send(channel, packet(OFFER, 1, link=self.link, version=PROTOCOL_VERSION + 1), [self.ring()[0]])

    def _truncated(self, channel):
        send(channel, packet(OFFER, 1, link=self.link)[:self.random.randrange(1, PACKET.size)])

    def _oversized(self, channel):
        send(channel, packet(OFFER, 1, link=self.link) + bytes(1000))

    def _no_descriptors(self, channel):
        send(channel, packet(OFFER, 1, link=self.link))

    def _unsealed_ring(self, channel):
        self.offer(channel, self.ring(seals=0)[0])

    def _short_ring(self, channel):
        self.offer(channel, self.ring(length=4096)[0])

    def _no_magic(self, channel):
        self.offer(channel, self.ring(magic=0)[0])

    def _tail_ahead(self, channel):
        self.publish(channel, self.offered(channel), self.random.getrandbits(32) | CAPACITY * 2)

    def _tail_runs(self, channel):
        """Goes on writing the tail after the channel has ended: who drains the ring must come to an end."""
        ring = self.offered(channel)
        self.publish(channel, ring, CAPACITY)
        for _ in range(20000):
            head, = struct.unpack_from('<I', ring, HEAD)
            struct.pack_into('<I', ring, TAIL, (head + CAPACITY) & 0xffffffff)

    def _unknown_segment(self, channel):
        ring = self.offered(channel)
        self.write(ring, 0, 77, 0, 100)
        self.publish(channel, ring, 1)

    def _offset_beyond(self, channel):
        ring = self.offered(channel)
        self.segment(channel)
        for index, offset in enumerate([4096, 4092, 1 << 20, (1 << 34) - 4]):
            self.write(ring, index, 1, offset, 8)
        self.publish(channel, ring, 4)

    def _length_beyond(self, channel):
        ring = self.offered(channel)
        self.segment(channel)
        for index, length in enumerate([4097, 1 << 31, 0xffffffff]):
            self.write(ring, index, 1, 0, length)
        self.publish(channel, ring, 3)

    def _segment_too_long(self, channel):
        ring = self.offered(channel)
        self.segment(channel, says=self.random.choice([4097, 1 << 40, MAX_UINT64]))
        self.write(ring, 0, 1, 8192, 100)
        self.publish(channel, ring, 1)

    def _unsealed_segment(self, channel):
        ring = self.offered(channel)
        self.segment(channel, seals=0)
        self.write(ring, 0, 1, 0, 100)
        self.publish(channel, ring, 1)

    def _no_segment_memory(self, channel):
        ring = self.offered(channel)
        send(channel, packet(SEGMENT, 1, 4096))
        self.write(ring, 0, 1, 0, 100)
        self.publish(channel, ring, 1)

    def _never_due(self, channel):
        ring = self.offered(channel)
        self.write(ring, 0, 1, 0, 0, after_tcp=1 << 30)
        self.publish(channel, ring, 1)

    def _many_segments(self, channel):
        self.offered(channel)
        for number in range(100):
            self.segment(channel, number=number)

    def _foreign_descriptors(self, channel):
        read_end, write_end = os.pipe()
        self.stack.callback(os.close, read_end)
        self.stack.callback(os.close, write_end)
        for descriptors in ([read_end] * 3, [channel.fileno()] * 3, [os.open('/dev/null', os.O_RDONLY)] * 3):
            send(channel, packet(OFFER, 1, link=self.link), descriptors)
        os.close(descriptors[0])

    def _leaves_after_offer(self, channel):
        self.offer(channel, self.ring()[0])
        channel.close()

    def _garbage_in_header(self, channel):
        raise AssertionError('nobody connects after that')

    def _random_ring(self, channel):
        ring = self.offered(channel)
        self.segment(channel)
        for index in range(CAPACITY):
            # Shorter than any image, so that nothing of it passes for a message.
            self.write(ring, index, self.random.randrange(0, 3), self.random.randrange(0, 1 << 34) & ~3,
                       self.random.choice([0, 1, 36, 0xffffffff]), self.random.getrandbits(2))
        self.publish(channel, ring, self.random.getrandbits(32))

    def _random_news(self, channel):
        """Says that there is news where there is none, in links that do not exist."""
        ring = self.offered(channel)
        for _ in range(200):
            struct.pack_into('<Q', self.news, NEWS_LINKS + 8 * self.random.randrange(0, LINKS // 64),
                             self.random.getrandbits(64))
            struct.pack_into('<Q', self.news, NEWS_SUMMARY, self.random.getrandbits(64))
            send(channel, packet(BELL))
        self.write(ring, 0, 77, 0, 100)
        self.publish(channel, ring, 1)

    def _no_introduction(self, channel):
        send(channel, packet(OFFER, 1, link=self.link), [self.ring()[0]])
