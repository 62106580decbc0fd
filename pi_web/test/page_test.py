#!/usr/bin/python3
"""The page in Chromium, before a played vehicle."""

import base64
import json
import math
import os
import sys
import tempfile
import unittest
from pathlib import Path

import rosbag
import rospy
import rostest
import std_srvs.srv
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from pi_detect.msg import ObstacleArray
from pi_offload.msg import OffloadDecision
from pi_runtime.msg import RuntimeStatus, Stream
from pi_vehicle.msg import ArbiterState, VehicleState
from std_msgs.msg import ColorRGBA
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parent / "web")]
import chromium  # noqa: E402  (found through the line above)
from node_under_test import TOKEN, WebViewNode  # noqa: E402
from played_vehicle import (  # noqa: E402
    BASE_IN_MAP, BOX, CAMERA, FOCAL_PX, HEIGHT, WIDTH, PlayedVehicle, obstacle, set_pose, transform)
from web_view_test import assert_same, serialised, ten_types, wait_for  # noqa: E402

PICTURES = os.environ.get("PI_WEB_PICTURES", "")
SEEN = "!document.querySelector('#camera-canvas').hidden && document.querySelector('#doing').textContent === 'stands'"
# Whether two panels overlap, what is wider than the page, and texts that are cut off.
LAYOUT = """(() => {
  const sections = [...document.querySelectorAll('main > section')];
  const boxes = sections.map((one) => one.getBoundingClientRect());
  const wrong = [];
  boxes.forEach((a, i) => boxes.forEach((b, j) => {
    if (i < j && a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1)
      wrong.push(`${sections[i].id} over ${sections[j].id}`);
  }));
  if (document.documentElement.scrollWidth > window.innerWidth) wrong.push('wider than the screen');
  for (const one of document.querySelectorAll('button, dd, td, strong, #why'))
    if (one.scrollWidth > one.clientWidth + 1 && one.clientWidth) wrong.push(`cut off: ${one.textContent}`);
  return wrong;
})()"""


