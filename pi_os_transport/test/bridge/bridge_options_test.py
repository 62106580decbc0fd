#!/usr/bin/python3 -B
"""Judge of bridge_options.test."""
import os
import pathlib
import signal
import subprocess
import sys
import time

import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from device_testbed import LOAD_FACTOR, bench, device_nodes  # noqa: E402

MIXED = '100,2000,50000,4096,0,200000'  # in B: whole frames and fragmented ones
MIXED_BYTES = sum(int(size) for size in MIXED.split(','))
QUEUE = 1000                            # of publishers whose messages must all arrive

SLOW_MBIT = 20
SLOW_BYTES, SLOW_HZ = 250000, 40.0      # 80 Mbit/s: four times what the slow network carries
SLOW_S = 3.0
FRESH_MS = 800.0                        # with keep_latest: one that waits and one under way, 100 ms each, and the queue

LIMIT_HZ = 10.0
IMAGES = 40
JPEG_ERROR = 2.0                        # mean difference of a byte; quality 80 of smooth images stays below

WIRE_HZ = 100
CUTS = (('loss', 0.3), ('loss', 4.0), ('down', 4.0))  # [s]: shorter and longer than what ends a session

LARGE_BYTES, LARGE_HZ = 60000, 50.0     # 24 Mbit/s of high priority: more than each flood's share of the network
FLOODS = tuple('/flood%d' % number for number in range(5))
FLOOD_BYTES, FLOOD_HZ = 1000000, 5.0    # of each: 200 Mbit/s of low priority in all
FLOODED_MBIT = 100
FLOODED_S = 6.0
LARGE_P99_MS = 40.0                     # 5 ms of wire time, half of the network, and less than its queue of 50 ms

END_S = 2.0                             # from SIGTERM to the end of a bridge
BACK_S = 2.0 * LOAD_FACTOR
REFUSE_S = 5.0                          # for a bridge to refuse its configuration
SETTLED_S = 1.0                         # after the last chance to arrive
REPETITIONS = 8


