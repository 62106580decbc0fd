#!/usr/bin/python3
"""Judge of topic_monitor.test. It starts the monitor itself, to see what it leaves when it is told to end."""

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import rospkg
import rospy
import roslib.packages
import rostest
from sensor_msgs.msg import Image
from std_msgs.msg import String

MESSAGES = 25
AGE_S = 2.0
PIXELS = 1000
LARGE_PIXELS = 1000000
LARGE_MESSAGES = 64  # more than the queues and the socket of a link hold
TIMEOUT_S = 30


class Connected(rospy.SubscribeListener):
    def __init__(self):
        self.peers = queue.Queue()

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        self.peers.put(topic_name)


class NumberedImage(Image):
    """A picture that keeps the header.seq it was given: rospy numbers only what it knows to have a header."""
    _has_header = False


def make_image(pixels=PIXELS, kind=Image):
    image = kind(data=bytes(pixels), height=1, width=pixels, step=pixels, encoding="mono8")
    image.header.stamp = rospy.Time.now() - rospy.Duration(AGE_S)
    return image


class Node:
    """A roscpp node of this run, preloaded or not."""

    def __init__(self, package, program, *arguments):
        paths = roslib.packages.find_node(package, program, rospkg.RosPack())
        if not paths:
            raise RuntimeError("%s of %s is not installed or not built" % (program, package))
        environment = dict(os.environ)
        if rospy.get_param("~preload"):
            environment["LD_PRELOAD"] = rospy.get_param("~preload")
        self.process = subprocess.Popen([paths[0], *arguments], env=environment, stdout=subprocess.PIPE, text=True)
        self.output = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGCONT)
        self.process.send_signal(signal.SIGINT)
        try:
            self.output = self.process.communicate(timeout=TIMEOUT_S)[0]
        finally:
            self.process.kill()

    def pause(self):
        self.process.send_signal(signal.SIGSTOP)
        os.waitpid(self.process.pid, os.WUNTRACED)

    def resume(self):
        self.process.send_signal(signal.SIGCONT)


class Monitor(Node):
    def __init__(self, name, *arguments):
        super().__init__("pi_os_transport", "topic_monitor", "__name:=" + name, "_period_s:=0.2", *arguments)
        self.reports = queue.Queue()
        self.subscriber = rospy.Subscriber("/%s/report" % name, String,
                                           lambda message: self.reports.put(json.loads(message.data)["topics"]))

    def __exit__(self, *arguments):
        super().__exit__(*arguments)
        self.subscriber.unregister()

    def wait_for(self, condition):
        """The topics of the first report that meets condition(topics), else of the last one in time."""
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            topics = self.reports.get(timeout=TIMEOUT_S)
            if condition(topics) or time.monotonic() > deadline:
                return topics