@unittest.skipUnless(chromium.find(), "there is no Chromium")
class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        Path(cls.folder.name, "incident_2026-11-29T16-40-00Z_emergency_braking.bag").write_bytes(b"x" * 4200000)
        cls.node = WebViewNode(cls.folder.name, allow_control=True)
        cls.vehicle = PlayedVehicle()
        cls.called = []
        cls.services = [rospy.Service("/command/" + name, std_srvs.srv.Trigger, cls.serve(name))
                        for name in ("stop", "release")]
        cls.page = chromium.Page()

    @classmethod
    def serve(cls, name):
        def answer(_):
            cls.called.append(name)
            return std_srvs.srv.TriggerResponse(True, name + " done")
        return answer

    @classmethod
    def tearDownClass(cls):
        cls.page.close()
        cls.vehicle.stop()
        cls.node.stop()
        cls.folder.cleanup()

    def show(self, query="?token=" + TOKEN, size=(1440, 900)):
        self.page.resize(*size)
        self.page.open(self.node.url + query)
        self.page.wait_until(SEEN)

    def keep(self, name, **options):
        if PICTURES:
            self.page.picture(os.path.join(PICTURES, name + ".png"), **options)

    def pixel(self, canvas, x, y):
        return self.page.evaluate("[...document.querySelector('%s').getContext('2d').getImageData(%d, %d, 1, 1).data]"
                                  % (canvas, round(x), round(y)))

    def test_boxes_are_at_the_right_pixels(self):
        self.show()
        red = [0xd1, 0x24, 0x2f, 255]  # --person
        left, top, width, height = BOX
        self.page.wait_until("document.querySelector('#camera-canvas').getContext('2d')"
                             ".getImageData(%d, %d, 1, 1).data[0] === 0xd1" % (left, top + height // 2))
        for x, y in ((left, top + height / 2), (left + width, top + height / 2), (left + width / 2, top + height)):
            self.assertEqual(red, self.pixel("#camera-canvas", x, y))
        for x, y in ((left - 6, top + height / 2), (left + 6, top + height / 2), (left + width + 6, top + height / 2)):
            self.assertNotEqual(red, self.pixel("#camera-canvas", x, y))
        self.keep("desktop")

    def test_the_way_ahead_is_in_the_picture(self):
        self.show()
        ahead = 4.0 - CAMERA[0]
        x, y = WIDTH / 2, HEIGHT / 2 + FOCAL_PX * CAMERA[1] / ahead
        script = "[...document.querySelector('#camera-canvas').getContext('2d').getImageData(%d, %d, 1, 1).data]"
        self.page.wait_until("(([r, , b]) => b > r + 30)(%s)" % script % (x, y))
        aside = FOCAL_PX * 0.55 / ahead  # the vehicle is 0.8 m wide
        for side in (x - aside - 12, x + aside):  # the route goes 0.13 m to the left there
            red, _, blue, _ = self.pixel("#camera-canvas", side, y)
            self.assertLess(abs(blue - red), 12, "at %d" % side)

    def record(self, name, seconds=6.0, **options):
        """A recording of the vehicle that goes 1 m/s, with a box ahead. @return the path"""
        path = os.path.join(self.folder.name, name)
        with rosbag.Bag(path, "w", **options) as bag:
            def write(topic, message, at, frame=""):
                stamp = rospy.Time.from_sec(1000.0 + at)
                message.header.stamp, message.header.frame_id = stamp, frame
                bag.write(topic, message, stamp)
            for step in range(int(seconds * 10)):
                at = 0.1 * step
                odometry = Odometry(child_frame_id="base_link")
                set_pose(odometry.pose.pose, at, 0.0, 0.0)
                write("/odometry", odometry, at, "odom")
                bag.write("/tf", TFMessage([transform("map", "odom", 0, 0, 0)]), rospy.Time.from_sec(1000.0 + at))
                write("/vehicle_state", VehicleState(speed=1.0, moving=True, mode=VehicleState.DRIVING), at, "base_link")
                write("/obstacles", ObstacleArray(obstacles=[obstacle(1, "car", 5.0, 0.0, (1, 1))]), at, "base_link")
                if step == 30:
                    write("/arbiter/state", ArbiterState(reason="braking for obstacle 1"), at)
        return path

    def test_an_incident_is_played_again(self):
        name = "incident_2026-11-29T17-40-00Z_collision.bag"
        self.record(name)
        self.show()
        self.page.open(self.page.wait_until("[...document.querySelectorAll('#incident-list a')].find("
                                            "(one) => one.textContent === 'collision').href"))
        self.page.wait_until("document.querySelector('#connection').textContent === 'recording' &&"
                             " document.querySelector('#doing').textContent === 'drives'")
        self.page.wait_until("Number(document.querySelector('#moment').value) > 0.5")
        self.assertEqual([True] * 4, self.page.evaluate(
            "[...document.querySelectorAll('#controls button')].map((one) => one.disabled)"))
        self.page.click_on("#play")  # stands still
        self.page.wait_until("document.querySelector('#play').textContent === 'Play'")
        seek = """(() => { const moment = document.querySelector('#moment'); moment.value = %.1f;
          moment.dispatchEvent(new Event('input')); return true; })()"""
        self.page.evaluate(seek % 4.0)
        self.page.wait_until("document.querySelector('#why').textContent === 'braking for obstacle 1'")
        self.page.evaluate(seek % 1.0)
        self.page.wait_until("document.querySelector('#why').textContent === ''")
        self.keep("incident")
        self.page.evaluate(seek % 5.8)
        self.page.click_on("#play")
        self.page.wait_until("document.querySelector('#when').textContent === '5.9 of 5.9 s' &&"
                             " document.querySelector('#play').textContent === 'Play'")
        self.page.open(self.page.evaluate("document.querySelector('#live').href"))
        self.page.wait_until("document.querySelector('#connection').textContent === 'connected'")
        self.assertEqual([], self.page.problems)

    def test_recordings_that_are_not_whole_are_told(self):
        cut = self.record("incident_2026-11-29T18-00-00Z_cut.bag")
        with open(cut, "r+b") as file:
            file.truncate(os.path.getsize(cut) // 2)
        self.record("incident_2026-11-29T18-01-00Z_packed.bag", compression="bz2")
        Path(self.folder.name, "incident_2026-11-29T18-02-00Z_other.bag").write_bytes(b"no bag")
        for name, words in (("00-00Z_cut", ""), ("01-00Z_packed", "rosbag decompress"), ("02-00Z_other", "no bag of"),
                            ("03-00Z_gone", "No such file")):
            self.page.open(self.node.url + "?play=incidents/incident_2026-11-29T18-" + name + ".bag&token=" + TOKEN)
            if not words:
                self.page.wait_until("Number(document.querySelector('#moment').value) > 0.5")
                continue
            text = self.page.wait_until("!document.querySelector('#lost').hidden &&"
                                        " document.querySelector('#lost').textContent")
            self.assertIn(words, text)
        self.page.problems.clear()  # the browser complains of the file that is not there

    def test_work_of_stages_and_edge_nodes(self):
        runtime = rospy.Publisher("/runtime/status", RuntimeStatus, queue_size=1, latch=True)
        runtime.publish(RuntimeStatus(streams=[
            Stream(name="slam_front_end", unit="cpu0", jobs=400, missed=0, p99_s=0.012),
            Stream(name="detection", unit="cpu1", jobs=100, missed=4, p99_s=0.131)]))
        decisions = rospy.Publisher("/offload/decisions", OffloadDecision, queue_size=1, latch=True)
        decisions.publish(OffloadDecision(kind="detection", how="remote", node="gate", reason="cheapest in time",
                                          response_time=0.062, by_deadline=True))
        marker = Marker(ns="nodes", type=Marker.CYLINDER, color=ColorRGBA(0, 0.8, 0.2, 1))
        marker.header.frame_id = "map"
        marker.pose.position.x, marker.pose.position.y = BASE_IN_MAP[0] + 6, BASE_IN_MAP[1] - 8
        markers = rospy.Publisher("/coordinator/markers", MarkerArray, queue_size=1, latch=True)
        markers.publish(MarkerArray([marker]))
        self.show()
        self.page.wait_until(
            "((one) => [...one.getContext('2d').getImageData(one.width / 2 + 6 * 14, one.height / 2 + 8 * 14, 1, 1).data]"
            ".join() === '0,204,51,255')(document.querySelector('#map-canvas'))")
        self.page.wait_until("document.querySelector('#links').innerText.includes('TCPROS')")
        self.page.wait_until("['#offloaded', '#streams'].every((one) => !document.querySelector(one).hidden)")
        for words in ("slam front end", "cpu0", "12 ms", "131 ms", "4 %", "100 % edge nodes", "62 ms",
                      "detection: remote by gate; cheapest in time"):
            self.page.wait_until("document.querySelector('#work').innerText.includes('%s')" % words)
        self.assertEqual([], self.page.evaluate(LAYOUT))
        self.keep("work")
        runtime.unregister()
        decisions.unregister()
        markers.unregister()

    def test_state_and_figures_are_told_in_words(self):
        self.show()
        self.page.wait_until("document.querySelector('#power').children.length === 3")
        for words in ("a person is 4 m ahead", "76 %", "6.0 W (model)", "28 % of 4 cores", "2 h 13 min",
                      "odometry few features", "1 of 4 complain", "emergency braking", "localisation", "connected",
                      "-32 dB", "stop (0.91)"):
            self.page.wait_until("document.body.innerText.includes('%s')" % words)
        self.assertAlmostEqual(-31.8, self.page.evaluate("document.querySelector('#figures meter').value"))
        self.assertEqual([], self.page.problems)

    def test_a_click_sets_the_goal(self):
        goals = []
        subscriber = rospy.Subscriber("/goal", PoseStamped, goals.append)
        self.show()
        wait_for(lambda: subscriber.get_num_connections() == 1, "the page publishes the goal")
        self.page.wait_until("!document.querySelector('#goal').disabled")
        self.page.click_on("#goal")
        x, y = self.page.middle_of("#map-canvas")
        scale = 14  # pixels per metre, at first
        self.page.click(x + 5 * scale, y - 3 * scale)  # the vehicle is in the middle
        wait_for(lambda: goals, "the goal comes")
        position = goals[0].pose.position
        self.assertEqual("map", goals[0].header.frame_id)
        self.assertLess(math.hypot(position.x - BASE_IN_MAP[0] - 5, position.y - BASE_IN_MAP[1] - 3), 0.1)
        self.page.click(x, y)  # not armed any more
        self.page.click_on("#stop")
        wait_for(lambda: "stop" in self.called, "stop comes")
        self.page.wait_until("document.querySelector('#hint').textContent === 'stop done'")
        self.assertEqual(1, len(goals))
        subscriber.unregister()

    def test_who_only_watches_has_no_buttons(self):
        self.show(query="")
        self.assertEqual([True] * 4, self.page.evaluate(
            "[...document.querySelectorAll('#controls button')].map((one) => one.disabled)"))

    def test_a_phone_has_no_overlap(self):
        for width, height in ((390, 844), (360, 640), (800, 1100), (1440, 900), (1920, 1080)):
            self.show(size=(width, height))
            self.page.wait_until("document.querySelector('#power').children.length === 3")
            self.assertEqual([], self.page.evaluate(LAYOUT), "at %d px" % width)
            if width == 390:
                self.keep("phone", whole=True)
            if width == 800:
                self.keep("tablet", whole=True)

    def test_messages_are_decoded_as_published(self):
        for name, message in ten_types().items():
            data = serialised(message)
            full_text = message._full_text
            decoded = json.loads(self.decode(full_text, data))
            for field in message.__slots__:
                assert_same(self, getattr(message, field), decoded[field], name + "." + field)

    def decode(self, definition, data):
        if self.page.evaluate("location.href") == "about:blank":
            self.show()
        return self.page.evaluate("""import('/rosmsg.js').then(({Decoder}) => {
          const bytes = Uint8Array.from(atob(%s), (c) => c.charCodeAt(0));
          const plain = (key, value) => ArrayBuffer.isView(value) ? [...value] : Number.isNaN(value) ? 'NaN' : value;
          return JSON.stringify(new Decoder(%s).decode(new DataView(bytes.buffer)), plain);
        })""" % (json.dumps(base64.b64encode(data).decode()), json.dumps(definition)))

    def test_a_lost_connection_is_shown_and_mended(self):
        with tempfile.TemporaryDirectory() as folder:
            node = WebViewNode(folder, name="web_view_mortal")
            self.page.open(node.url)
            self.page.wait_until(SEEN)
            self.assertEqual(True, self.page.evaluate("document.querySelector('#lost').hidden"))
            port = int(node.url.rstrip("/").rsplit(":", 1)[1])
            node.stop()
            text = self.page.wait_until("!document.querySelector('#lost').hidden &&"
                                        " document.querySelector('#lost').textContent")
            self.assertIn("Connection lost", text)
            self.keep("lost")
            node = WebViewNode(folder, name="web_view_mortal", port=port)
            self.page.wait_until("document.querySelector('#lost').hidden")
            node.stop()
        self.page.problems.clear()  # the browser complains of the connections that failed

    def test_dark_colours(self):
        page = chromium.Page(dark=True)
        try:
            page.open(self.node.url + "?token=" + TOKEN)
            page.wait_until(SEEN)
            self.assertEqual("rgb(14, 19, 26)", page.evaluate("getComputedStyle(document.body).backgroundColor"))
            if PICTURES:
                page.picture(os.path.join(PICTURES, "dark.png"))
        finally:
            page.close()

    def test_the_page_is_there_at_once(self):
        self.show()
        first, loaded = self.page.evaluate("[performance.getEntriesByType('paint').map(p => p.startTime)[0],"
                                           " performance.getEntriesByType('navigation')[0].loadEventEnd]")
        print("first paint after %.0f ms, loaded after %.0f ms" % (first, loaded))
        self.assertLess(loaded, 20000)  # the bench judges the figure; this computer may be busy


if __name__ == "__main__":
    rospy.init_node("page_test", disable_signals=True)
    rostest.rosrun("pi_web", "page", Page)