class BridgeOptions(device_testbed.DeviceTest):

    # ------------------------------------------------------------------------------------------------------ the bridges

    def config(self, **keys):
        """A configuration file. @return its path."""
        path = os.path.join(self.scratch(), 'bridge.yaml')
        with open(path, 'w') as file:
            yaml.safe_dump(keys, file)
        return path

    def start_with(self, device, *args, **keys):
        """A bridge with a configuration file of these keys."""
        return self.start_bridge(device, '--config', self.config(**keys), *args)

    def start_with_topics(self, *topics, **keys):
        """A bridge on each device; that of the vehicle has these entries of `topics`."""
        self.start_with(self.vehicle, topics=list(topics), **keys)
        self.start_bridges(self.edge_a, self.edge_b)

    def outgoing(self, topic, edge=None):
        """What the vehicle's bridge counts of a topic on its way to a device."""
        address = (edge or self.edge_a).address
        flows = [flow for flow in self.status(self.vehicle)['outgoing']
                 if flow['topic'] == topic and flow['peer'].startswith(address + ':')]
        self.assertEqual(len(flows), 1, self.status(self.vehicle))
        return flows[0]

    def carrying(self, topic, listeners, **options):
        """A publisher on the vehicle with its links to listeners over the bridges."""
        talker = self.node(self.vehicle, 'talker')
        talker.call('advertise', topic=topic, queue=QUEUE, **options)
        for listener in listeners:
            listener.call('subscribe', topic=topic, queue=QUEUE, log=True)
        self.await_links(talker, listeners, topic)
        talker.call('await_subscribers', n=len(listeners))
        return talker

    def start_image_peers(self, topic, queue=100):
        talker = self.node(self.vehicle, 'camera_of_' + topic[1:], kind='image_peer')
        listener = self.node(self.edge_a, 'viewer_of_' + topic[1:], kind='image_peer')
        talker.call('advertise', topic=topic, queue=queue)
        listener.call('subscribe', topic=topic, queue=queue)
        self.await_links(talker, [listener], topic)
        talker.call('await_subscribers', n=1)
        return talker, listener

    # ------------------------------------------------------------------------------------------------------ rate limits

    def test_a_rate_limit_thins_what_leaves_the_device(self):
        topic = self.topic()
        self.start_with_topics({'match': topic, 'rate_limit_hz': LIMIT_HZ})
        far = self.nodes(self.edge_a, 'a0', 'a1') + self.nodes(self.edge_b, 'b0')
        near = self.node(self.vehicle, 'near')
        talker = self.node(self.vehicle, 'talker')
        talker.call('advertise', topic=topic, queue=QUEUE)
        for listener in far + [near]:
            listener.call('subscribe', topic=topic, queue=QUEUE, log=True)
        talker.await_transports(topic, 'o', [self.NN] * 3 + [self.SHM])
        talker.call('await_subscribers', n=4)
        count, rate = 300, 100
        talker.call('publish', count=count, rate=rate, sizes='1000,50000')
        self.assert_complete(near.call('await_received', seq=count), count)
        for edge, listeners in ((self.edge_a, far[:2]), (self.edge_b, far[2:])):
            def counted():
                flow = self.outgoing(topic, edge)
                return flow['messages'] + flow['rate_limited'] >= count
            harness.await_state(counted, lambda: self.status(self.vehicle))
            flow = self.outgoing(topic, edge)
            expected = count / rate * LIMIT_HZ
            self.assertGreaterEqual(flow['messages'], 0.8 * expected)
            self.assertLessEqual(flow['messages'], 1.2 * expected + 1)
            for listener in listeners:
                report = listener.call('await_received', n=flow['messages'])
                self.assertEqual(report['received'], flow['messages'], report)
                self.assert_order(report, most_lost=count)
                # Spread over the time, not the first ones and then none.
                self.assertLess(report['log'][0][1], 2 * rate / LIMIT_HZ)
                self.assertGreater(report['log'][-1][1], count - 3 * rate / LIMIT_HZ)
        reports = [listener.call('report')['log'] for listener in far[:2]]
        self.assertEqual(*reports)  # subscribers on one device get the same messages
        for edge in (self.edge_a, self.edge_b):
            # One message counts as one, also if it reaches the rings of two subscribers at different moments.
            flow = self.outgoing(topic, edge)
            self.assertEqual(flow['messages'] + flow['rate_limited'], count, flow)

    def test_a_limited_topic_delivers_its_latched_message(self):
        topic = self.topic()
        self.start_with_topics({'match': '/topic_*', 'rate_limit_hz': LIMIT_HZ})
        listeners = self.nodes(self.edge_a, 'a0', 'a1')
        talker = self.carrying(topic, listeners, latch=True)
        for last, rate, sizes in ((100, 100, '100,30000'), (110, 0, '100,30000')):  # steadily, then all at once
            first = talker.call('publisher')['published'] + 1
            talker.call('publish', count=last - first + 1, rate=rate, sizes=sizes)
            for listener in listeners:
                report = listener.call('await_received', seq=last)
                self.assert_order(report, most_lost=last)
                if rate:
                    self.assertLessEqual(report['received'], 1.3 * last / rate * LIMIT_HZ + 2, report)
        late = self.node(self.edge_a, 'late')
        late.call('subscribe', topic=topic, queue=10)
        self.assert_complete(late.call('await_received', n=1), 1, first=110)

    # ------------------------------------------------------------------------------------------------------ keep_latest

    def measure_ages(self, topic, await_all):
        """Ages at arrival [ms] of messages that come four times as fast as the network carries them, those that waited
        for the link to start excluded. @param await_all  also of those that arrive after the last is published."""
        talker, listener = self.flow_nodes(topic[1:], [topic], SLOW_BYTES, QUEUE)
        talker.start(topic, SLOW_HZ)
        time.sleep(SLOW_S)  # the interval that is measured
        published = talker.stop(topic)
        arrivals = []

        def last_came():
            arrivals.extend(listener.take(topic))
            return arrivals and arrivals[-1].sequence == published - 1
        harness.await_state(last_came, lambda: '%s: %d of %d' % (topic, len(arrivals), published))
        missing = device_nodes.check_order(arrivals, topic)
        if await_all:
            self.assertEqual(missing, 0)
        flow = self.outgoing(topic)
        talker.close()
        listener.close()
        return [arrival.latency_ms() for arrival in arrivals], published, flow

    def test_keep_latest_keeps_a_slow_network_fresh(self):
        self.start_with_topics({'match': '/fresh', 'keep_latest': True})
        self.edge_a.shape(rate_mbit=SLOW_MBIT)
        fresh, published, flow = self.measure_ages('/fresh', await_all=False)
        stale, _, stale_flow = self.measure_ages('/stale', await_all=True)
        print('keep_latest: %d of %d messages, oldest %.0f ms; without: %d, oldest %.0f ms'
              % (len(fresh), published, max(fresh), len(stale), max(stale)))
        self.assertLess(max(fresh), FRESH_MS)
        self.assertGreater(len(fresh), 0.6 * SLOW_S * SLOW_MBIT * 1e6 / 8 / SLOW_BYTES)  # the network is put to use
        self.assertGreater(flow['superseded'], published / 3)
        self.assertEqual(flow['messages'] + flow['superseded'], published, flow)
        self.assertEqual(flow['messages'], len(fresh), flow)
        self.assertGreater(max(stale), 2 * FRESH_MS)  # so the bound above means something
        self.assertEqual(stale_flow['superseded'], 0)

    # ---------------------------------------------------------------------------------------------------------- forward

    def assert_not_forwarded(self, topic):
        listeners = self.nodes(self.edge_a, 'a0', 'a1')
        talker = self.node(self.vehicle, 'talker')
        for name, transport in ((topic, 'TCPROS'), (self.topic('other'), self.NN)):
            talker.call('advertise', topic=name, queue=QUEUE)
            for listener in listeners:
                listener.call('subscribe', topic=name, queue=QUEUE)
            talker.call('await_subscribers', n=2)
            self.await_links(talker, listeners, name, transport)
            before = self.vehicle.counters()
            talker.call('publish', count=60, rate=200, sizes=MIXED)
            for listener in listeners:
                self.assert_complete(listener.call('await_received', seq=60), 60)
            self.assert_copies(self.vehicle, before, 10 * MIXED_BYTES, 2 if transport == 'TCPROS' else 1)
            self.await_links(talker, listeners, name, transport)

    def test_the_publishers_bridge_does_not_forward_a_topic(self):
        topic = self.topic('kept')
        self.start_with_topics({'match': '/kept_*', 'forward': False})
        self.assert_not_forwarded(topic)

    def test_the_subscribers_bridge_does_not_forward_a_topic(self):
        topic = self.topic('kept')
        self.start_bridges(self.vehicle)
        self.start_with(self.edge_a, topics=[{'match': '/kept_*', 'forward': False}])
        self.assert_not_forwarded(topic)

    # ------------------------------------------------------------------------------------------------------ compression

    def assert_images(self, compression, encoding, pixel_bytes, most_of_volume, exact, count=IMAGES):
        """@param most_of_volume  of what the images are without compression, on the network."""
        topic = self.topic('image_%s_%s' % (compression, encoding))
        talker, listener = self.start_image_peers(topic)
        before = self.vehicle.counters()
        talker.call('publish', encoding=encoding, width=640, height=480, count=count, rate=20)
        report = listener.call('await_received', seq=count)
        sent = self.vehicle.counters()['sent'] - before['sent']
        volume = count * 640 * 480 * pixel_bytes
        print('%s %s: %.1f %% of the volume on the network, largest mean error %.2f'
              % (compression, encoding, 100 * sent / volume, report['worst_error']))
        self.assertEqual((report['received'], report['first'], report['reordered'], report['malformed'],
                          report['forms']), (count, 1, 0, 0, [encoding + ' 640x480']), report)
        self.assertLess(sent, most_of_volume * volume)
        flow = self.outgoing(topic)
        self.assertEqual(flow['messages'], count, flow)
        if exact:
            self.assertEqual(report['exact'], count, report)
        else:
            self.assertLess(report['worst_error'], JPEG_ERROR, report)
            self.assertLess(report['exact'], count, report)  # it was JPEG indeed
        return flow, sent, volume

    def start_with_compression(self, compression):
        self.start_with_topics({'match': '/image_*', 'compression': compression})

    def test_jpeg_is_small_and_close(self):
        self.start_with_compression('jpeg')
        for encoding, pixel_bytes in (('rgb8', 3), ('bgr8', 3), ('mono8', 1)):
            with self.subTest(encoding=encoding):
                flow, _, _ = self.assert_images('jpeg', encoding, pixel_bytes, 0.2, exact=False)
                self.assertEqual(flow['uncompressed'], 0, flow)

    def test_png_is_smaller_and_exact(self):
        self.start_with_compression('png')
        for encoding, pixel_bytes in (('rgb8', 3), ('mono8', 1), ('mono16', 2)):
            with self.subTest(encoding=encoding):
                flow, _, _ = self.assert_images('png', encoding, pixel_bytes, 0.5, exact=True)
                self.assertEqual(flow['uncompressed'], 0, flow)

    def test_what_cannot_be_compressed_goes_as_it_is(self):
        for compression, encodings in (('jpeg', (('bayer_rggb8', 1), ('32FC1', 4), ('mono16', 2))),
                                       ('png', (('bayer_rggb8', 1), ('32FC1', 4)))):
            self.start_with_compression(compression)
            for encoding, pixel_bytes in encodings:
                with self.subTest(compression=compression, encoding=encoding):
                    flow, sent, volume = self.assert_images(compression, encoding, pixel_bytes, 1.1, exact=True,
                                                            count=20)
                    self.assertEqual(flow['uncompressed'], 20, flow)
                    self.assertGreater(sent, 0.99 * volume)
            for bridge in self.bridges.values():
                bridge.terminate()

    def test_other_types_and_other_topics_are_not_compressed(self):
        self.start_with_compression('jpeg')
        listener = self.node(self.edge_a, 'listener')
        talker = self.node(self.vehicle, 'talker')
        # std_msgs/String on a topic that matches; sensor_msgs/Image that is none (test_peer's) on one that does not.
        for topic, kind in ((self.topic('image_text'), 'string'), (self.topic('picture'), 'image')):
            talker.call('advertise', topic=topic, queue=QUEUE, type=kind)
            listener.call('subscribe', topic=topic, queue=QUEUE, type=kind)
            self.await_links(talker, [listener], topic)
            before = self.vehicle.counters()
            talker.call('publish', count=60, rate=200, sizes='100,20000,200000')
            report = listener.call('await_received', seq=60)
            self.assert_complete(report, 60)
            self.assertEqual(self.outgoing(topic)['uncompressed'], 0)
            self.assert_copies(self.vehicle, before, report['bytes'], 1)

    def codec_workers(self, device):
        bridge = self.bridges[device.name].pid
        with open('/proc/%d/task/%d/children' % (bridge, bridge)) as children:
            return [int(pid) for pid in children.read().split()]

    def kill_codec(self, device, most_lost):
        self.start_with_compression('jpeg')
        topic = self.topic('image')
        # A queue for all of them: the codec of a busy computer may be slower than the publisher.
        talker, listener = self.start_image_peers(topic, QUEUE)
        talker.call('publish', encoding='rgb8', width=640, height=480, count=0, rate=30)
        listener.call('await_received', seq=10)
        kills = 4
        for _ in range(kills):
            workers = harness.await_state(lambda: self.codec_workers(device), 'a codec worker')
            self.assertEqual(len(workers), 1)
            os.kill(workers[0], signal.SIGKILL)
            sent = talker.call('publisher')['published']
            listener.call('await_received', seq=sent + 10)
            harness.await_state(lambda: self.codec_workers(device) not in ([], workers), 'a new codec worker')
        last = talker.call('stop')['published']
        report = listener.call('await_received', seq=last)
        self.assertEqual((report['reordered'], report['malformed']), (0, 0), report)
        self.assertGreaterEqual(report['received'], last - kills * most_lost,
                                '%s; %s; %s' % (report, self.status(self.vehicle)['outgoing'],
                                                self.status(self.edge_a)['incoming']))
        self.assertLess(report['worst_error'], JPEG_ERROR, report)
        self.assertLessEqual(self.outgoing(topic)['uncompressed'], kills * 10)
        self.await_links(talker, [listener], topic)

    @device_testbed.with_bridges
    def test_only_the_bridge_is_favoured_and_not_its_codec(self):
        bridge = self.start_with(self.vehicle, '--nice', '-7', topics=[{'match': '*', 'compression': 'jpeg'}])
        self.start_bridges(self.edge_a)
        talker, listener = self.start_image_peers(self.topic('image'))
        talker.call('publish', encoding='rgb8', width=640, height=480, count=1, rate=30)
        listener.call('await_received', seq=1)
        codec = self.codec_workers(self.vehicle)[0]
        self.assertEqual([os.getpriority(os.PRIO_PROCESS, pid) for pid in (bridge.pid, codec)], [-7, 0])

    @device_testbed.with_bridges
    def test_a_bridge_that_leads_a_session_is_favoured_among_sessions(self):
        bridge = self.start_bridge(self.vehicle, '--nice', '-7')
        self.assertEqual(os.getsid(bridge.pid), bridge.pid)
        group = '/proc/%d/autogroup' % bridge.pid
        if not os.path.exists(group):
            self.skipTest('this kernel has no autogroups')
        with open(group) as file:
            self.assertRegex(file.read(), 'nice -7$')

    def test_the_encoder_is_killed_and_nothing_is_lost(self):
        self.kill_codec(self.vehicle, most_lost=0)

    def test_the_decoder_is_killed_and_traffic_goes_on(self):
        self.kill_codec(self.edge_a, most_lost=1)  # the image that it was at

    def test_a_burst_of_compressed_images_is_complete(self):
        # The publisher's queue has room for all, and so must have what restores them at the other end.
        for compression in ('jpeg', 'png'):
            with self.subTest(compression=compression):
                self.start_with_compression(compression)
                topic = self.topic('image_' + compression)
                talker, listener = self.start_image_peers(topic)
                talker.call('publish', encoding='rgb8', width=640, height=480, count=60, rate=1000)
                report = listener.call('await_received', seq=60)
                flow = self.outgoing(topic)
                self.assertEqual((flow['messages'], flow['superseded'], flow['lost']), (60, 0, 0), flow)
                self.assertEqual((report['received'], report['reordered'], report['malformed']), (60, 0, 0), report)
            for bridge in self.bridges.values():
                bridge.terminate()

    # --------------------------------------------------------------------------------------------------- large messages

    def send_too_large_ones(self):
        """Messages of which one is larger than 1 MiB, with smaller ones before and after it; then only smaller ones."""
        topic = self.topic()
        listeners = self.nodes(self.edge_a, 'a0', 'a1')
        talker = self.carrying(topic, listeners)
        talker.call('publish', count=60, rate=100, sizes='1000000,100,30000')
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=60), 60)
        self.await_links(talker, listeners, topic)
        talker.call('publish', count=30, rate=100, sizes=','.join(['3000000'] + ['100,30000,300000,5000'] * 10))
        talker.call('publish', count=70, rate=100, sizes='3000000,100,30000,300000,5000')
        return talker, listeners, topic, 160

    def test_a_message_above_the_limit_of_the_publishers_bridge_arrives_over_tcpros(self):
        self.start_with(self.vehicle, max_message_mb=1)
        self.start_bridges(self.edge_a)
        talker, listeners, topic, last = self.send_too_large_ones()
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=last), last)
        self.await_links(talker, listeners, topic, 'TCPROS')
        # Other topics of the same nodes do not mind.
        other = self.topic('other')
        talker.call('advertise', topic=other, queue=QUEUE)
        listeners[0].call('subscribe', topic=other, queue=QUEUE)
        self.await_links(talker, listeners[:1], other)
        talker.call('publish', count=30, sizes='1000,900000')
        self.assert_complete(listeners[0].call('await_received', seq=30), 30)

    def test_a_message_above_the_limit_of_the_subscribers_bridge_arrives_over_tcpros(self):
        self.start_bridges(self.vehicle)
        self.start_with(self.edge_a, max_message_mb=1)
        _, listeners, _, last = self.send_too_large_ones()
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=last), last)

    # -------------------------------------------------------------------------------------------------------- the wires

    def start_wires(self, at_vehicle, at_edge):
        """Bridges with these wires. @return a publisher, its subscribers, its topic."""
        self.start_bridge(self.vehicle, '--wire', at_vehicle)
        self.start_bridge(self.edge_a, '--wire', at_edge)
        self.assertEqual((self.status(self.vehicle)['wire'], self.status(self.edge_a)['wire']), (at_vehicle, at_edge))
        topic = self.topic()
        listeners = self.nodes(self.edge_a, *('listener%d' % i for i in range(3)))
        return self.carrying(topic, listeners), listeners, topic

    def assert_wires_carry(self, at_vehicle, at_edge):
        talker, listeners, topic = self.start_wires(at_vehicle, at_edge)
        before = self.vehicle.counters()
        talker.call('publish', count=120, rate=200, sizes=MIXED)
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=120), 120)
        self.assert_copies(self.vehicle, before, 20 * MIXED_BYTES, 1)
        last = talker.call('publish', count=5, sizes=8000000)['published']  # many fragments, as fast as it goes
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=last), last)
        # The other direction.
        back = self.topic('back')
        listeners[0].call('advertise', topic=back, queue=QUEUE)
        talker.call('subscribe', topic=back, queue=QUEUE)
        self.await_links(listeners[0], [talker], back)
        listeners[0].call('publish', count=60, rate=200, sizes=MIXED)
        self.assert_complete(talker.call('await_received', seq=60), 60)
        self.await_links(talker, listeners, topic)

    def assert_whole_again(self, talker, listeners, most_lost):
        """Ends the background traffic and judges it; then nothing is lost any more."""
        last = talker.call('stop')['published']
        for listener in listeners:
            self.assert_order(listener.call('await_received', seq=last), most_lost=most_lost)
        talker.call('publish', count=60, rate=200, sizes=MIXED)
        for listener in listeners:
            report = listener.call('await_received', seq=last + 60)
            self.assertEqual([seq for _, seq in report['log'] if seq > last], list(range(last + 1, last + 61)))

    def assert_wires_survive_kills(self, at_vehicle, at_edge):
        talker, listeners, topic = self.start_wires(at_vehicle, at_edge)
        talker.call('publish', count=0, rate=WIRE_HZ, sizes=MIXED, background=True)
        self.assert_flows(talker, listeners[0])
        for device, wire in ((self.edge_a, at_edge), (self.vehicle, at_vehicle)):
            self.bridges[device.name].kill()
            self.assert_flows(talker, listeners[0], BACK_S)
            self.await_links(talker, listeners, topic, 'TCPROS', BACK_S)
            self.start_bridge(device, '--wire', wire)
            self.await_links(talker, listeners, topic, timeout=BACK_S)
            for listener in listeners:
                self.assert_flows(talker, listener, BACK_S)
        self.assert_whole_again(talker, listeners, 2 * BACK_S * WIRE_HZ)

    def assert_wires_survive_restarts(self, at_vehicle, at_edge):
        """Bridges that are killed and back before anybody notices."""
        talker, listeners, topic = self.start_wires(at_vehicle, at_edge)
        talker.call('publish', count=0, rate=WIRE_HZ, sizes=MIXED, background=True)
        self.assert_flows(talker, listeners[0])
        restarts = ((self.edge_a, at_edge), (self.vehicle, at_vehicle)) * 3
        for device, wire in restarts:
            self.bridges[device.name].kill()
            self.start_bridge(device, '--wire', wire)
            for listener in listeners:
                self.assert_flows(talker, listener, BACK_S)
        self.await_links(talker, listeners, topic)
        self.assert_whole_again(talker, listeners, len(restarts) * BACK_S * WIRE_HZ)

    def assert_wires_survive_cuts(self, at_vehicle, at_edge):
        talker, listeners, topic = self.start_wires(at_vehicle, at_edge)
        talker.call('publish', count=0, rate=WIRE_HZ, sizes=MIXED, background=True)
        self.assert_flows(talker, listeners[0])
        most_lost = 0
        for how, cut_s in CUTS:
            self.edge_a.cut(how)
            time.sleep(cut_s)  # the length of the cut
            self.edge_a.restore()
            most_lost += (cut_s + BACK_S) * WIRE_HZ
            for listener in listeners:
                self.assert_flows(talker, listener, BACK_S)
            self.await_links(talker, listeners, topic, timeout=BACK_S)
        self.assert_whole_again(talker, listeners, most_lost)

    def test_sp_on_both_sides_survives_kills(self):
        self.assert_wires_survive_kills('sp', 'sp')

    def test_sp_on_both_sides_survives_restarts(self):
        self.assert_wires_survive_restarts('sp', 'sp')

    def test_sp_on_both_sides_survives_cuts(self):
        self.assert_wires_survive_cuts('sp', 'sp')

    def test_nanomsg_on_both_sides_carries(self):
        self.assert_wires_carry('nanomsg', 'nanomsg')

    def test_nanomsg_on_both_sides_survives_kills(self):
        self.assert_wires_survive_kills('nanomsg', 'nanomsg')

    def test_nanomsg_on_both_sides_survives_restarts(self):
        self.assert_wires_survive_restarts('nanomsg', 'nanomsg')

    def test_nanomsg_on_both_sides_survives_cuts(self):
        self.assert_wires_survive_cuts('nanomsg', 'nanomsg')

    def test_nanomsg_to_sp_carries(self):
        self.assert_wires_carry('nanomsg', 'sp')

    def test_nanomsg_to_sp_survives_kills(self):
        self.assert_wires_survive_kills('nanomsg', 'sp')

    def test_nanomsg_to_sp_survives_restarts(self):
        self.assert_wires_survive_restarts('nanomsg', 'sp')

    def test_nanomsg_to_sp_survives_cuts(self):
        self.assert_wires_survive_cuts('nanomsg', 'sp')

    def test_sp_to_nanomsg_carries(self):
        self.assert_wires_carry('sp', 'nanomsg')

    def test_sp_to_nanomsg_survives_kills(self):
        self.assert_wires_survive_kills('sp', 'nanomsg')

    def test_sp_to_nanomsg_survives_restarts(self):
        self.assert_wires_survive_restarts('sp', 'nanomsg')

    def test_sp_to_nanomsg_survives_cuts(self):
        self.assert_wires_survive_cuts('sp', 'nanomsg')

    # ---------------------------------------------------------------------------------------------------------- SIGTERM

    def told_to_end(self, device, wire):
        self.start_bridge(self.vehicle, '--wire', wire)
        self.start_bridge(self.edge_a, '--wire', wire)
        topic = self.topic()
        listeners = self.nodes(self.edge_a, 'a0', 'a1')
        talker = self.carrying(topic, listeners)
        talker.call('publish', count=0, rate=200, sizes=MIXED, background=True)
        self.assert_flows(talker, listeners[0])
        for _ in range(3):
            begin = time.monotonic()
            self.assertEqual(self.bridges[device.name].terminate(), 0, self.bridges[device.name].lines)
            self.assertLess(time.monotonic() - begin, END_S)
            for listener in listeners:
                self.assert_flows(talker, listener, BACK_S)
            self.await_links(talker, listeners, topic, 'TCPROS', BACK_S)
            self.start_bridge(device, '--wire', wire)
            self.await_links(talker, listeners, topic, timeout=BACK_S)
            for listener in listeners:
                self.assert_flows(talker, listener, BACK_S)
        last = talker.call('stop')['published']
        for listener in listeners:
            self.assert_complete(listener.call('await_received', seq=last), last)

    def test_the_publishers_bridge_is_told_to_end(self):
        self.told_to_end(self.vehicle, 'sp')

    def test_the_subscribers_bridge_is_told_to_end(self):
        self.told_to_end(self.edge_a, 'sp')

    def test_the_publishers_nanomsg_bridge_is_told_to_end(self):
        self.told_to_end(self.vehicle, 'nanomsg')

    def test_the_subscribers_nanomsg_bridge_is_told_to_end(self):
        self.told_to_end(self.edge_a, 'nanomsg')

    # --------------------------------------------------------------------------------------------------- who is allowed

    def assert_refused_by(self, device, wire='sp'):
        """The device's bridge lets only edge_b connect; the link to edge_a then stays on TCPROS."""
        self.start_bridge(self.edge_b, '--wire', wire)
        for other in (self.vehicle, self.edge_a):
            allow = ['--allow', self.edge_b.address + '/32'] if other is device else []
            self.start_bridge(other, '--wire', wire, *allow)
        topic = self.topic()
        talker = self.node(self.vehicle, 'talker')
        refused, welcome = self.node(self.edge_a, 'refused'), self.node(self.edge_b, 'welcome')
        talker.call('advertise', topic=topic, queue=QUEUE)
        for listener in (refused, welcome):
            listener.call('subscribe', topic=topic, queue=QUEUE)
        talker.await_transports(topic, 'o', ['TCPROS', self.NN])
        welcome.await_transports(topic, 'i', [self.NN])
        if device is self.vehicle:  # edge_a's bridge does not even ask one that it does not allow
            harness.await_state(lambda: self.bridges[device.name].refused()['unknown_peer'] > 0,
                                lambda: self.status(device))
        talker.call('await_subscribers', n=2)
        talker.call('publish', count=200, rate=200, sizes=MIXED)
        for listener in (refused, welcome):
            self.assert_complete(listener.call('await_received', seq=200), 200)
        self.assertEqual(refused.transports(topic, 'i'), ['TCPROS'])
        self.assertEqual(talker.transports(topic, 'o'), ['NNROS', 'TCPROS'])
        peers = [peer['address'].split(':')[0] for peer in self.status(device)['peers'] if peer['state'] == 'up']
        self.assertEqual(peers, [self.edge_b.address] if device is self.vehicle else [], self.status(device))

    def test_a_bridge_that_is_not_allowed_is_refused(self):
        self.assert_refused_by(self.vehicle)

    def test_a_bridge_that_is_not_allowed_is_refused_over_nanomsg(self):
        self.assert_refused_by(self.vehicle, 'nanomsg')

    def test_a_bridge_does_not_ask_one_that_it_does_not_allow(self):
        self.assert_refused_by(self.edge_a)

    # --------------------------------------------------------------------------------------------------------- priority

    def flow_nodes(self, name, topics, size, queue):
        """Nodes with these topics from the vehicle to edge_a, over the bridges."""
        mode = device_nodes.DEVICE_MODES['pi_os']
        talker = device_nodes.FlowNode(self.vehicle, name + '_out', mode, self.preload)
        listener = device_nodes.FlowNode(self.edge_a, name + '_in', mode, self.preload)
        for topic in topics:
            talker.advertise(topic, size, queue)
            listener.subscribe(topic, size, QUEUE)
        for topic in topics:
            listener.await_transports(topic, 'i', [self.NN])
            talker.await_transports(topic, 'o', [self.NN])
        return talker, listener

    def measure_beside_floods(self, topic):
        """@return latencies [ms] of messages on a topic beside the floods, and what arrives of the floods [Mbit/s]."""
        talker, listener = self.flow_nodes(topic[1:], [topic], LARGE_BYTES, QUEUE)
        floods = self.flow_nodes('floods_beside_' + topic[1:], FLOODS, FLOOD_BYTES, 2)
        for flood in FLOODS:
            floods[0].start(flood, FLOOD_HZ)
        for flood in FLOODS:
            harness.await_state(lambda: floods[1].take(flood), 'the first message of ' + flood)
        talker.start(topic, LARGE_HZ)
        time.sleep(FLOODED_S)  # the interval that is measured
        arrived = 0
        for flood in FLOODS:
            arrivals = floods[1].take(flood)
            device_nodes.check_order(arrivals, flood)
            arrived += len(arrivals)
        published = talker.stop(topic)
        received = []

        def complete():
            received.extend(listener.take(topic))
            return len(received) >= published
        harness.await_state(complete, lambda: '%d of %d messages of %s' % (len(received), published, topic))
        self.assertEqual((len(received), device_nodes.check_order(received, topic)), (published, 0))
        for node in (talker, listener) + floods:
            node.close()
        return [arrival.latency_ms() for arrival in received], arrived * FLOOD_BYTES * 8 / 1e6 / FLOODED_S

    def test_large_messages_of_high_priority_overtake_those_of_low_priority(self):
        self.start_with_topics({'match': '/high', 'priority': 'high'}, {'match': '/flood?', 'priority': 'low'},
                               {'match': '/low', 'priority': 'low'})
        self.edge_a.shape(rate_mbit=FLOODED_MBIT)
        high, flood_mbit = self.measure_beside_floods('/high')
        low, _ = self.measure_beside_floods('/low')
        p99 = bench.percentile(high, 99)
        print('beside %.0f Mbit/s of low priority: high p50 %.1f ms, p99 %.1f ms; low p50 %.1f ms, p99 %.1f ms'
              % (flood_mbit, bench.percentile(high, 50), p99, bench.percentile(low, 50), bench.percentile(low, 99)))
        self.assertGreater(flood_mbit, 0.4 * FLOODED_MBIT)
        self.assertLess(p99, LARGE_P99_MS)
        self.assertGreater(bench.percentile(low, 99), LARGE_P99_MS)  # so the bound above means something

    # ------------------------------------------------------------------------------------------------ bad configuration

    def assert_bad(self, device, *parts, args=(), text=None):
        """A bridge with these arguments, and a file of this text, ends with one line that names all the parts."""
        arguments = list(args)
        if text is not None:
            path = os.path.join(self.scratch(), 'wrong.yaml')
            with open(path, 'w') as file:
                file.write(text)
            arguments += ['--config', path]
            parts += (path,)
        with device.entered():
            process = subprocess.Popen([harness.program('pi_os_bridge')] + arguments, stdout=subprocess.PIPE,
                                       stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True,
                                       env=device.environment())
        try:
            output, errors = process.communicate(timeout=REFUSE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            self.fail('it runs: %s' % (process.communicate(),))
        self.assertEqual((process.returncode, output), (1, ''), errors)
        self.assertEqual(errors.count('\n'), 1, errors)
        self.assertTrue(errors.startswith('pi_os_bridge: ') and errors.endswith('\n'), errors)
        for part in parts:
            self.assertIn(part, errors)

    def test_a_wrong_file_is_refused(self):
        for text, parts in (
                ('wires: sp\n', (':1:', 'wires is no option', 'socket, topics, trust, wire')),
                ('name: a\ntopics:\n  - match: "/a"\n    rate: 3\n', (':4:', 'topics[0].rate', 'rate_limit_hz')),
                ('wire: udp\n', (':1:', 'wire = "udp"', 'sp or nanomsg')),
                ('\nmax_message_mb: 0\n', (':2:', 'max_message_mb = "0"', '1 to 1024')),
                ('pool_limit_mb: many\n', ('pool_limit_mb = "many"', '1 to 65536')),
                ('allow: ["10.0.0.0/40"]\n', ('allow[0] = "10.0.0.0/40"', '192.168.1.0/24')),
                ('topics: [{match: "/a", compression: webp}]\n', ('topics[0].compression = "webp"', 'jpeg, png')),
                ('topics: [{match: "/a", compression: jpeg, quality: 0}]\n', ('topics[0].quality = "0"', '1 to 100')),
                ('topics: [{match: "/a", rate_limit_hz: -1}]\n', ('topics[0].rate_limit_hz = "-1"', '0 (no limit)')),
                ('topics: [{match: "/a", priority: urgent}]\n', ('topics[0].priority', 'high, normal or low')),
                ('topics: [{match: "/a", keep_latest: 1}]\n', ('topics[0].keep_latest = "1"', 'true or false')),
                ('listen: 8814\n', ('listen', 'must be a list')),
                ('listen: ["eth7"]\n', ('listen[0] = "eth7"', 'interface')),
                ('name: [\n', ('is no YAML',))):
            with self.subTest(text=text):
                self.assert_bad(self.vehicle, *parts, text=text)

    def test_a_wrong_command_line_is_refused(self):
        for args, parts in ((['--wires', 'sp'], ('--wires', '--help')),
                            (['--wire', 'udp'], ('--wire = "udp"', 'sp or nanomsg')),
                            (['--wire'], ('--wire', 'lacks its value', '--help')),
                            (['--allow', 'everyone'], ('--allow = "everyone"', '192.168.1.0/24')),
                            (['--listen', '0.0.0.0:99999'], ('--listen = "0.0.0.0:99999"', '65535')),
                            (['--socket', '0'], ('--socket = "0"', 'letters')),
                            (['--config', '/no/such/file.yaml'], ('--config = "/no/such/file.yaml"', 'No such file'))):
            with self.subTest(args=args):
                self.assert_bad(self.vehicle, *parts, args=args)

    def test_what_another_bridge_has_is_refused(self):
        self.start_bridges(self.vehicle)
        for wire in ('sp', 'nanomsg'):
            with self.subTest(wire=wire):
                self.assert_bad(self.vehicle, '0.0.0.0:8814', 'in use', '--listen',
                                args=['--socket', 'other', '--wire', wire])
                self.assert_bad(self.vehicle, 'default', 'another bridge', '--socket',
                                args=['--listen', '0.0.0.0:8815', '--wire', wire])
        # The one that was there first does not notice, and both go side by side if they share nothing.
        self.assertEqual(self.status(self.vehicle)['peers'], [])
        beside = self.vehicle.start_bridge('--socket', 'other', '--listen', '0.0.0.0:8815')
        self.assertEqual(beside.terminate(), 0)

    # ------------------------------------------------------------------------------------- publishers that exit at once

    def deliver_and_exit(self, number, preload, count, size, settled):
        """How many messages arrive from a publisher that publishes and is shut down behind the last message.
        @param settled  whether its link is over the bridges before."""
        name = '%d_%s_%d_%d' % (number, 'bridges' if preload else 'tcpros', count, settled)
        topic = self.topic('short_' + name)
        talker = self.node(self.vehicle, 'short_' + name, preload=preload)
        listener = self.node(self.edge_a, 'listener_' + name, preload=preload)
        listener.call('subscribe', topic=topic, queue=QUEUE, log=True)
        talker.call('advertise', topic=topic, queue=QUEUE)
        if settled and preload:
            self.await_links(talker, [listener], topic)
        talker.call('await_subscribers', n=1)
        talker.say('publish count=%d sizes=%d\nexit' % (count, size))
        talker.wait()
        listener.send('await_received', n=count, timeout=SETTLED_S)  # returns at once when all are there
        report = listener.answer()
        listener.close()
        self.assertEqual([seq for _, seq in report['log']], sorted({seq for _, seq in report['log']}), report)
        missing = sorted(set(range(count)) - {seq for _, seq in report['log']})
        if missing:
            print('%s: %s of %d messages are missing; %s' % (name, missing, count, report))
        return report['received']

    def exits_at_once(self, count, size, settled):
        self.start_bridges(self.vehicle, self.edge_a)
        arrived = {mode: [] for mode in ('', self.preload)}
        for number in range(REPETITIONS):
            for mode, received in arrived.items():
                received.append(self.deliver_and_exit(number, mode, count, size, settled))
        plain, bridged = sorted(arrived['']), sorted(arrived[self.preload])
        print('%d messages of %d B and exit: %s arrive over TCPROS, %s with bridges' % (count, size, plain, bridged))
        # What always arrives over TCPROS always arrives here; where that is chance, it must not be a worse one.
        self.assertGreaterEqual(bridged[0], plain[0])
        self.assertGreaterEqual(sum(bridged), sum(plain))

    def test_a_publisher_of_one_message_exits_at_once(self):
        self.exits_at_once(1, 100, settled=True)

    def test_a_publisher_of_many_messages_exits_at_once(self):
        self.exits_at_once(200, 100, settled=True)

    def test_a_publisher_of_large_messages_exits_at_once(self):
        self.exits_at_once(20, 100000, settled=True)

    def test_a_new_publisher_of_one_message_exits_at_once(self):
        self.exits_at_once(1, 100, settled=False)

    def test_a_new_publisher_of_many_messages_exits_at_once(self):
        self.exits_at_once(200, 100, settled=False)


if __name__ == '__main__':
    harness.main(BridgeOptions, plain=False, needs_library=True)
