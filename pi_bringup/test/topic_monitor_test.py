#!/usr/bin/python3
"""Judge of topic_monitor.test. It starts the monitor itself, to see what it leaves when it is told to end."""

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
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
TIMEOUT_S = 30


class Connected(rospy.SubscribeListener):
    def __init__(self):
        self.peers = queue.Queue()

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        self.peers.put(topic_name)


class TopicMonitor(unittest.TestCase):
    def test_reports_what_it_saw(self):
        rospy.init_node("judge")
        listener = Connected()
        images = rospy.Publisher("/watched/image", Image, listener, queue_size=100)
        texts = rospy.Publisher("/watched/text", String, listener, queue_size=100)
        other = rospy.Publisher("/elsewhere/text", String, queue_size=100)
        reports = queue.Queue()
        subscriber = rospy.Subscriber("/monitor/report", String, lambda message: reports.put(json.loads(message.data)))

        program = roslib.packages.find_node("pi_os_transport", "topic_monitor", rospkg.RosPack())
        self.assertTrue(program, "topic_monitor of pi_os_transport is not built")
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "report.json")
            monitor = subprocess.Popen([program[0], "__name:=monitor", "_namespace:=/watched", "_period_s:=0.2",
                                        "_report:=" + path], stdout=subprocess.PIPE, text=True)
            try:
                self.assertEqual({"/watched/image", "/watched/text"},
                                 {listener.peers.get(timeout=TIMEOUT_S) for _ in range(2)})
                for number in range(MESSAGES):
                    image = Image(data=bytes(PIXELS), height=1, width=PIXELS, step=PIXELS, encoding="mono8")
                    image.header.stamp = rospy.Time.now() - rospy.Duration(AGE_S)
                    images.publish(image)
                    texts.publish("text %d" % number)
                    other.publish("not for the monitor")
                while True:
                    topics = reports.get(timeout=TIMEOUT_S)["topics"]
                    if all(topics.get(name, {}).get("messages") == MESSAGES and topics[name]["transports"]
                           for name in ("/watched/image", "/watched/text")):
                        break
            finally:
                monitor.send_signal(signal.SIGINT)
                table = monitor.communicate(timeout=TIMEOUT_S)[0]
            self.assertEqual(0, monitor.returncode)
            self.assertEqual(["report.json"], os.listdir(folder))
            with open(path) as file:
                report = json.load(file)

        self.assertEqual("/monitor", report["node"])
        self.assertEqual({"/watched/image", "/watched/text"}, set(report["topics"]))
        image = report["topics"]["/watched/image"]
        self.assertEqual(("sensor_msgs/Image", MESSAGES, 0, 0),
                         (image["type"], image["messages"], image["lost"], image["out_of_order"]))
        self.assertGreater(image["bytes"], MESSAGES * PIXELS)
        self.assertEqual({"TCPROS": 1}, image["transports"])
        # Old by AGE_S when published; the upper bound only has to tell seconds from other units.
        self.assertGreaterEqual(image["latency_ms"]["p50"], AGE_S * 1000)
        self.assertLess(image["latency_ms"]["p50"], (AGE_S + TIMEOUT_S) * 1000)
        self.assertLessEqual(image["latency_ms"]["p50"], image["latency_ms"]["p99"])
        self.assertLessEqual(image["latency_ms"]["p99"], image["latency_ms"]["max"])
        text = report["topics"]["/watched/text"]
        self.assertEqual(("std_msgs/String", MESSAGES, None, None),
                         (text["type"], text["messages"], text["latency_ms"], text["lost"]))
        self.assertIn("/watched/image", table)
        self.assertIn("TCPROS", table)
        subscriber.unregister()


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "topic_monitor", TopicMonitor, sys.argv)
