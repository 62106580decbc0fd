"""pi_edge fleet: what it writes, and what it refuses."""

import contextlib
import io
import os
import stat
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from pi_bringup import pi_edge
from pi_bringup.fleet import authority, commands


def call(*words):
    """@return (status, output, errors) of pi_edge fleet"""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = commands.main(pi_edge.parse(["fleet", *(str(word) for word in words)]))
    return status, out.getvalue(), err.getvalue()


class FleetCommands(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name) / "fleet"
        self.fleet("init", "--name", "yards")

    def fleet(self, verb, *words):
        status, output, errors = call(verb, *words, "--folder", self.folder)
        self.assertEqual((0, ""), (status, errors))
        return output

    def refused(self, *words):
        before = self.files()
        status, output, errors = call(*words, "--folder", self.folder)
        self.assertEqual((1, ""), (status, output))
        self.assertEqual(1, errors.count("\n"), errors)
        self.assertEqual(before, self.files())
        return errors

    def files(self):
        return sorted((path, path.stat().st_mtime_ns) for path in self.folder.rglob("*") if path.is_file())

    def certificate(self, path, *what):
        return subprocess.run(["openssl", "x509", "-in", self.folder / path, "-noout", *what], capture_output=True,
                              text=True, check=True).stdout

    def test_each_member_gets_files_for_its_machine(self):
        self.fleet("add-site", "gate", "--host", "gate.example", "--host", "10.0.0.2", "--at", "1", "2", "80")
        output = self.fleet("add-vehicle", "truck_1", "truck_2")
        self.assertIn("New for gate: server/nats-server.conf", output)
        self.assertIn("systemctl reload nats-server", output)
        self.fleet("add-operator", "control")
        keys = [path for path in self.folder.rglob("*") if path.name in ("key.pem", "ca.key")]
        self.assertEqual(6, len(keys))
        for path in [*keys, self.folder / "fleet.yaml"]:
            self.assertEqual(0o600, stat.S_IMODE(path.stat().st_mode), path)
        self.assertEqual({
            "vehicle": "truck_1", "transport": "nats", "nats": {
                "servers": ["gate.example:4222"], "ca_file": "/etc/pi_edge/fleet/ca.pem",
                "certificate_file": "/etc/pi_edge/fleet/certificate.pem", "key_file": "/etc/pi_edge/fleet/key.pem"}},
            yaml.safe_load((self.folder / "vehicles/truck_1/coordinator.yaml").read_text()))
        self.assertEqual({
            "id": "gate", "transport": "nats", "has_position": True, "x": 1.0, "y": 2.0, "range": 80.0, "nats": {
                "servers": ["gate.example:4222"], "ca_file": "/etc/pi_edge/fleet/worker/ca.pem",
                "certificate_file": "/etc/pi_edge/fleet/worker/certificate.pem",
                "key_file": "/etc/pi_edge/fleet/worker/key.pem"}},
            yaml.safe_load((self.folder / "sites/gate/worker/edge_server.yaml").read_text()))

    def test_a_later_site_is_known_to_all(self):
        self.fleet("add-site", "gate", "--host", "gate.example")
        self.fleet("add-vehicle", "truck")
        output = self.fleet("add-site", "lamp", "--host", "fd00::7", "--port", "5222")
        self.assertIn("New for gate, lamp", output)
        config = yaml.safe_load((self.folder / "vehicles/truck/coordinator.yaml").read_text())
        self.assertEqual(["gate.example:4222", "[fd00::7]:5222"], config["nats"]["servers"])
        self.assertIn('"tls://[fd00::7]:6222"', (self.folder / "sites/gate/server/nats-server.conf").read_text())

    def test_certificates_say_role_and_end(self):
        self.fleet("add-site", "gate", "--host", "gate.example", "--host", "*.nats", "--days", "30")
        self.fleet("add-vehicle", "truck")
        subject = self.certificate("vehicles/truck/certificate.pem", "-subject")
        self.assertIn("O=yards,OU=vehicle,CN=truck", subject.replace(" ", ""))
        purposes = self.certificate("vehicles/truck/certificate.pem", "-ext", "extendedKeyUsage,basicConstraints")
        self.assertIn("TLS Web Client Authentication", purposes)
        self.assertNotIn("TLS Web Server Authentication", purposes)
        self.assertIn("CA:FALSE", purposes)
        names = self.certificate("sites/gate/server/certificate.pem", "-ext", "subjectAltName")
        self.assertIn("DNS:gate.example, DNS:*.nats", names)
        left = {line.split()[0]: " ".join(line.split()[3:]) for line in self.fleet("list").splitlines()[1:]}
        self.assertEqual(
            {"yards": "3649 days", "gate": "29 days: renew it gate.example:4222", "truck": "364 days"}, left)

    def test_revoked_and_renewed_keys_are_no_longer_permitted(self):
        self.fleet("add-site", "gate", "--host", "gate")
        self.fleet("add-vehicle", "truck", "van")
        configuration = self.folder / "sites/gate/server/nats-server.conf"
        keys = {name: one["keys"]["vehicle"] for name, one in self.state()["members"].items() if name != "gate"}
        for key in keys.values():
            self.assertIn(key, configuration.read_text())
        output = self.fleet("revoke", "truck")
        self.assertIn("New for gate", output)
        self.fleet("renew", "van")
        text = configuration.read_text()
        for gone in (*keys.values(), "CN=truck,"):
            self.assertNotIn(gone, text)
        self.assertIn(self.state()["members"]["van"]["keys"]["vehicle"], text)
        self.assertFalse((self.folder / "vehicles/truck").exists())
        self.assertRegex(self.fleet("list"), "truck +vehicle +revoked")
        self.fleet("add-vehicle", "truck")  # the name is free again, its old key is not
        self.assertNotIn(keys["truck"], configuration.read_text())

    def state(self):
        return yaml.safe_load((self.folder / "fleet.yaml").read_text())

    def test_wrong_calls_are_named_and_change_nothing(self):
        self.fleet("add-site", "gate", "--host", "gate")
        self.fleet("add-vehicle", "truck")
        long = "x" * 33
        for words, part in (
                (("add-vehicle", "a.b"), "NAME = \"a.b\", must be 1 to 32 letters"),
                (("add-vehicle", "new", "../x"), "NAME = \"../x\", must be"),
                (("add-vehicle", long), f"NAME = \"{long}\", must be"),
                (("add-vehicle", "truck"), "is taken by a vehicle: choose another, or call pi_edge fleet renew truck"),
                (("add-vehicle", "gate"), "is taken by a site"),
                (("add-vehicle", "new", "--days", "0"), "--days = 0, must be in [1, "),
                (("add-vehicle", "new", "--days", "99999"), "--days = 99999, must be in [1, "),
                (("add-vehicle", "new", "--device-folder", "here"), "--device-folder = \"here\", must be an absolute"),
                (("add-vehicle", "new", "--device-folder", "/a\"b"), "--device-folder = \"/a\"b\", must be an"),
                (("add-site", "lamp", "--host", "lamp:4222:x"), "--host = \"lamp:4222:x\", must be the name"),
                (("add-site", "lamp", "--host", "tls://lamp"), "--host = \"tls://lamp\", must be"),
                (("add-site", "lamp", "--host", "*.lamp"), "--host = \"*.lamp\", the first must"),
                (("add-site", "lamp", "--host", "lamp", "--port", "0"), "--port = 0, must be in [1, 65535]"),
                (("add-site", "lamp", "--host", "lamp", "--port", "6222"), "must differ"),
                (("add-site", "lamp", "--host", "lamp", "--at", "0", "nan", "1"), "--at = 0 nan 1, must be finite"),
                (("add-site", "lamp", "--host", "gate"), "--host = gate: gate has that address"),
                (("revoke", "truck", "nobody"), "NAME = \"nobody\" is no member: there is gate, truck"),
                (("renew", "nobody"), "NAME = \"nobody\" is no member"),
                (("init",), "holds a fleet already: give another --folder; its keys are not overwritten")):
            with self.subTest(words=words):
                self.assertIn(part, self.refused(*words))

    def test_folders_that_are_not_the_fleets_are_kept(self):
        (self.folder / "vehicles/old").mkdir(parents=True)
        self.assertIn("vehicles/old is there already: move it away", self.refused("add-vehicle", "old"))

    def test_no_fleet(self):
        elsewhere = self.folder / "empty"
        for verb in (("list",), ("add-vehicle", "truck")):
            status, _, errors = call(*verb, "--folder", elsewhere)
            self.assertEqual(1, status)
            self.assertIn(f"{elsewhere} holds no fleet: call pi_edge fleet init", errors)

    def test_a_damaged_state_is_named(self):
        for text in ("[1, 2", "name: yards\n", "- x\n"):
            (self.folder / "fleet.yaml").write_text(text)
            self.assertIn("fleet.yaml is damaged", self.refused("list"))

    def test_without_openssl(self):
        with mock.patch.dict(os.environ, {"PATH": "/nowhere"}):
            self.assertIn("openssl is missing: apt-get install openssl", self.refused("add-vehicle", "truck"))
            status, _, errors = call("init", "--folder", self.folder / "other")
            self.assertEqual(1, status)
            self.assertIn("apt-get install openssl", errors)
        self.assertEqual([], list((self.folder / "other").iterdir()))
        self.fleet("add-vehicle", "truck")  # nothing half made is in the way

    def test_a_failure_in_the_middle_leaves_no_keys(self):
        self.fleet("add-site", "gate", "--host", "gate")
        (self.folder / "authority/ca.key").write_text("no key")
        self.assertRegex(self.refused("add-vehicle", "truck"), "openssl x509: .*CA private key")
        self.assertEqual([], list((self.folder / "vehicles").iterdir()))

    def test_a_folder_that_cannot_be_written(self):
        status, _, errors = call("init", "--folder", "/proc/self/fleet")
        self.assertEqual(1, status)
        self.assertIn("/proc/self/fleet: No such file or directory; give another --folder", errors)
        file = self.folder / "file"
        file.write_text("")
        status, _, errors = call("init", "--folder", file / "below")
        self.assertEqual(1, status)
        self.assertIn("Not a directory; give another --folder", errors)

    def test_authorities_are_not_members(self):
        text = self.certificate("authority/ca.pem", "-ext", "basicConstraints,keyUsage")
        self.assertIn("CA:TRUE, pathlen:0", text)
        self.assertIn("Certificate Sign", text)
        self.assertGreater(authority.expiry(self.folder / "authority/ca.pem").year, 2035)


if __name__ == "__main__":
    unittest.main()
