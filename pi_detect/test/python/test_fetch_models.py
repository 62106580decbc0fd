#!/usr/bin/python3
import contextlib
import hashlib
import io
import os
import random
import signal
import subprocess
import sys
import tarfile
import tempfile
import threading
import unittest
import unittest.mock
from pathlib import Path

import yaml

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "src"))

from loopback_server import LoopbackServer
from pi_detect import fetch_models

GRAPH = random.Random(2).randbytes(400_000)
CONFIG = b"node { name: 'image' }\n"
TIMEOUT_S = 60  # of a program that hangs


def sha256(content):
    return hashlib.sha256(content).hexdigest()


def pack(member, content):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as tar:
        info = tarfile.TarInfo(member)
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))
    return stream.getvalue()


class FetchModels(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.output = self.folder / "models"
        self.server = LoopbackServer()
        self.addCleanup(self.server.close)
        self.archive = pack("net/graph.pb", GRAPH)
        self.server.files = {"/net.tar.gz": self.archive, "/net.pbtxt": CONFIG, "/face.pb": GRAPH[:1000]}
        self.catalogue = self.folder / "catalogue.yaml"
        description = {"input": {"width": 300, "height": 300}, "output": {"kind": "detections"}, "labels": "pets",
                       "score_threshold": 0.5, "class_agnostic_overlap": 0.0, "origin": "o", "licence": "l"}
        self.catalogue.write_text(yaml.safe_dump({"label_sets": {"pets": {1: "cat"}}, "models": {
            "net": {"title": "Pets", "description": description, "files": [
                {"name": "net.pb", "role": "weights", "urls": [self.server.url("/net.tar.gz")],
                 "bytes": len(self.archive), "sums": {"sha256": sha256(self.archive)}, "member": "net/graph.pb",
                 "member_sums": {"sha1": hashlib.sha1(GRAPH).hexdigest()}},
                {"name": "net.pbtxt", "role": "config", "urls": [self.server.url("/net.pbtxt")],
                 "sums": {"sha256": sha256(CONFIG)}}]},
            "face": {"title": "Faces", "description": description, "files": [
                {"name": "face.pb", "role": "weights", "urls": [self.server.url("/face.pb")],
                 "sums": {"sha256": sha256(GRAPH[:1000])}}]}}}))

    def run_tool(self, *arguments):
        """@return (exit status, output, errors)"""
        output, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            try:
                status = fetch_models.main(["--catalogue", str(self.catalogue), "--output", str(self.output),
                                            *map(str, arguments)])
            except SystemExit as left:
                status = left.code
        return status, output.getvalue(), errors.getvalue()

    def names(self):
        return sorted(path.name for path in self.output.iterdir() if path.name != ".fetch_models.lock")

    def test_a_model_arrives_with_its_description(self):
        status, output, errors = self.run_tool("net")
        self.assertEqual((status, errors), (0, ""))
        self.assertIn(f"net: fetched: {self.output / 'net.yaml'}", output)
        self.assertEqual(self.names(), ["net.pb", "net.pbtxt", "net.yaml"])
        self.assertEqual((self.output / "net.pb").read_bytes(), GRAPH)
        description = yaml.safe_load((self.output / "net.yaml").read_text())
        self.assertEqual(description["weights"], {"file": "net.pb", "sha256": sha256(GRAPH)})
        self.assertEqual(description["config"], {"file": "net.pbtxt", "sha256": sha256(CONFIG)})

    def test_a_network_that_the_package_describes_is_looked_for_where_the_nodes_look(self):
        own = self.folder / "own.yaml"
        own.write_text(yaml.safe_dump({"weights": [{"file": "own.onnx", "sha256": sha256(GRAPH)},
                                                   {"file": "other.onnx", "sha256": sha256(CONFIG)}]}))
        content = yaml.safe_load(self.catalogue.read_text())
        content["models"]["own"] = {"title": "Own", "description": "own.yaml", "files": [
            {"name": "own.onnx", "role": "weights", "urls": [self.server.url("/own.onnx")],
             "sums": {"sha256": sha256(GRAPH)}}]}
        self.catalogue.write_text(yaml.safe_dump(content))
        self.server.files["/own.onnx"] = GRAPH
        data = self.folder / "data"
        (data / "detect" / "models").mkdir(parents=True)
        with unittest.mock.patch.dict(os.environ, {"PI_EDGE_DATA": str(data)}):
            self.assertEqual(self.run_tool("--missing", "own", "net"), (0, "own\nnet\n", ""))
            (data / "detect" / "models" / "other.onnx").write_bytes(CONFIG)
            self.assertEqual(self.run_tool("--missing", "own", "net"), (0, "net\n", ""))
            (data / "detect" / "models" / "other.onnx").write_bytes(b"damaged")
            status, output, _ = self.run_tool("own")
            self.assertEqual((status, output), (0, f"own: fetched: {own}\n"))
            self.assertEqual(self.names(), ["own.onnx"])
            self.assertEqual(self.run_tool("--missing", "own"), (0, "", ""))

    def test_what_is_there_is_not_fetched_again(self):
        self.run_tool("net")
        requests = len(self.server.requests)
        status, output, _ = self.run_tool("net")
        self.assertEqual((status, len(self.server.requests)), (0, requests))
        self.assertIn("is there already", output)

    def test_a_file_that_was_changed_is_fetched_again_and_the_others_are_not(self):
        self.run_tool("net")
        (self.output / "net.pbtxt").write_bytes(b"changed")
        del self.server.requests[:]
        self.assertEqual(self.run_tool("net")[0], 0)
        self.assertEqual((self.output / "net.pbtxt").read_bytes(), CONFIG)
        self.assertEqual([path for path, _ in self.server.requests], ["/net.pbtxt"])

    def test_all_models_are_fetched_although_one_cannot_be(self):
        self.server.files["/net.tar.gz"] = b"other"
        status, output, errors = self.run_tool("--all")
        self.assertEqual(status, 1)
        self.assertRegex(errors, r"^fetch_models: net: net.tar.gz was not fetched\. .*has 5 bytes.*\n$")
        self.assertIn("face: fetched", output)
        self.assertEqual(self.names(), ["face.pb", "face.yaml"])

    def test_a_folder_stands_for_the_servers(self):
        offline = self.folder / "offline"
        offline.mkdir()
        status, _, errors = self.run_tool("--from", offline, "net")
        self.assertEqual(status, 1)
        self.assertIn(f"{offline / 'net.tar.gz'} is not there: get it from {self.server.url('/net.tar.gz')}", errors)
        (offline / "net.tar.gz").write_bytes(self.archive)
        (offline / "net.pbtxt").write_bytes(CONFIG)
        self.assertEqual(self.run_tool("--from", offline, "net")[0], 0)
        self.assertEqual(self.names(), ["net.pb", "net.pbtxt", "net.yaml"])
        self.assertEqual(self.server.requests, [])
        self.assertTrue((offline / "net.tar.gz").exists())

    def test_a_folder_may_hold_the_unpacked_file(self):
        offline = self.folder / "offline"
        offline.mkdir()
        (offline / "net.pb").write_bytes(GRAPH)
        (offline / "net.pbtxt").write_bytes(CONFIG)
        self.assertEqual(self.run_tool("--from", offline, "net")[0], 0)
        self.assertEqual((self.output / "net.pb").read_bytes(), GRAPH)

    def test_a_wrong_file_in_the_folder_is_refused_and_left_alone(self):
        offline = self.folder / "offline"
        offline.mkdir()
        for name, content in (("net.tar.gz", b"other"), ("face.pb", b"other")):
            (offline / name).write_bytes(content)
        for model, name in (("net", "net.tar.gz"), ("face", "face.pb")):
            status, _, errors = self.run_tool("--from", offline, model)
            self.assertEqual(status, 1)
            self.assertIn(f"{offline / name}: sha256 is", errors)
            self.assertEqual((offline / name).read_bytes(), b"other")
        self.assertEqual(self.names(), [])

    def test_a_mirror_stands_for_all_addresses(self):
        self.server.files = {"/mirror/net.tar.gz": self.archive, "/mirror/net.pbtxt": CONFIG}
        self.assertEqual(self.run_tool("--mirror", self.server.url("/mirror/"), "net")[0], 0)
        self.assertEqual([path for path, _ in self.server.requests], ["/mirror/net.tar.gz", "/mirror/net.pbtxt"])

    def test_the_list_says_what_is_there(self):
        self.run_tool("face")
        status, output, _ = self.run_tool("--list")
        self.assertEqual(status, 0)
        self.assertRegex(output, r"(?m)^net +size \? +Pets$")
        self.assertRegex(output, r"(?m)^face +size \? +there +Faces$")

    def test_wrong_command_lines_are_told_apart_from_failures(self):
        for arguments in ((), ("--all", "--from", "x", "--mirror", "http://server.test"),
                          ("--mirror", "server", "net")):
            self.assertEqual(self.run_tool(*arguments)[0], 2)
        status, _, errors = self.run_tool("nett")
        self.assertEqual(status, 1)
        self.assertIn("has no model nett; it has face, net", errors)

    def test_a_folder_that_cannot_be_made_is_an_error(self):
        self.output.write_text("a file")
        status, _, errors = self.run_tool("net")
        self.assertEqual(status, 1)
        self.assertIn(f"--output {self.output}: ", errors)

    def test_two_runs_do_not_share_a_folder(self):
        with fetch_models.claim(self.output):
            status, _, errors = self.run_tool("net")
        self.assertEqual(status, 1)
        self.assertIn("in use by another fetch_models", errors)

    def test_a_signal_ends_the_program_and_leaves_no_final_name(self):
        asked, release = threading.Event(), threading.Event()
        self.addCleanup(release.set)

        def hold(request, content):
            request.send_response(200)
            request.send_header("Content-Length", str(len(content)))
            request.end_headers()
            request.wfile.write(content[:100_000])
            asked.set()
            release.wait(TIMEOUT_S)
            request.close_connection = True

        self.server.faults = [hold]
        program = subprocess.Popen(
            [sys.executable, "-B", str(PACKAGE / "scripts" / "fetch_models"), "--catalogue", str(self.catalogue),
             "--output", str(self.output), "net"], stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(PACKAGE / "src")})
        with program:
            self.assertTrue(asked.wait(TIMEOUT_S))
            program.send_signal(signal.SIGTERM)
            _, errors = program.communicate(timeout=TIMEOUT_S)
        self.assertEqual(program.returncode, 128 + signal.SIGTERM)
        self.assertRegex(errors, r"^fetch_models: ended by SIGTERM: .*\n$")
        self.assertLessEqual(set(self.names()), {"net.tar.gz.part"})
        self.assertEqual(self.run_tool("net")[0], 0)
        self.assertEqual((self.output / "net.pb").read_bytes(), GRAPH)


if __name__ == "__main__":
    unittest.main()
