#!/usr/bin/python3
import hashlib
import io
import random
import sys
import tarfile
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from loopback_server import LoopbackServer, cut_after, fail
from pi_detect import downloads
from pi_detect.errors import ToolError

CONTENT = random.Random(1).randbytes(700_000)  # several chunks
SUMS = {"sha256": hashlib.sha256(CONTENT).hexdigest(), "sha1": hashlib.sha1(CONTENT).hexdigest()}


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.path = self.folder / "net.pb"
        self.part = self.folder / "net.pb.part"

    def names(self):
        return sorted(path.name for path in self.folder.iterdir())


class Downloads(Case):
    def setUp(self):
        super().setUp()
        self.server = LoopbackServer()
        self.addCleanup(self.server.close)
        self.server.files["/net.pb"] = CONTENT
        self.delays, self.progress = [], []
        self.patience = None

    def download(self, urls=None, sums=None, size=len(CONTENT)):
        downloads.download(urls or [self.server.url("/net.pb")], self.path, sums or SUMS, size,
                           lambda *state: self.progress.append(state),
                           self.patience or downloads.Patience(sleep=self.delays.append))

    def test_a_file_arrives_whole_under_its_name(self):
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.names(), ["net.pb"])
        self.assertEqual(self.progress[-1], (len(CONTENT), len(CONTENT)))
        self.assertEqual(self.delays, [])

    def test_a_cut_connection_is_resumed_where_it_was_cut(self):
        self.server.faults = [cut_after(300_000), cut_after(100_000)]
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual([asked for _, asked in self.server.requests], [None, "bytes=300000-", "bytes=400000-"])
        self.assertEqual(self.delays, [1.0, 1.0])  # both tries brought something

    def test_a_part_of_an_earlier_run_is_continued(self):
        self.part.write_bytes(CONTENT[:123_456])
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.server.requests, [("/net.pb", "bytes=123456-")])

    def test_a_whole_part_needs_no_server(self):
        self.part.write_bytes(CONTENT)
        self.download()
        self.assertEqual(self.server.requests, [])
        self.assertEqual(self.names(), ["net.pb"])

    def test_a_whole_part_of_unknown_size_is_recognised_by_the_server(self):
        self.part.write_bytes(CONTENT)
        self.download(size=0)
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.server.requests, [("/net.pb", f"bytes={len(CONTENT)}-")])

    def test_a_part_that_is_longer_than_the_file_is_started_again(self):
        self.part.write_bytes(CONTENT + b"more")
        self.download(size=0)
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.part.write_bytes(CONTENT + b"more")
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)

    def test_a_server_without_ranges_starts_again(self):
        self.server.ranges = False
        self.part.write_bytes(b"x" * 1000)
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)

    def test_another_part_than_was_asked_for_is_not_used(self):
        def shifted(request, content):
            request.send_response(206)
            request.send_header("Content-Range", f"bytes 0-{len(content) - 1}/{len(content)}")
            request.send_header("Content-Length", str(len(content)))
            request.end_headers()
            request.wfile.write(content)

        self.part.write_bytes(CONTENT[:1000])
        self.server.faults = [shifted]
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual([asked for _, asked in self.server.requests], ["bytes=1000-", None])
        self.assertEqual(self.delays, [1.0])

    def test_a_part_of_another_file_costs_one_more_download(self):
        self.part.write_bytes(b"x" * 1000)
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual([asked for _, asked in self.server.requests], ["bytes=1000-", None])

    def test_a_wrong_sum_is_an_error_and_the_file_is_removed(self):
        self.server.files["/net.pb"] = b"y" + CONTENT[1:]
        expected = f"net.pb was not fetched.*sha256 is [0-9a-f]+, must be {SUMS['sha256']}"
        with self.assertRaisesRegex(ToolError, expected):
            self.download()
        self.assertEqual(self.names(), [])

    def test_every_sum_counts(self):
        with self.assertRaisesRegex(ToolError, "sha1 is .* must be 0000"):
            self.download(sums={**SUMS, "sha1": "0" * 40})
        self.assertEqual(self.names(), [])

    def test_a_fault_of_the_server_is_waited_out(self):
        self.server.faults = [fail(503), fail(500)]
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.delays, [1.0, 2.0])

    def test_a_server_that_only_fails_is_given_up(self):
        self.server.faults = [fail(503)] * 5
        with self.assertRaisesRegex(ToolError, "HTTP 503 .*tried 5 times"):
            self.download()
        self.assertEqual(self.delays, list(downloads.RETRY_DELAYS_S))
        self.assertEqual(self.names(), [])

    def test_patience_limits_all_tries_and_addresses_together(self):
        gone = LoopbackServer()
        gone.close()
        self.patience = downloads.Patience(0.5)
        began = time.monotonic()
        with self.assertRaisesRegex(ToolError, "refused.*b.pb: .*refused"):
            self.download([gone.url("/a.pb"), gone.url("/b.pb")])  # the first pause of 1 s would be too long
        self.assertLess(time.monotonic() - began, 0.5)
        time.sleep(0.5)
        with self.assertRaisesRegex(ToolError, "a.pb: not tried"):
            self.download([gone.url("/a.pb")])

    def test_patience_begins_anew_with_each_byte(self):
        self.patience = downloads.Patience(60.0, self.delays.append)
        self.server.faults = [cut_after(300_000), fail(503)]
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertFalse(self.patience.ended())

    def test_a_missing_file_is_not_asked_for_again_but_elsewhere(self):
        self.download([self.server.url("/gone.pb"), self.server.url("/net.pb")])
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual([path for path, _ in self.server.requests], ["/gone.pb", "/net.pb"])
        with self.assertRaisesRegex(ToolError, "gone.pb: HTTP 404"):
            self.download([self.server.url("/gone.pb")])

    def test_another_address_helps_against_a_wrong_file(self):
        self.server.files["/wrong.pb"] = CONTENT[::-1]
        self.download([self.server.url("/wrong.pb"), self.server.url("/net.pb")])
        self.assertEqual(self.path.read_bytes(), CONTENT)

    def test_nobody_at_the_address_is_an_error_of_the_address(self):
        gone = LoopbackServer()
        gone.close()
        with self.assertRaisesRegex(ToolError, "Connection refused"):
            self.download([gone.url("/net.pb")])

    def test_a_file_of_another_size_is_not_loaded(self):
        with self.assertRaisesRegex(ToolError, f"has {len(CONTENT)} bytes, must have 5"):
            self.download(size=5)
        self.assertEqual(self.progress, [])

    def test_an_interruption_leaves_the_part_and_nothing_under_the_final_name(self):
        def interrupt(*_):
            raise KeyboardInterrupt
        with self.assertRaises(KeyboardInterrupt):
            downloads.download([self.server.url("/net.pb")], self.path, SUMS, 0, interrupt,
                               downloads.Patience(sleep=self.delays.append))
        self.assertEqual(self.names(), ["net.pb.part"])
        have = self.part.stat().st_size
        self.assertEqual(self.part.read_bytes(), CONTENT[:have])
        self.assertGreater(have, 0)
        self.download()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.server.requests[-1], ("/net.pb", f"bytes={have}-"))


