"""What deploys edge_server: systemd's units, Containerfile, manifests of Kubernetes, launch file for several machines.

None is run here: they are checked for what can be wrong in them without a cluster.
"""

import http.server
import json
import os
import re
import shutil
import subprocess
import tempfile
import threading
import unittest
from pathlib import Path
from xml.etree import ElementTree

import yaml

PACKAGE = Path(__file__).resolve().parents[2]
DEPLOY = PACKAGE / "deploy"
SUITE = PACKAGE.parent
FLUSH_S = 2  # of a drained server, for the last answers to leave


def defaults():
    """Of every parameter, as {"admission/workers": 2}."""
    return flat(yaml.safe_load((PACKAGE / "config/edge_server.yaml").read_text()))


def flat(tree, prefix=""):
    values = {}
    for name, value in tree.items():
        values.update(flat(value, prefix + name + "/") if isinstance(value, dict) else {prefix + name: value})
    return values


def check_parameters(test, given):
    """Each is a parameter of edge_server, of the right type."""
    known = defaults()
    for name, value in given.items():
        test.assertIn(name, known, "no parameter of edge_server")
        if isinstance(known[name], str) or name == "range":
            test.assertIsInstance(value, (str, float), name)
        elif isinstance(known[name], float):
            test.assertIsInstance(value, (int, float), name)
        else:
            test.assertIs(type(value), type(known[name]), name)


def health_port():
    return defaults()["health/port"]


def read_unit(path):
    """Sections as {"Service": {"ExecStart": ["..."]}}."""
    sections = {}
    section = None
    for line in path.read_text().splitlines():
        if line.startswith("["):
            section = sections.setdefault(line.strip("[]"), {})
        elif line and not line.startswith("#"):
            name, _, value = line.partition("=")
            section.setdefault(name, []).append(value)
    return sections