class TopicMonitor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("judge")

    def test_reports_what_it_saw(self):
        listener = Connected()
        images = rospy.Publisher("/watched/image", Image, listener, queue_size=100)
        texts = rospy.Publisher("/watched/text", String, listener, queue_size=100)
        other = rospy.Publisher("/elsewhere/text", String, queue_size=100)
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "report.json")
            with Monitor("monitor", "_namespace:=/watched", "_report:=" + path) as monitor:
                self.assertEqual({"/watched/image", "/watched/text"},
                                 {listener.peers.get(timeout=TIMEOUT_S) for _ in range(2)})
                for number in range(MESSAGES):
                    images.publish(make_image())
                    texts.publish("text %d" % number)
                    other.publish("not for the monitor")
                monitor.wait_for(lambda topics: all(
                    topics.get(name, {}).get("messages") == MESSAGES and topics[name]["transports"]
                    for name in ("/watched/image", "/watched/text")))
            self.assertEqual(0, monitor.process.returncode)
            self.assertEqual(["report.json"], os.listdir(folder))
            with open(path) as file:
                report = json.load(file)

        self.assertEqual("/monitor", report["node"])
        self.assertEqual({"/watched/image", "/watched/text"}, set(report["topics"]))
        image = report["topics"]["/watched/image"]
        self.assertEqual(("sensor_msgs/Image", MESSAGES, 0, 0),
                         (image["type"], image["messages"], image["lost"], image["out_of_order"]))
        self.assertGreater(image["bytes"], MESSAGES * PIXELS)
        self.assertEqual({"TCPROS": 1}, image["transports"])  # the judge is rospy
        # Old by AGE_S when published; the upper bound only has to tell seconds from other units.
        self.assertGreaterEqual(image["latency_ms"]["p50"], AGE_S * 1000)
        self.assertLess(image["latency_ms"]["p50"], (AGE_S + TIMEOUT_S) * 1000)
        self.assertLessEqual(image["latency_ms"]["p50"], image["latency_ms"]["p99"])
        self.assertLessEqual(image["latency_ms"]["p99"], image["latency_ms"]["max"])
        text = report["topics"]["/watched/text"]
        self.assertEqual(("std_msgs/String", MESSAGES, None, None),
                         (text["type"], text["messages"], text["latency_ms"], text["lost"]))
        self.assertIn("/watched/image", monitor.output)
        self.assertIn("TCPROS", monitor.output)

    def test_counts_what_is_lost_on_a_link_between_roscpp_nodes(self):
        transport = "SHMROS" if rospy.get_param("~preload") else "TCPROS"
        topic = "/relayed/image"
        # The relay passes messages on as they are, with the number they have, so the judge decides on the gaps.
        listener = Connected()
        source = rospy.Publisher("/judge/image", NumberedImage, listener, queue_size=2 * LARGE_MESSAGES)
        arrived = queue.Queue()
        observer = rospy.Subscriber(topic, Image, lambda message: arrived.put(message.header.seq))

        def publish(seq, pixels=PIXELS):
            image = make_image(pixels, NumberedImage)
            image.header.seq = seq
            source.publish(image)

        def await_arrival(seq):
            while arrived.get(timeout=TIMEOUT_S) != seq:
                pass

        with Node("topic_tools", "relay", "/judge/image", topic, "__name:=relay"), \
                Monitor("loss_monitor", "_namespace:=/relayed", "_print_table:=false") as monitor:
            listener.peers.get(timeout=TIMEOUT_S)
            publish(1)  # the relay advertises with its first message, to which nobody can be connected in time
            topics = monitor.wait_for(lambda topics: topics.get(topic, {}).get("transports") == {transport: 1})
            self.assertEqual({transport: 1}, topics[topic]["transports"])
            before = topics[topic]

            deadline = time.monotonic() + TIMEOUT_S  # rospy signals no event when a subscriber connects
            while observer.get_num_connections() == 0 and time.monotonic() < deadline:
                time.sleep(0.01)
            gaps = {5, 10, 11, 20}
            numbers = [seq for seq in range(2, 2 + MESSAGES) if seq not in gaps]
            for seq in numbers:
                publish(seq)
                await_arrival(seq)  # the relay's own queue is shorter than this series
            expected = (before["messages"] + len(numbers), len(gaps), 0)

            def figures(topics):
                return topics[topic]["messages"], topics[topic]["lost"], topics[topic]["out_of_order"]

            self.assertEqual(expected, figures(monitor.wait_for(lambda topics: figures(topics) == expected)))

            # Overflow: the relay drops what a monitor that stands still does not take.
            seq = numbers[-1]
            monitor.pause()
            for _ in range(LARGE_MESSAGES):
                seq += 1
                publish(seq, LARGE_PIXELS)
            await_arrival(seq)
            monitor.resume()
            topics = monitor.wait_for(lambda topics: sum(figures(topics)) >= sum(expected) + LARGE_MESSAGES)
            messages, lost, out_of_order = figures(topics)
            self.assertEqual(sum(expected) + LARGE_MESSAGES, messages + lost)
            self.assertGreater(lost, len(gaps))
            self.assertEqual(0, out_of_order)
        observer.unregister()


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "topic_monitor", TopicMonitor, sys.argv)
