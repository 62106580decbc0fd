#!/usr/bin/python3
"""web_view_node before a client that was written after the protocol's specification alone."""

import http.client
import io
import json
import math
import os
import random
import socket
import ssl
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy
import rospy
import rostest
import std_srvs.srv
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, Transform, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path as PathMessage
from sensor_msgs.msg import BatteryState, CompressedImage, Image, Imu, PointCloud2, PointField
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage

sys.path.insert(0, str(Path(__file__).resolve().parent / "web"))
from foxglove_client import BINARY, TEXT, FoxgloveClient, Refused, WebSocket  # noqa: E402  (found by the line above)
from node_under_test import TOKEN, WebViewNode  # noqa: E402

STAMP = rospy.Time(12, 345)
NODE_MODULES = os.environ.get("PI_WEB_NODE_MODULES", "")


def header(frame="map"):
    return Header(seq=0, stamp=STAMP, frame_id=frame)


def picture(width, height, encoding="bgr8", channels=3):
    """Left half of one colour, right half of another."""
    pixels = numpy.zeros((height, width, channels), numpy.uint8)
    pixels[:, :width // 2] = [200, 30, 30][:channels]
    pixels[:, width // 2:] = [30, 30, 220][:channels]
    return Image(header=header("left_optical"), height=height, width=width, encoding=encoding, step=width * channels,
                 data=pixels.tobytes())


def ten_types():
    cloud = PointCloud2(header=header(), height=1, width=2, point_step=4, row_step=8, data=bytes(range(8)),
                        fields=[PointField("x", 0, PointField.FLOAT32, 1)])
    odometry = Odometry(header=header("odom"), child_frame_id="base_link")
    odometry.pose.covariance[7] = 0.5
    transform = TransformStamped(header("map"), "odom", Transform())
    transform.transform.translation.x = 3.25
    path = PathMessage(header=header(), poses=[PoseStamped(header=header()), PoseStamped(header=header("odom"))])
    grid = OccupancyGrid(header=header(), data=[-1, 0, 100, 50])
    grid.info.width, grid.info.height, grid.info.resolution = 2, 2, 0.25
    status = DiagnosticStatus(level=1, name="vio: odometry", message="µ-blocks", values=[KeyValue("a", "b")])
    return {"string": String("zwölf"), "pose": PoseStamped(header=header()), "imu": Imu(header=header("imu_link")),
            "odometry": odometry, "transforms": TFMessage([transform]), "path": path, "grid": grid, "cloud": cloud,
            "battery": BatteryState(header=header(), voltage=float("nan"), percentage=0.5, cell_voltage=[3.5, 3.75]),
            "status": DiagnosticArray(header=header(), status=[status])}


def serialised(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def assert_same(test, python, script, what):
    """A message of genpy and one that JavaScript decoded and wrote as JSON."""
    if hasattr(python, "__slots__") and hasattr(python, "serialize"):
        for field in python.__slots__:
            assert_same(test, getattr(python, field), script[field], what + "." + field)
    elif hasattr(python, "to_sec"):
        test.assertAlmostEqual(python.to_sec(), script, 6, what)
    elif isinstance(python, float) and math.isnan(python):
        test.assertEqual("NaN", script, what)
    elif isinstance(python, (list, tuple, bytes)):
        test.assertEqual(len(python), len(script), what)
        for i, (a, b) in enumerate(zip(python, script)):
            assert_same(test, a, b, "%s[%d]" % (what, i))
    elif isinstance(python, float):
        test.assertAlmostEqual(python, script, 6, what)
    else:
        test.assertEqual(python, script, what)


def certificates(folder):
    """Writes ca.pem, certificate.pem and key.pem of a server. @return {name: (certificate, key)} of clients"""
    def openssl(*words):
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    new_key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    for authority in ("ca", "other"):
        openssl("req", "-x509", *new_key, "-days", "2", "-subj", "/CN=authority " + authority,
                "-addext", "keyUsage=critical,keyCertSign", "-keyout", authority + ".key", "-out", authority + ".pem")
    Path(folder, "names").write_text("subjectAltName = IP:127.0.0.1\n", encoding="ascii")
    for number, (authority, unit, name) in enumerate((("ca", "vehicle", "server"), ("ca", "operator", "operator"),
                                                      ("ca", "vehicle", "vehicle"), ("other", "operator", "stranger"))):
        openssl("req", "-new", *new_key, "-subj", "/OU=%s/CN=%s" % (unit, name), "-keyout", name + ".key",
                "-out", "request")
        openssl("x509", "-req", "-in", "request", "-days", "2", "-CA", authority + ".pem", "-CAkey", authority + ".key",
                "-extfile", "names", "-set_serial", str(number + 1), "-out", name + ".pem")
    os.rename(os.path.join(folder, "server.pem"), os.path.join(folder, "certificate.pem"))
    os.rename(os.path.join(folder, "server.key"), os.path.join(folder, "key.pem"))
    return {name: (os.path.join(folder, name + ".pem"), os.path.join(folder, name + ".key"))
            for name in ("operator", "vehicle", "stranger")}


def wait_for(condition, what, limit_s=20.0):
    deadline = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError("%s within %g s" % (what, limit_s))
        time.sleep(0.01)


class Repeated:
    """Publishes a message at a rate until its end."""

    def __init__(self, topic, message, rate_hz, stamped=False):
        self._publisher = rospy.Publisher(topic, type(message), queue_size=2)
        self._stop = threading.Event()
        self._message, self._period_s, self._stamped = message, 1.0 / rate_hz, stamped
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self._publisher.unregister()

    def subscribers(self):
        return self._publisher.get_num_connections()

    def _run(self):
        while not self._stop.wait(self._period_s):
            if self._stamped:
                self._message.header.stamp = rospy.Time.from_sec(time.time())
            self._publisher.publish(self._message)


class WebView(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.node = WebViewNode(cls.folder.name, allow_control=True)

    @classmethod
    def tearDownClass(cls):
        status = cls.node.stop()
        cls.folder.cleanup()
        assert status == 0, "web_view_node ended with %s: %s" % (status, "".join(cls.node.lines))

    def open(self, url=None, **options):
        client = FoxgloveClient(url or self.node.websocket, **options)
        self.addCleanup(client.close)
        return client

    # ------------------------------------------------------------------------------------------------------- protocol

    def test_both_names_of_the_protocol(self):
        for name in FoxgloveClient.PROTOCOLS:
            client = self.open(protocols=[name, "other"])
            self.assertIn("Sec-WebSocket-Protocol: " + name, client.head)
            self.assertEqual(["ros1"], client.info["supportedEncodings"])
        with self.assertRaisesRegex(Refused, "400.*no common sub-protocol"):
            try:
                WebSocket(self.node.websocket, ["other"])
            except Refused as error:
                raise Refused(str(error).replace("\r\n", " ")) from None

    def test_ten_types_are_decoded_as_published(self):
        messages = ten_types()
        publishers = {name: rospy.Publisher("/ten/" + name, type(message), queue_size=1, latch=True)
                      for name, message in messages.items()}
        for name, message in messages.items():
            publishers[name].publish(message)
        client = self.open()
        topics = ["/ten/" + name for name in messages]
        client.subscribe(*topics)
        got = {}
        while len(got) < len(topics):
            opcode, data = client.next_where(lambda message: isinstance(message, tuple))
            self.assertEqual(1, opcode)
            number = struct.unpack_from("<I", data)[0]
            topic = next(topic for topic in topics if client.channels[topic]["id"] == number)
            got[topic] = data[12:]
        for name, message in messages.items():
            channel = client.channels["/ten/" + name]
            self.assertEqual((message._type, "ros1", "ros1msg"),
                             (channel["schemaName"], channel["encoding"], channel["schemaEncoding"]))
            decoded = client.decode("/ten/" + name, got["/ten/" + name])
            for one in (message, decoded):
                if hasattr(one, "header"):
                    one.header.seq = 0  # rospy counts it
            self.assertEqual(serialised(message), serialised(decoded))
        # A client that comes later gets what is latched from the server.
        later = self.open()
        later.subscribe("/ten/string")
        self.assertEqual("zwölf", later.decode("/ten/string", later.next_data("/ten/string")[1]).data)
        self.assertEqual(1, publishers["string"].get_num_connections())

    @unittest.skipUnless(NODE_MODULES, "PI_WEB_NODE_MODULES is not set: a folder node_modules with npm's "
                         "@foxglove/ws-protocol, @foxglove/rosmsg, @foxglove/rosmsg-serialization and ws")
    def test_a_client_of_others(self):
        messages = {"/foreign/" + name: message for name, message in ten_types().items()}
        publishers = [rospy.Publisher(topic, type(message), queue_size=1, latch=True)
                      for topic, message in messages.items()]
        for publisher, message in zip(publishers, messages.values()):
            publisher.publish(message)
        rospy.set_param("/web_test/foreign", [1.5, "zwei"])
        stop = rospy.Service("/command/stop", std_srvs.srv.Trigger,
                             lambda _: std_srvs.srv.TriggerResponse(True, "stopped"))
        client = subprocess.run(["node", Path(__file__).parent / "web/foreign_client.js", self.node.websocket, TOKEN,
                                 *messages], env={**os.environ, "NODE_PATH": NODE_MODULES}, timeout=60, text=True,
                                stdout=subprocess.PIPE, check=True)
        told = json.loads(client.stdout)
        for topic, message in messages.items():
            assert_same(self, message, told["values"][topic], topic)
        self.assertEqual(([1.5, "zwei"], {"success": True, "message": "stopped"}, "foxglove.sdk.v1"),
                         (told["value"], told["answer"], told["protocol"]))
        self.assertIn("401", told["refused"])
        stop.shutdown()
        for publisher in publishers:
            publisher.unregister()

    def test_subscribes_only_while_somebody_watches(self):
        with Repeated("/watched", String("x"), 50) as topic:
            client = self.open()
            client.wait_for_channels("/watched")
            self.assertEqual(0, topic.subscribers())
            client.subscribe("/watched")
            client.next_data("/watched")
            self.assertEqual(1, topic.subscribers())
            client.ask("unsubscribe", subscriptionIds=[client.channels["/watched"]["id"]])
            wait_for(lambda: topic.subscribers() == 0, "nobody subscribes")
            client.subscribe("/watched")
            client.next_data("/watched")
            client.close()
            wait_for(lambda: topic.subscribers() == 0, "nobody subscribes")

    def test_pictures_come_small_and_as_jpeg(self):
        with Repeated("/eye/image_raw", picture(1280, 960), 20):
            client = self.open()
            client.subscribe("/eye/image_raw/web")
            message = client.decode("/eye/image_raw/web", client.next_data("/eye/image_raw/web")[1])
            self.assertEqual(("sensor_msgs/CompressedImage", "jpeg 1280x960", "left_optical", STAMP),
                             (client.channels["/eye/image_raw/web"]["schemaName"], message.format,
                              message.header.frame_id, message.header.stamp))
            pixels = cv2.imdecode(numpy.frombuffer(message.data, numpy.uint8), cv2.IMREAD_COLOR)
            self.assertEqual((480, 640, 3), pixels.shape)
            for column, colour in ((160, (200, 30, 30)), (480, (30, 30, 220))):
                self.assertLess(numpy.abs(pixels[240, column].astype(int) - colour).max(), 12)

    def test_channels_of_topics_that_end_are_withdrawn(self):
        client = self.open()
        publisher = rospy.Publisher("/brief", String, queue_size=1)
        client.wait_for_channels("/brief")
        publisher.unregister()
        client.next_op("unadvertise")
        self.assertNotIn("/brief", client.channels)

    def test_parameters(self):
        rospy.set_param("/web_test", {"number": 2, "list": [1.5, 2.5], "text": "ü", "tree": {"deep": True}})
        watcher, driver = self.open(), self.open(self.node.control)
        watcher.ask("getParameters", parameterNames=["/web_test/number", "/web_test", "/none"], id="a")
        answer = watcher.next_op("parameterValues")
        self.assertEqual(("a", [2, rospy.get_param("/web_test"), None]),
                         (answer["id"], [one.get("value") for one in answer["parameters"]]))
        watcher.ask("getParameters", parameterNames=[])
        values = {one["name"]: one["value"] for one in watcher.next_op("parameterValues")["parameters"]}
        self.assertEqual([True, [1.5, 2.5]], [values["/web_test/tree/deep"], values["/web_test/list"]])
        watcher.ask("setParameters", parameters=[{"name": "/web_test/number", "value": 3}])
        self.assertIn("may only watch", watcher.next_op("status")["message"])
        driver.ask("setParameters", id="b", parameters=[{"name": "/web_test/number", "value": 3},
                                                        {"name": "/web_test/text"}])
        self.assertEqual("b", driver.next_op("parameterValues")["id"])
        self.assertEqual((3, False), (rospy.get_param("/web_test/number"), rospy.has_param("/web_test/text")))
        driver.ask("setParameters", parameters=[{"name": "/web_test/number", "value": 2**40}])
        self.assertIn("beyond the integers", driver.next_op("status")["message"])

    def test_graph_and_time_stamps(self):
        client = self.open()
        with Repeated("/seen", String("x"), 20):
            client.subscribe("/seen")
            stamp_ns, _ = client.next_data("/seen")
            self.assertLess(abs(stamp_ns * 1e-9 - time.time()), 5.0)
            client.ask("subscribeConnectionGraph")
            seen = client.next_where(lambda message: isinstance(message, dict) and any(
                one["name"] == "/seen" and "/web_view" in one["subscriberIds"]
                for one in message.get("subscribedTopics", [])))
            self.assertTrue(any("/web_view/get_loggers" == one["name"] for one in seen["advertisedServices"]) or
                            seen["op"] == "connectionGraphUpdate")

    def test_links_are_told_by_transport(self):
        client = self.open()
        client.wait_for_channels("/rosout")
        publisher = rospy.Publisher("/linked", String, queue_size=1)
        subscriber = rospy.Subscriber("/linked", String)

        def told():
            with urllib.request.urlopen(self.node.url + "links.json") as answer:
                return [one for one in json.load(answer) if "/linked" in one["topics"]]

        wait_for(told, "the link is told")
        self.assertEqual("TCPROS", told()[0]["transport"])
        self.assertGreater(told()[0]["links"], 0)
        subscriber.unregister()
        publisher.unregister()

    def test_assets_of_packages_alone(self):
        client = self.open()
        package = Path(self.folder.name) / "robot_of_test"
        wanted = {"package://pi_node/package.xml": "only files .urdf", "file:///etc/passwd.urdf": "only package://",
                  "package://pi_node/../../../etc/passwd.urdf": "no such file",
                  "package://../x.urdf": "ROS_PACKAGE_PATH",
                  "package://pi_web/test/web/../../../README.urdf": "no such file"}
        for number, (uri, why) in enumerate(wanted.items()):
            client.ask("fetchAsset", uri=uri, requestId=number)
            _, data = client.next_where(lambda message: isinstance(message, tuple) and message[0] == 4)
            self.assertEqual((number, 1), struct.unpack_from("<IB", data))
            self.assertIn(why, data[9:].decode())
        self.assertFalse(package.exists())
        client.ask("fetchAsset", uri="package://pi_web/test/web/robot.urdf", requestId=9)
        _, data = client.next_where(lambda message: isinstance(message, tuple) and message[0] == 4)
        self.assertEqual((9, 0, 0), struct.unpack_from("<IBI", data))
        self.assertEqual((Path(__file__).parent / "web/robot.urdf").read_bytes(), data[9:])

    # --------------------------------------------------------------------------------------------------------- control

    def test_services_and_publishing_need_the_token(self):
        called = []

        def stop(_):
            called.append("stop")
            return std_srvs.srv.TriggerResponse(True, "stopped")

        def fail(_):
            raise rospy.ServiceException("brakes are hot")

        served = [rospy.Service("/command/stop", std_srvs.srv.Trigger, stop),
                  rospy.Service("/command/release", std_srvs.srv.Trigger, fail)]
        goals = []
        subscriber = rospy.Subscriber("/goal", PoseStamped, goals.append)
        driver, watcher = self.open(self.node.control), self.open()
        self.assertEqual([True, False], ["clientPublish" in one.info["capabilities"] for one in (driver, watcher)])
        while not {"/command/stop", "/command/release"} <= set(driver.services):
            driver.next()
        self.assertIn("bool success", driver.services["/command/stop"]["responseSchema"])
        response = driver.call("/command/stop")
        self.assertIsInstance(response, bytes, response)
        answer = std_srvs.srv.TriggerResponse().deserialize(response)
        self.assertEqual((True, "stopped", ["stop"]), (answer.success, answer.message, called))
        failure = driver.call("/command/release")
        self.assertIn("brakes are hot", failure["message"])
        self.assertEqual({}, watcher.services)
        watcher.services = driver.services
        self.assertIn("may only watch", watcher.call("/command/stop")["message"])
        self.assertEqual(["stop"], called)

        channel = {"id": 3, "topic": "/goal", "encoding": "ros1", "schemaName": "geometry_msgs/PoseStamped"}
        for client in (watcher, driver):
            client.ask("advertise", channels=[channel])
        self.assertIn("may only watch", watcher.next_op("status")["message"])
        wait_for(lambda: subscriber.get_num_connections() == 1, "the goal's subscriber is connected")
        goal = PoseStamped(header=header())
        goal.pose.position.x = 4.5

        def comes():
            driver.publish(3, serialised(goal))  # the publisher may know its subscriber later than that the publisher
            return goals

        wait_for(comes, "the goal comes")
        self.assertEqual(serialised(goal.pose), serialised(goals[0].pose))
        driver.ask("advertise", channels=[{**channel, "id": 4, "topic": "/motion"}])
        self.assertIn("see publish_topics", driver.next_op("status")["message"])
        driver.publish(99, b"")
        self.assertIn("client channel 99 does not exist", driver.next_op("status")["message"])
        for one in served:
            one.shutdown()
        subscriber.unregister()

    def test_wrong_tokens_hosts_and_origins_are_refused(self):
        host = urlsplit(self.node.url).netloc
        for url, headers, why in (
                (self.node.websocket + "?token=wrong", [], "wrong token"),
                (self.node.websocket + "?token=" + TOKEN + "0", [], "wrong token"),
                (self.node.websocket, ["Host: evil.example:80"], "host name"),
                (self.node.websocket, ["Origin: https://evil.example"], "comes from elsewhere"),
                (self.node.websocket, ["Origin: null"], "comes from elsewhere")):
            with self.assertRaises(Refused, msg=why) as refused:
                FoxgloveClient(url, headers=headers)
            self.assertIn("401", str(refused.exception).split("\r\n")[0])
            self.assertIn(why, str(refused.exception))
        for origin in ("http://" + host, "https://app.foxglove.dev", "file://"):
            self.open(headers=["Origin: " + origin])
        wait_for(lambda: any("wrong token" in line for line in self.node.lines), "the refusal is in the log")
        self.assertEqual(0o600, os.stat(self.node.token_file).st_mode & 0o600)

    # ---------------------------------------------------------------------------------------------------------- abuse

    def test_wrong_requests_are_told_and_end_in_a_disconnection(self):
        client = self.open()
        for text, why in ((b"x", "JSON object"), (b'{"op":"fly"}', "fly"), (b'{"op":"subscribe"}', "subscriptions"),
                          (b'{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}]}', "id must be"),
                          (b'{"op":"subscribe","subscriptions":[{"id":1,"channelId":999999}]}', "does not exist")):
            client.send_frame(TEXT, text)
            self.assertIn(why, client.next_op("status")["message"])
        with self.assertRaises(ConnectionError):
            for _ in range(200):
                client.send_frame(TEXT, b"x")
                client.next_op("status")

    def test_garbage_and_announced_gigabytes_end_only_their_connection(self):
        bystander = self.open()
        rng = random.Random(5)
        host, port = urlsplit(self.node.url).hostname, urlsplit(self.node.url).port
        for _ in range(60):  # not even HTTP
            with socket.create_connection((host, port), 10) as one:
                try:
                    one.sendall(rng.randbytes(rng.randrange(1, 3000)) + b"\r\n\r\n")
                    one.shutdown(socket.SHUT_WR)
                    while one.recv(4096):
                        pass
                except OSError:
                    pass
        for _ in range(60):  # frames of a client gone mad
            client = self.open()
            try:
                for _ in range(20):
                    client.send_frame(rng.choice([TEXT, BINARY, 0, 3, 8, 9, 15]), rng.randbytes(rng.randrange(60)))
            except ConnectionError:
                pass
            client.close()
        before_kb = self.node.status("VmRSS")
        giant = self.open()
        giant.send_frame(BINARY, b"begins", announced=1 << 30)
        with self.assertRaises(ConnectionError):
            while True:
                giant.next()
        self.assertLess(self.node.status("VmRSS"), before_kb + 5000)
        wait_for(lambda: any("is disconnected" in line for line in self.node.lines), "the disconnection is in the log")
        bystander.ask("getParameters", parameterNames=["/run_id"], id="alive")
        self.assertEqual("alive", bystander.next_op("parameterValues")["id"])

    def test_a_thousand_connections_leave_nothing_behind(self):
        def connect(count):
            for i in range(count):
                client = FoxgloveClient(self.node.control if i % 2 else self.node.websocket)
                client.subscribe("/rosout")
                client.close()
        connect(100)
        wait_for(lambda: self.node.descriptors() < 60, "connections are closed")
        descriptors, before_kb = self.node.descriptors(), self.node.status("VmRSS")
        connect(1000)
        wait_for(lambda: self.node.descriptors() <= descriptors + 2, "all connections are closed")
        self.assertLess(self.node.status("VmRSS"), before_kb + 3000)
        watcher = self.open()
        watcher.ask("getParameters", parameterNames=["/run_id"], id="alive")
        self.assertEqual("alive", watcher.next_op("parameterValues")["id"])

    def test_most_clients_and_slow_requests(self):
        clients = [self.open() for _ in range(50)]
        host, port = urlsplit(self.node.url).hostname, urlsplit(self.node.url).port
        slow = [socket.create_connection((host, port), 20) for _ in range(20)]
        for one in slow:
            one.sendall(b"GET / HTTP/1.1\r\nHost: loc")
        page = http.client.HTTPConnection(host, port, timeout=10)
        page.request("GET", "/")
        answer = page.getresponse()
        self.assertEqual((200, True), (answer.status, b"<title>" in answer.read()))
        for one in slow:
            self.assertEqual(b"", one.recv(100))  # ended after 10 s
            one.close()
        for one in clients:
            one.close()
        page.close()

    def test_a_stalled_client_costs_only_its_own_pictures(self):
        odometry = Odometry(child_frame_id="base_link")
        with Repeated("/large/image_raw", picture(1920, 1080), 15), \
                Repeated("/quick/odometry", odometry, 100, stamped=True):
            watcher = self.open()
            watcher.subscribe("/quick/odometry")
            watcher.next_data("/quick/odometry")
            stalled = self.open(receive_buffer=16384)
            stalled.subscribe("/large/image_raw", "/quick/odometry")
            stalled.next_data("/large/image_raw")  # and reads no more
            memory_kb, delays = [], []
            for i in range(800):
                _, data = watcher.next_data("/quick/odometry")
                sent = Odometry().deserialize(data).header.stamp.to_sec()
                delays.append(time.time() - sent)
                if i % 100 == 50:
                    memory_kb.append(self.node.status("VmRSS"))
            self.assertLess(max(memory_kb[2:]) - min(memory_kb[2:]), 15000)
            self.assertLess(sorted(delays)[len(delays) // 2], 0.05)  # the bench judges figures

    # ----------------------------------------------------------------------------------------------------------- files

    def test_files_of_the_page_alone_are_served(self):
        host, port = urlsplit(self.node.url).hostname, urlsplit(self.node.url).port
        Path(self.folder.name, "incident_2026-11-29T16-40-00Z_collision.bag").write_bytes(b"x" * 1000)
        connection = http.client.HTTPConnection(host, port, timeout=10)
        for path, status, begin in (("/", 200, b"<!DOCTYPE"), ("/app.js", 200, b"//"), ("/style.css", 200, b":root"),
                                    ("/../package.xml", 404, b"there is no"), ("/%2e%2e/package.xml", 404, b"there"),
                                    ("//etc/passwd", 404, b"there is no"),
                                    ("/incidents.json", 200, b'[{"cause":"collision","file":"incident_2026')):
            connection.request("GET", path)
            answer = connection.getresponse()
            body = answer.read()
            self.assertEqual((path, status, begin), (path, answer.status, body[:len(begin)]))
            if status != 200:
                connection.close()
        connection.request("POST", "/")
        self.assertEqual(405, connection.getresponse().status)


class OtherAddresses(unittest.TestCase):
    def test_watching_from_elsewhere_needs_the_token(self):
        with tempfile.TemporaryDirectory() as folder:
            node = WebViewNode(folder, name="web_view_open", address="0.0.0.0")
            try:
                url = "ws://127.0.0.1:%d/" % urlsplit(node.url).port
                with self.assertRaisesRegex(Refused, "401"):
                    FoxgloveClient(url)
                client = FoxgloveClient(url + "?token=" + TOKEN)
                self.assertNotIn("clientPublish", client.info["capabilities"])  # allow_control is not set
                client.close()
            finally:
                node.stop()

    def test_tls_with_the_certificates_of_a_fleet(self):
        with tempfile.TemporaryDirectory() as folder:
            ends = certificates(folder)
            node = WebViewNode(folder, name="web_view_tls", tls_folder=folder, allow_control=True)
            try:
                self.assertTrue(node.url.startswith("https://127.0.0.1:"), node.url)

                def client(end=None, query=""):
                    context = ssl.create_default_context(cafile=os.path.join(folder, "ca.pem"))
                    if end:
                        context.load_cert_chain(*ends[end])
                    opened = FoxgloveClient(node.websocket + query, tls=context)
                    self.addCleanup(opened.close)
                    return opened

                for end, query, control in ((None, "", False), (None, "?token=" + TOKEN, True), ("operator", "", True),
                                            ("vehicle", "", False)):
                    info = client(end, query).info
                    self.assertEqual(control, "clientPublish" in info["capabilities"], "%s %s" % (end, query))
                with self.assertRaises(ssl.SSLCertVerificationError):
                    FoxgloveClient(node.websocket)
                with self.assertRaises((ssl.SSLError, ConnectionError)):
                    client("stranger")
                context = ssl.create_default_context(cafile=os.path.join(folder, "ca.pem"))
                with urllib.request.urlopen(node.url, context=context) as page:
                    self.assertIn(b"<!DOCTYPE html>", page.read())
                with socket.create_connection(("127.0.0.1", urlsplit(node.url).port)) as plain:
                    plain.settimeout(20.0)
                    plain.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                    self.assertNotIn(b"200", plain.recv(100))
                wait_for(lambda: any("TLS" in line for line in node.lines), "the refusals are in the log")
            finally:
                node.stop()
            os.remove(os.path.join(folder, "key.pem"))
            with self.assertRaises(RuntimeError) as refused:
                WebViewNode(folder, name="web_view_keyless", tls_folder=folder)
            self.assertIn("key.pem: No such file", str(refused.exception))
            os.rename(os.path.join(folder, "vehicle.key"), os.path.join(folder, "key.pem"))
            with self.assertRaises(RuntimeError) as refused:
                WebViewNode(folder, name="web_view_wrong_key", tls_folder=folder)
            self.assertIn("key.pem: it is no PEM, or does not belong", str(refused.exception))

    def test_a_port_in_use_and_a_short_token_are_told(self):
        with tempfile.TemporaryDirectory() as folder, socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            with self.assertRaisesRegex(RuntimeError, "choose others, or end what listens there"):
                WebViewNode(folder, name="web_view_late", port=taken.getsockname()[1])
            Path(folder, "short").write_text("abc", encoding="ascii")
            with self.assertRaisesRegex(RuntimeError, "must be 16 or more"):
                WebViewNode(folder, name="web_view_short", allow_control=True, token_file=folder + "/short")


if __name__ == "__main__":
    rospy.init_node("web_view_test")
    rostest.rosrun("pi_web", "web_view", "__main__")