class Systemd(unittest.TestCase):
    UNITS = ("edge_server.service", "edge_server@.service")

    def test_systemd_takes_them(self):
        if shutil.which("systemd-analyze") is None:
            self.skipTest("systemd-analyze is not installed")
        for name in self.UNITS:
            text = (DEPLOY / "systemd" / name).read_text()
            program = read_unit(DEPLOY / "systemd" / name)["Service"]["ExecStart"][0].split()[0]
            with self.subTest(name), tempfile.TemporaryDirectory() as folder:
                # The program is not there yet: one that is takes its place.
                copy = Path(folder) / name.replace("@", "@gate")
                copy.write_text(text.replace(program, "/bin/true"))
                result = subprocess.run(["systemd-analyze", "verify", "--man=no", str(copy)], text=True,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
                said = [line for line in result.stdout.splitlines() if name.partition("@")[0] in line]
                self.assertEqual([], said, result.stdout)
                self.assertEqual(0, result.returncode, result.stdout)

    def test_a_wrong_unit_is_found(self):
        if shutil.which("systemd-analyze") is None:
            self.skipTest("systemd-analyze is not installed")
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "edge_server.service"
            copy.write_text("[Service]\nExecStart=/bin/true\nTimoutStopSec=20\n")
            result = subprocess.run(["systemd-analyze", "verify", "--man=no", str(copy)], text=True,
                                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
            self.assertIn("TimoutStopSec", result.stdout)

    def test_they_start_the_installed_program_with_its_file(self):
        for name, config in zip(self.UNITS, ("edge_server.yaml", "edge_server_%i.yaml")):
            command = read_unit(DEPLOY / "systemd" / name)["Service"]["ExecStart"]
            self.assertEqual([f"/opt/pi_edge/lib/pi_offload/edge_server --config /etc/pi_edge/{config}"], command)

    def test_there_is_time_to_drain(self):
        for name in self.UNITS:
            service = read_unit(DEPLOY / "systemd" / name)["Service"]
            self.assertGreater(int(service["TimeoutStopSec"][0]), defaults()["drain_s"] + FLUSH_S)
            self.assertNotIn("KillSignal", service)  # it is SIGTERM

    def test_the_template_is_the_unit(self):
        one, template = (read_unit(DEPLOY / "systemd" / name) for name in self.UNITS)
        of_an_instance = {"Description", "ExecStart", "CacheDirectory", "Environment"}
        for section in ("Unit", "Service", "Install"):
            self.assertEqual(list(one[section]), list(template[section]))
            for name, value in one[section].items():
                if name in of_an_instance:
                    self.assertIn("%i", template[section][name][0], name)
                else:
                    self.assertEqual(value, template[section][name], name)


class Containerfile(unittest.TestCase):
    INSTRUCTIONS = {"FROM", "RUN", "CMD", "LABEL", "EXPOSE", "ENV", "ADD", "COPY", "ENTRYPOINT", "VOLUME", "USER",
                    "WORKDIR", "ARG", "ONBUILD", "STOPSIGNAL", "HEALTHCHECK", "SHELL"}

    def setUp(self):
        self.stages = []  # (name, [(instruction, words)])
        for line in self.lines():
            instruction, _, words = line.partition(" ")
            if instruction == "FROM":
                self.stages.append((words.partition(" AS ")[2], []))
            self.assertTrue(self.stages, f"{line}: before FROM")
            self.stages[-1][1].append((instruction, words.strip()))
        self.last = self.stages[-1][1]

    @staticmethod
    def lines():
        """Of instructions, whole, without comments."""
        text = (DEPLOY / "Containerfile").read_text()
        text = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))
        return [line.strip() for line in re.sub(r"\\\n\s*", "", text).splitlines() if line.strip()]

    def one(self, instruction):
        found = [words for name, words in self.last if name == instruction]
        self.assertEqual(1, len(found), instruction)
        return found[0]

    def test_instructions_are_known(self):
        for _, instructions in self.stages:
            for instruction, words in instructions:
                self.assertIn(instruction, self.INSTRUCTIONS)
                self.assertTrue(words, instruction)
                if words.startswith("["):
                    self.assertTrue(all(isinstance(word, str) for word in json.loads(words)), words)

    def test_base_is_debian_without_a_host(self):
        for _, instructions in self.stages:
            self.assertEqual("debian:12", instructions[0][1].partition(" ")[0])

    def test_what_is_copied_is_there(self):
        if not (SUITE / "Makefile").is_file():
            self.skipTest(f"no suite around {PACKAGE}")
        names = [name for name, _ in self.stages]
        copied = set()
        for _, instructions in self.stages:
            for words in (words.split() for instruction, words in instructions if instruction == "COPY"):
                if words[0].startswith("--from="):
                    self.assertIn(words[0].partition("=")[2], names)
                    continue
                for source in words[:-1]:
                    self.assertTrue((SUITE / source).exists(), source)
                    copied.add(source)
        # All that the build goes through.
        needed = set(re.findall(r"^  (\w+)$", (SUITE / "CMakeLists.txt").read_text(), re.MULTILINE))
        self.assertTrue(needed)
        self.assertEqual(set(), (needed | {"Makefile", "package.xml", "dependencies.txt", "scripts"}) - copied)

    def test_it_is_built_where_it_runs(self):
        builds = [words for name, words in self.stages[0][1] if name == "RUN" and words.startswith("make ")]
        self.assertEqual(["make build INSTALL=/opt/pi_edge"], builds)
        entry = json.loads(self.one("ENTRYPOINT"))
        self.assertEqual(["/opt/pi_edge/lib/pi_offload/edge_server"], entry)
        for words in (words.split() for name, words in self.last if name == "COPY" and "--from" in words):
            self.assertEqual(words[1], words[2])  # programs know where their libraries are beside them
        option, config = json.loads(self.one("CMD"))
        self.assertEqual("--config", option)
        self.assertIn(f"pi_offload/config/edge_server.yaml {config}", [w for n, w in self.last if n == "COPY"])

    def test_user_is_not_root(self):
        user, group = self.one("USER").split(":")
        self.assertGreater(int(user), 0)
        self.assertGreater(int(group), 0)
        names = [name for name, _ in self.last]
        self.assertLess(names.index("USER"), names.index("ENTRYPOINT"))

    def test_ports_are_those_of_the_configuration(self):
        self.assertEqual({defaults()["port"], health_port()}, {int(port) for port in self.one("EXPOSE").split()})

    def health_command(self):
        words = self.one("HEALTHCHECK")
        begin, end = words.index("CMD ") + 4, words.rindex("]") + 1
        return json.loads(words[begin:end])

    def test_health_check_asks_the_server(self):
        command = self.health_command()
        self.assertIn(f"/dev/tcp/127.0.0.1/{health_port()}", command[-1])
        self.assertIn("GET /healthz ", command[-1])

    def test_health_check_knows_healthy_from_ill(self):
        status = [200]

        class Answer(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(status[0] if self.path == "/healthz" else 404)
                self.end_headers()

            def log_message(self, *_):
                pass

        server = http.server.HTTPServer(("127.0.0.1", 0), Answer)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        command = [word.replace(f"/{health_port()} ", f"/{server.server_port} ") for word in self.health_command()]

        def healthy():
            return subprocess.run(command, stderr=subprocess.DEVNULL, timeout=30, check=False).returncode == 0

        try:
            self.assertTrue(healthy())
            status[0] = 503
            self.assertFalse(healthy())
        finally:
            server.shutdown()
            thread.join()
            server.server_close()
        self.assertFalse(healthy())


class Manifests(unittest.TestCase):
    # Fields that are used of each kind, after Kubernetes' reference; None: a value, str: any name. "!" marks those that
    # must be there.
    META = {"!name": None, "labels": {str: None}, "annotations": {str: None}}
    PROBE = {"!httpGet": {"!path": None, "!port": None}, "periodSeconds": None, "timeoutSeconds": None,
             "failureThreshold": None, "initialDelaySeconds": None}
    SELECTOR = {"!matchLabels": {str: None}}
    CONTAINER = {
        "!name": None, "!image": None, "args": [None],
        "!ports": [{"!name": None, "!containerPort": None}],
        "startupProbe": PROBE, "!readinessProbe": PROBE, "!livenessProbe": PROBE,
        "lifecycle": {"preStop": {"exec": {"!command": [None]}}},
        "!resources": {"!requests": {str: None}, "!limits": {str: None}},
        "!securityContext": {"allowPrivilegeEscalation": None, "readOnlyRootFilesystem": None,
                             "capabilities": {"drop": [None]}},
        "volumeMounts": [{"!name": None, "!mountPath": None, "readOnly": None}],
    }
    POD = {
        "automountServiceAccountToken": None, "!terminationGracePeriodSeconds": None,
        "topologySpreadConstraints": [{"!maxSkew": None, "!topologyKey": None, "!whenUnsatisfiable": None,
                                       "labelSelector": SELECTOR}],
        "!securityContext": {"runAsNonRoot": None, "runAsUser": None, "runAsGroup": None,
                             "seccompProfile": {"!type": None}},
        "!containers": [CONTAINER],
        "volumes": [{"!name": None, "configMap": {"!name": None}, "emptyDir": {"sizeLimit": None}}],
    }
    FIELDS = {
        ("v1", "ConfigMap"): {"!data": {str: None}},
        ("v1", "Service"): {"!spec": {"type": None, "!selector": {str: None},
                                      "!ports": [{"!name": None, "!port": None, "!targetPort": None,
                                                  "protocol": None}]}},
        ("apps/v1", "Deployment"): {"!spec": {
            "replicas": None, "!selector": SELECTOR,
            "strategy": {"!type": None, "rollingUpdate": {"maxUnavailable": None, "maxSurge": None}},
            "!template": {"!metadata": {"!labels": {str: None}, "annotations": {str: None}}, "!spec": POD}}},
        ("policy/v1", "PodDisruptionBudget"): {"!spec": {"maxUnavailable": None, "!selector": SELECTOR}},
        ("autoscaling/v2", "HorizontalPodAutoscaler"): {"!spec": {
            "!scaleTargetRef": {"!apiVersion": None, "!kind": None, "!name": None},
            "minReplicas": None, "!maxReplicas": None,
            "!metrics": [{"!type": None, "resource": {"!name": None, "!target": {
                "!type": None, "averageUtilization": None}}}],
            "behavior": {"scaleDown": {"stabilizationWindowSeconds": None}}}},
    }

    def setUp(self):
        self.objects = []
        for path in sorted((DEPLOY / "kubernetes").glob("*.yaml")):
            self.objects += list(yaml.safe_load_all(path.read_text()))
        self.config = yaml.safe_load(self.of_kind("ConfigMap")["data"]["edge_server.yaml"])
        self.deployment = self.of_kind("Deployment")
        self.pod = self.deployment["spec"]["template"]["spec"]
        self.container = self.pod["containers"][0]

    def of_kind(self, kind):
        found = [o for o in self.objects if o["kind"] == kind]
        self.assertEqual(1, len(found), kind)
        return found[0]

    def parameter(self, name):
        return {**defaults(), **flat(self.config)}[name]

    @classmethod
    def problems(cls, fields, given, where):
        """What is wrong, in words."""
        if fields is None:
            return [] if isinstance(given, (str, int, bool)) else [f"{where}: must be one value"]
        if isinstance(fields, list):
            if not isinstance(given, list) or not given:
                return [f"{where}: must be a list"]
            return [p for i, one in enumerate(given) for p in cls.problems(fields[0], one, f"{where}[{i}]")]
        if not isinstance(given, dict):
            return [f"{where}: must be a map"]
        if str in fields:
            return [f"{where}/{name}: must be a string" for name, value in given.items()
                    if not isinstance(value, str) or not isinstance(name, str)]
        known = {name.lstrip("!"): inner for name, inner in fields.items()}
        wrong = [f"{where}/{name[1:]} is missing" for name in fields if name[0] == "!" and name[1:] not in given]
        for name, value in given.items():
            wrong += cls.problems(known[name], value, f"{where}/{name}") if name in known else [f"{where}/{name}?"]
        return wrong

    def problems_of(self, one):
        fields = self.FIELDS[one["apiVersion"], one["kind"]]
        return self.problems({"!apiVersion": None, "!kind": None, "!metadata": self.META, **fields}, one, one["kind"])

    def test_fields_are_known_and_complete(self):
        for one in self.objects:
            self.assertEqual([], self.problems_of(one))
        self.assertEqual({kind for _, kind in self.FIELDS}, {one["kind"] for one in self.objects})

    def test_a_wrong_field_is_found(self):
        self.container["livenessProb"] = self.container.pop("livenessProbe")
        where = "Deployment/spec/template/spec/containers[0]/"
        self.assertEqual([where + "livenessProbe is missing", where + "livenessProb?"],
                         self.problems_of(self.deployment))

    def test_names_are_valid(self):
        names = [one["metadata"]["name"] for one in self.objects] + [self.container["name"]]
        names += [port["name"] for port in self.container["ports"]] + [v["name"] for v in self.pod["volumes"]]
        for name in names:
            self.assertRegex(name, r"^[a-z]([-a-z0-9]{0,61}[a-z0-9])?$")

    def test_configuration_is_of_edge_server(self):
        check_parameters(self, flat(self.config))

    def test_ports_are_those_of_the_configuration(self):
        ports = {port["name"]: port["containerPort"] for port in self.container["ports"]}
        self.assertEqual({"requests": self.parameter("port"), "health": self.parameter("health/port")}, ports)
        service = self.of_kind("Service")["spec"]["ports"]
        self.assertEqual([("requests", self.parameter("port"))], [(p["targetPort"], p["port"]) for p in service])
        self.assertEqual(self.parameter("port"), int(self.parameter("address").rpartition(":")[2]))
        annotations = self.deployment["spec"]["template"]["metadata"]["annotations"]
        self.assertEqual(str(self.parameter("health/port")), annotations["prometheus.io/port"])

    def test_probes_are_those_of_the_server(self):
        for probe, path in (("startupProbe", "/readyz"), ("readinessProbe", "/readyz"), ("livenessProbe", "/healthz")):
            self.assertEqual({"path": path, "port": "health"}, self.container[probe]["httpGet"])
        # A worker that hangs is the only thing that a new start mends: nobody is killed for being busy or draining.
        self.assertTrue(self.parameter("health/enabled"))
        self.assertEqual("0.0.0.0", self.parameter("health/host"))

    def test_there_is_time_to_drain(self):
        command = self.container["lifecycle"]["preStop"]["exec"]["command"]
        self.assertEqual("sleep", command[0])
        self.assertGreater(self.pod["terminationGracePeriodSeconds"],
                           int(command[1]) + self.parameter("drain_s") + FLUSH_S)

    def test_objects_find_each_other(self):
        labels = self.deployment["spec"]["template"]["metadata"]["labels"]
        for selector in (self.deployment["spec"]["selector"]["matchLabels"],
                         self.of_kind("Service")["spec"]["selector"],
                         self.of_kind("PodDisruptionBudget")["spec"]["selector"]["matchLabels"],
                         self.pod["topologySpreadConstraints"][0]["labelSelector"]["matchLabels"]):
            self.assertLessEqual(selector.items(), labels.items())
        target = self.of_kind("HorizontalPodAutoscaler")["spec"]["scaleTargetRef"]
        self.assertEqual({"apiVersion": self.deployment["apiVersion"], "kind": "Deployment",
                          "name": self.deployment["metadata"]["name"]}, target)
        volumes = {volume["name"]: volume for volume in self.pod["volumes"]}
        self.assertEqual(set(volumes), {mount["name"] for mount in self.container["volumeMounts"]})
        self.assertEqual(self.of_kind("ConfigMap")["metadata"]["name"], volumes["config"]["configMap"]["name"])
        mount = next(m for m in self.container["volumeMounts"] if m["name"] == "config")
        self.assertEqual(["--config", mount["mountPath"] + "/edge_server.yaml"], self.container["args"])

    def test_several_replicas_one_of_which_may_go(self):
        spec = self.of_kind("HorizontalPodAutoscaler")["spec"]
        self.assertGreaterEqual(self.deployment["spec"]["replicas"], 2)
        self.assertGreaterEqual(spec["minReplicas"], 2)
        self.assertGreater(spec["maxReplicas"], spec["minReplicas"])
        self.assertEqual(1, self.of_kind("PodDisruptionBudget")["spec"]["maxUnavailable"])

    def test_each_worker_has_a_core(self):
        resources = self.container["resources"]
        for bound in ("requests", "limits"):
            self.assertGreaterEqual(float(resources[bound]["cpu"]), self.parameter("admission/workers"))
        # Payloads must fit in.
        sizes = {"Mi": 1, "Gi": 1024}
        megabytes = int(resources["limits"]["memory"][:-2]) * sizes[resources["limits"]["memory"][-2:]]
        self.assertGreater(megabytes, 2 * self.parameter("server/max_payload_mb"))

    def test_image_and_user_are_those_of_the_container_file(self):
        text = (DEPLOY / "Containerfile").read_text()
        self.assertIn(f"-t {self.container['image']} .", text)
        version = ElementTree.parse(PACKAGE / "package.xml").findtext("version")
        self.assertEqual(version, self.container["image"].rpartition(":")[2])
        security = self.pod["securityContext"]
        self.assertIn(f"USER {security['runAsUser']}:{security['runAsGroup']}\n", text)
        self.assertIs(True, security["runAsNonRoot"])


class Launch(unittest.TestCase):
    """edge_nodes.launch, without ssh."""

    def setUp(self):
        try:
            import roslaunch.config
            import roslaunch.xmlloader
        except ImportError:
            self.skipTest("roslaunch is not installed")
        path = os.environ.get("ROS_PACKAGE_PATH", "")
        os.environ["ROS_PACKAGE_PATH"] = f"{PACKAGE}:{path}"
        self.addCleanup(os.environ.__setitem__, "ROS_PACKAGE_PATH", path)
        self.config = roslaunch.config.load_config_default(
            [str(PACKAGE / "launch/edge_nodes.launch")], None, roslaunch_strs=[],
            loader=roslaunch.xmlloader.XmlLoader(resolve_anon=False), verbose=False, assign_machines=False)

    def test_each_node_has_a_machine(self):
        machines = {node.name: self.config.machines[node.machine_name] for node in self.config.nodes}
        example = {node["id"]: node for node in
                   yaml.safe_load((PACKAGE / "config/edge_nodes.yaml").read_text())["nodes"]}
        self.assertEqual({"edge_server_gate", "edge_server_lamp_17"}, set(machines))
        for name, machine in machines.items():
            node = example[name.replace("edge_server_", "")]
            self.assertEqual(node["address"].partition(":")[0], machine.address)
            self.assertEqual("/opt/pi_edge/env.sh", machine.env_loader)
        for node in self.config.nodes:
            self.assertEqual(("pi_offload", "edge_server"), (node.package, node.type))

    def test_parameters_are_of_edge_server(self):
        given = {name: parameter.value for name, parameter in self.config.params.items()}
        example = yaml.safe_load((PACKAGE / "config/edge_nodes.yaml").read_text())["nodes"]
        for node in self.config.nodes:
            prefix = f"/{node.name}/"
            own = {name[len(prefix):]: value for name, value in given.items() if name.startswith(prefix)}
            own = flat({name: value for name, value in own.items()})
            check_parameters(self, own)
            announced = next(one for one in example if one["id"] == own["id"])
            for name in ("address", "x", "y", "range"):
                self.assertEqual(announced[name], own[name], name)


if __name__ == "__main__":
    unittest.main()