class Archives(Case):
    def setUp(self):
        super().setUp()
        self.archive = self.folder / "net.tar.gz"

    def pack(self, members):
        """Member name -> content, or a link's target as text."""
        with tarfile.open(self.archive, "w:gz") as tar:
            for name, content in members.items():
                info = tarfile.TarInfo(name)
                if isinstance(content, str):
                    info.type, info.linkname = tarfile.SYMTYPE, content
                    tar.addfile(info)
                else:
                    info.size = len(content)
                    tar.addfile(info, io.BytesIO(content))

    def extract(self, member="net/graph.pb", sums=SUMS):
        downloads.extract(self.archive, member, self.path, sums)

    def test_only_the_wanted_member_is_written(self):
        self.pack({"net/readme": b"read me", "graph.pb": b"other", "net/graph.pb": CONTENT})
        self.extract()
        self.assertEqual(self.path.read_bytes(), CONTENT)
        self.assertEqual(self.names(), ["net.pb", "net.tar.gz"])

    def test_members_that_lead_out_of_the_folder_are_not_followed(self):
        outside = self.folder.parent / (self.folder.name + "_evil")
        self.pack({f"../{outside.name}": b"evil", str(outside): b"evil", "net/graph.pb": CONTENT})
        self.extract()
        self.assertFalse(outside.exists())
        self.assertEqual(self.names(), ["net.pb", "net.tar.gz"])
        self.pack({f"../{outside.name}": CONTENT})
        self.extract(f"../{outside.name}")  # written under the name that was asked for, whatever the member's
        self.assertFalse(outside.exists())
        self.assertEqual(self.path.read_bytes(), CONTENT)

    def test_a_link_is_refused(self):
        self.pack({"net/graph.pb": "/etc/passwd"})
        with self.assertRaisesRegex(ToolError, "net/graph.pb is no regular file"):
            self.extract()
        self.assertEqual(self.names(), ["net.tar.gz"])

    def test_a_missing_member_a_wrong_sum_and_a_broken_archive_are_errors(self):
        self.pack({"other": b"x"})
        with self.assertRaisesRegex(ToolError, "net.tar.gz does not contain net/graph.pb"):
            self.extract()
        self.pack({"net/graph.pb": b"other"})
        with self.assertRaisesRegex(ToolError, "sha256 is"):
            self.extract()
        self.pack({"net/graph.pb": CONTENT})
        self.archive.write_bytes(self.archive.read_bytes()[:400_000])
        with self.assertRaisesRegex(ToolError, "net.tar.gz cannot be unpacked"):
            self.extract()
        self.assertEqual(self.names(), ["net.tar.gz"])


if __name__ == "__main__":
    unittest.main()
