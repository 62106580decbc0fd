"""Checks of software: with programs made for the test, and with the real π-OS and OpenCL where they are there."""

import json
import os
import socket
import threading
import unittest
from unittest import mock
from xmlrpc.server import SimpleXMLRPCServer

from fake_root import FakeRoot
from pi_bringup.doctor import children, software


class Software(FakeRoot):
    def program(self, text):
        path = self.put("program", "#!/bin/sh\n" + text)
        path.chmod(0o755)
        return path

    # -------------------------------------------------------------------------------------------------------- children

    def test_a_child_that_hangs_is_killed(self):
        began = os.times().elapsed
        ended = children.run(["sleep", "600"], 0.2)
        self.assertFalse(ended.in_time)
        self.assertFalse(ended.good)
        self.assertLess(os.times().elapsed - began, 300.0)

    def test_how_children_end(self):
        self.assertTrue(children.run(["true"], 30.0).good)
        self.assertEqual("is not installed", children.run(["/no/such/program"], 30.0).why())
        self.assertIn("status 3", children.run(["sh", "-c", "echo why; exit 3"], 30.0).why())
        self.assertIn("signal 9", children.run(["sh", "-c", "kill -9 $$"], 30.0).why())
        self.assertEqual("seen", children.run(["cat"], 30.0, text="seen").last_line())

    # ------------------------------------------------------------------------------------------------------------- ROS

    def test_master(self):
        self.expect("FAIL", software.check_master({}), "ROS_MASTER_URI is not set")
        self.expect("FAIL", software.check_master({"ROS_MASTER_URI": "localhost:11311"}), "no address")
        with socket.socket() as closed:  # bound, so that nobody else takes the port, and not listening
            closed.bind(("127.0.0.1", 0))
            uri = "http://127.0.0.1:%d" % closed.getsockname()[1]
            self.expect("WARN", software.check_master({"ROS_MASTER_URI": uri}), "does not answer", "roscore")

    def test_a_master_that_answers(self):
        server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        server.register_function(lambda _: [1, "", 42], "getPid")
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        uri = "http://127.0.0.1:%d" % server.server_address[1]
        self.expect("OK", software.check_master({"ROS_MASTER_URI": uri}), "answers at")

    def test_a_master_that_is_silent(self):
        with socket.socket() as silent, mock.patch.object(software, "MASTER_S", 0.2):
            silent.bind(("127.0.0.1", 0))
            silent.listen(1)  # connects, and never answers
            uri = "http://127.0.0.1:%d" % silent.getsockname()[1]
            self.expect("WARN", software.check_master({"ROS_MASTER_URI": uri}), "timed out")

    def test_host_name(self):
        self.expect("OK", software.check_host_name({"ROS_HOSTNAME": "localhost"}), "127.0.0.1")
        self.expect("FAIL", software.check_host_name({"ROS_IP": "198.51.100.7"}), "not this computer")
        self.expect("FAIL", software.check_host_name({"ROS_HOSTNAME": "no-such-host.invalid"}), "cannot be resolved")
        self.expect("WARN", software.check_host_name({"ROS_HOSTNAME": "localhost",
                                                      "ROS_MASTER_URI": "http://10.0.0.5:11311"}), "10.0.0.5")

    def test_python(self):
        self.expect("WARN", software.check_python("/opt/other/python3"), "Debian's /usr/bin/python3")
        with mock.patch.object(software.importlib.util, "find_spec", return_value=None):
            self.expect("FAIL", software.check_python(), "without rospy")

    # ---------------------------------------------------------------------------------------------------------- OpenCL

    def probe(self, devices):
        return software.check_opencl(children.Ended(True, True, 0, "a line of a driver\n" + json.dumps(devices)))

    def test_opencl(self):
        good = {"device": "pthread", "platform": "PoCL", "works": True, "problem": ""}
        bad = {"device": "GPU", "platform": "X", "works": False, "problem": "clBuildProgram: -11"}
        self.expect("OK", self.probe([good]), "pthread (PoCL)")
        self.expect("WARN", self.probe([good, bad]), "not GPU: clBuildProgram: -11")
        self.expect("FAIL", self.probe([bad]), "no device runs a kernel")
        self.expect("FAIL", self.probe([]), "no device")
        self.expect("FAIL", software.check_opencl(children.Ended(True, True, -11, "")), "signal 11")
        self.expect("FAIL", software.check_opencl(children.Ended(True, True, 0, "garbage")), "garbage")
        self.expect("FAIL", software.check_opencl(children.Ended(True, False)), "did not end in time")

    # ---------------------------------------------------------------------------------------------------------- models

    def test_detector(self):
        good = self.program("echo $1: net is usable, output/kind grid\n")
        self.expect("OK", software.check_detector("net.yaml", good), "net.yaml: net is usable", "loaded")
        self.expect("OK", software.check_detector("", good), ": net is usable")
        self.expect("WARN", software.check_detector("fast", self.program(
            "echo street.yaml: small is usable; echo small stands in for net, which is not here: fetch it\n")),
            "small stands in for net, which is not here", "fetch it")

    def test_detector_that_cannot_be_loaded(self):
        self.expect("FAIL", software.check_detector("net.yaml", self.program("echo layer 3 is odd; exit 2\n")),
                    "net.yaml cannot be loaded: layer 3 is odd (status 2)")

    def test_speech(self):
        self.expect("FAIL", software.check_speech(self.root / "absent"), "pocketsphinx-en-us")
        self.expect("OK", software.check_speech(self.root, self.program("exit 0\n")), "loaded")
        self.expect("FAIL", software.check_speech(self.root, self.program("kill -6 $$\n")), "signal 6")

    # ------------------------------------------------------------------------------------------------------------ π-OS

    def test_a_library_that_is_none(self):
        self.assertIsNone(software.find_transport({"CMAKE_PREFIX_PATH": str(self.root)}))
        library = self.put("lib/" + software.TRANSPORT, "no library")
        self.assertEqual(library, software.find_transport({"CMAKE_PREFIX_PATH": "/nowhere:" + str(self.root)}))
        self.expect("FAIL", software.check_transport(library), "cannot be preloaded")

    def test_the_library_of_this_space(self):
        if software.find_transport() is None:
            self.skipTest("pi_os_transport is not in this space")
        self.expect("OK", software.check_transport(), "is preloaded")


if __name__ == "__main__":
    unittest.main()
