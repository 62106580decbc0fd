"""What pi_edge open prints."""

import contextlib
import io
import re
import socket
import subprocess
import tempfile
import threading
import unittest
import urllib.error
import urllib.request
from pathlib import Path

from pi_bringup import web_page


class WebPage(unittest.TestCase):
    def test_addresses_for_this_computer_and_for_others(self):
        self.assertEqual(["http://127.0.0.1:8890/"], web_page.addresses("http://127.0.0.1:8890/", "", ["10.0.0.7"]))
        self.assertEqual(["http://127.0.0.1:80/?token=x", "http://10.0.0.7:80/?token=x"],
                         web_page.addresses("http://0.0.0.0:80/", "x", ["127.0.0.1", "10.0.0.7"]))
        self.assertEqual(["http://[::1]:80/"], web_page.addresses("http://[::1]:80/", "", []))

    def test_only_a_server_that_answers_counts(self):
        with socket.create_server(("127.0.0.1", 0)) as server:
            url = "http://127.0.0.1:%d/" % server.getsockname()[1]
            for answer, right in ((b"HTTP/1.0 200 OK\r\n\r\n", True), (b"HTTP/1.0 404 Not\r\n\r\n", False)):
                def serve(answer=answer):
                    connection, _ = server.accept()
                    with connection:
                        connection.recv(1000)
                        connection.sendall(answer)
                thread = threading.Thread(target=serve)
                thread.start()
                self.assertEqual(right, web_page.answers(url))
                thread.join()
        self.assertFalse(web_page.answers(url))

    def test_a_recording_is_served_with_the_page(self):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder, "incident.bag")
            bag.write_bytes(b"#ROSBAG V2.0\n" + bytes(1000))
            with subprocess.Popen(["rosrun", "pi_bringup", "pi_edge", "open", str(bag)], stdout=subprocess.PIPE,
                                  text=True) as server:
                url = re.match(r"(http://127.0.0.1:\d+/)\?play=recording.bag ", server.stdout.readline()).group(1)
                for path, content in (("recording.bag", bag.read_bytes()), ("?play=recording.bag", b"<!DOCTYPE html>"),
                                      ("playback.js", b"// A recording")):
                    with urllib.request.urlopen(url + path) as answer:
                        self.assertEqual(content, answer.read()[:len(content)])
                with self.assertRaises(urllib.error.HTTPError):
                    urllib.request.urlopen(url + "incidents.json")
                bag.unlink()
                with self.assertRaises(urllib.error.HTTPError):
                    urllib.request.urlopen(url + "recording.bag")
                server.terminate()

    def test_a_recording_that_is_not_there_and_a_port_in_use_are_told(self):
        told = io.StringIO()
        with contextlib.redirect_stderr(told), tempfile.NamedTemporaryFile() as file:
            self.assertEqual(1, web_page.show(Path("/nowhere/x.bag"), 0))
            with socket.create_server(("127.0.0.1", 0)) as taken:
                self.assertEqual(1, web_page.show(Path(file.name), taken.getsockname()[1]))
        self.assertIn("/nowhere/x.bag is no file; pi_edge incidents", told.getvalue())
        self.assertIn("take another one with --port", told.getvalue())


if __name__ == "__main__":
    unittest.main()
