#!/usr/bin/python3 -B
"""A plain rospy node that understands the commands of test_peer.cpp and test_service_peer.cpp that a rospy test needs.

See there for the protocol and the patterns.
"""
import json
import sys
import threading
import time

import numpy
import rospy
from sensor_msgs.msg import Image
from sensor_msgs.srv import SetCameraInfo, SetCameraInfoRequest, SetCameraInfoResponse

MASK = (1 << 64) - 1


def pattern(identity, seq, size):
    words = size // 8 + 1
    base = ((identity << 40) + (seq << 20) + 1) & MASK
    values = (numpy.arange(words, dtype=numpy.uint64) + numpy.uint64(base)) * numpy.uint64(0x9E3779B97F4A7C15)
    return values.astype('<u8').tobytes()[:size]


class Inbox:
    def __init__(self, topic, queue):
        self.changed = threading.Condition()
        self.received = 0
        self.corrupt = 0
        self.flows = {}
        self.log = []
        self.header = {}
        self.subscriber = rospy.Subscriber(topic, Image, self.receive, queue_size=queue, buff_size=1 << 24)

    def receive(self, message):
        identity, seq = message.height, message.width
        intact = (message.step == len(message.data) and message.encoding == '8UC1' and
                  message.header.frame_id == 'pi_os_test' and
                  bytes(message.data) == pattern(identity, seq, len(message.data)))
        with self.changed:
            self.received += 1
            if self.received == 1:
                self.header = dict(message._connection_header)
            if not intact:
                self.corrupt += 1
            else:
                flow = self.flows.setdefault(str(identity), {'received': 0, 'first': seq, 'highest': seq - 1,
                                                             'lost': 0, 'reordered': 0})
                flow['received'] += 1
                flow['last'] = seq
                if seq > flow['highest']:
                    flow['lost'] += seq - flow['highest'] - 1
                    flow['highest'] = seq
                else:
                    flow['reordered'] += 1
                self.log.append([identity, seq])
            self.changed.notify_all()

    def await_received(self, values):
        def reached():
            if 'seq' not in values:
                return self.received >= int(values['n'])
            flow = self.flows.get(values.get('id', '1'))
            return flow is not None and flow['highest'] >= int(values['seq'])
        with self.changed:
            return self.changed.wait_for(reached, float(values.get('timeout', 30)))

    def report(self):
        with self.changed:
            return json.loads(json.dumps({'received': self.received, 'corrupt': self.corrupt, 'flows': self.flows,
                                          'log': self.log, 'header': self.header,
                                          'publishers': self.subscriber.get_num_connections()}))


class Outbox:
    def __init__(self, topic, identity, queue, latch):
        self.identity = identity
        self.last = 0
        self.publisher = rospy.Publisher(topic, Image, queue_size=queue, latch=latch)

    def publish(self, values):
        sizes = [int(size) for size in values.get('sizes', '64').split(',')]
        rate = float(values.get('rate', 0))
        due = time.monotonic()
        for _ in range(int(values.get('count', 1))):
            self.last += 1
            size = sizes[self.last % len(sizes)]
            message = Image(height=self.identity, width=self.last, step=size, encoding='8UC1',
                            data=pattern(self.identity, self.last, size))
            message.header.frame_id = 'pi_os_test'
            self.publisher.publish(message)
            if rate > 0:
                due += 1.0 / rate
                time.sleep(max(0.0, due - time.monotonic()))


def request_values(call, count):
    index = numpy.arange(count, dtype=numpy.uint64)
    return (((call * 2654435761 + index * 40503) & 0xFFFFFFFF) % 1000003).astype(float)


def answer_text(call, count, size):
    text = '%d:%d:' % (call, count)
    return text + ''.join(chr(ord('a') + (call + position) % 26) for position in range(len(text), size))


class Server:
    def __init__(self, service):
        self.calls = 0
        self.wrong = 0
        self.service = rospy.Service(service, SetCameraInfo, self.serve)

    def serve(self, request):
        info = request.camera_info
        intact = bool(numpy.array_equal(request_values(info.width, len(info.D)), numpy.array(info.D)))
        self.calls += 1
        self.wrong += not intact
        return SetCameraInfoResponse(success=intact, status_message=answer_text(info.width, len(info.D), info.height))


def await_state(reached, values):
    deadline = time.monotonic() + float(values.get('timeout', 30))
    while not reached():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


class Peer:
    def __init__(self):
        self.inbox = None
        self.outbox = None
        self.servers = {}

    def execute(self, verb, values):
        return getattr(self, verb)(values)

    def advertise(self, values):
        self.outbox = Outbox(values['topic'], int(values.get('id', 1)), int(values.get('queue', 100)),
                             values.get('latch', '0') != '0')
        return {'ok': True}

    def publish(self, values):
        self.outbox.publish(values)
        return {'ok': True}

    def await_subscribers(self, values):
        return {'ok': await_state(lambda: self.outbox.publisher.get_num_connections() == int(values.get('n', 1)),
                                  values)}

    def subscribe(self, values):
        self.inbox = Inbox(values['topic'], int(values.get('queue', 100)))
        return {'ok': True}

    def await_received(self, values):
        ok = self.inbox.await_received(values)
        return dict(self.inbox.report(), ok=ok)

    def report(self, _values):
        return dict(self.inbox.report(), ok=True)

    def await_publishers(self, values):
        ok = await_state(lambda: self.inbox.subscriber.get_num_connections() == int(values.get('n', 1)), values)
        return dict(self.inbox.report(), ok=ok)

    def serve(self, values):
        self.servers[values['service']] = Server(values['service'])
        return {'ok': True}

    def served(self, values):
        server = self.servers[values['service']]
        return {'ok': True, 'calls': server.calls, 'wrong': server.wrong}

    def call(self, values):
        rospy.wait_for_service(values['service'], 30)
        proxy = rospy.ServiceProxy(values['service'], SetCameraInfo, persistent=values.get('persistent', '0') != '0')
        report = {'ok': True, 'calls': 0, 'failed': 0, 'wrong': 0}
        for number in range(1, int(values.get('count', 1)) + 1):
            request = SetCameraInfoRequest()
            request.camera_info.width = number
            request.camera_info.height = int(values.get('answer', 20))
            request.camera_info.D = request_values(number, int(values.get('size', 80)) // 8)
            report['calls'] += 1
            try:
                response = proxy(request)
                report['wrong'] += response.status_message != answer_text(number, len(request.camera_info.D),
                                                                          request.camera_info.height)
            except rospy.ServiceException:
                report['failed'] += 1
        return report

    def unsubscribe(self, _values):
        self.inbox.subscriber.unregister()
        return {'ok': True}


def answer(reply):
    sys.stdout.write('@' + json.dumps(reply) + '\n')
    sys.stdout.flush()


def main():
    rospy.init_node('rospy_peer', disable_signals=True)
    peer = Peer()
    answer({'reply': 'ready', 'ok': True, 'name': rospy.get_name()})
    for line in sys.stdin:
        tokens = line.split()
        if tokens == ['exit']:
            break
        values = dict(token.split('=', 1) for token in tokens[1:])
        try:
            answer(dict(peer.execute(tokens[0], values), reply=tokens[0]))
        except Exception as error:  # the judge is the one to report it
            answer({'reply': tokens[0], 'ok': False, 'error': repr(error)})
    rospy.signal_shutdown('told to end')


if __name__ == '__main__':
    main()
