"""What deploys edge_server: systemd's units, manifests of Kubernetes, launch file for several machines.

None is run here: they are checked for what can be wrong in them without a cluster. test_edge_image.py runs the image.
"""

import os
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

import yaml

from pi_offload import edge_image

PACKAGE = Path(__file__).resolve().parents[2]
DEPLOY = PACKAGE / "deploy"
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


class Manifests(unittest.TestCase):
    # Fields that are used of each kind, after Kubernetes' reference; None: a value, str: any name. "!" marks those that
    # must be there.
    META = {"!name": None, "labels": {str: None}, "annotations": {str: None}}
    PROBE = {"httpGet": {"!path": None, "!port": None}, "tcpSocket": {"!port": None},
             "periodSeconds": None, "timeoutSeconds": None,
             "failureThreshold": None, "initialDelaySeconds": None}
    SELECTOR = {"!matchLabels": {str: None}}
    CONTAINER = {
        "!name": None, "!image": None, "command": [None], "args": [None],
        "!ports": [{"!name": None, "!containerPort": None}],
        "startupProbe": PROBE, "!readinessProbe": PROBE, "!livenessProbe": PROBE,
        "!resources": {"!requests": {str: None}, "!limits": {str: None}},
        "!securityContext": {"allowPrivilegeEscalation": None, "readOnlyRootFilesystem": None,
                             "capabilities": {"drop": [None]}},
        "volumeMounts": [{"!name": None, "!mountPath": None, "subPath": None, "readOnly": None}],
    }
    POD = {
        "automountServiceAccountToken": None, "!terminationGracePeriodSeconds": None,
        "topologySpreadConstraints": [{"!maxSkew": None, "!topologyKey": None, "!whenUnsatisfiable": None,
                                       "labelSelector": SELECTOR}],
        "!securityContext": {"runAsNonRoot": None, "runAsUser": None, "runAsGroup": None, "fsGroup": None,
                             "seccompProfile": {"!type": None}},
        "!containers": [CONTAINER],
        "volumes": [{"!name": None, "configMap": {"!name": None}, "emptyDir": {"sizeLimit": None},
                     "secret": {"!secretName": None, "defaultMode": None}}],
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
        ("apps/v1", "StatefulSet"): {"!spec": {
            "!serviceName": None, "!replicas": None, "!selector": SELECTOR,
            "!template": {"!metadata": {"!labels": {str: None}, "annotations": {str: None}}, "!spec": POD}}},
        ("policy/v1", "PodDisruptionBudget"): {"!spec": {"maxUnavailable": None, "!selector": SELECTOR}},
        ("autoscaling/v2", "HorizontalPodAutoscaler"): {"!spec": {
            "!scaleTargetRef": {"!apiVersion": None, "!kind": None, "!name": None},
            "minReplicas": None, "!maxReplicas": None,
            "!metrics": [{"!type": None, "!pods": {"!metric": {"!name": None}, "!target": {
                "!type": None, "!averageValue": None}}}],
            "behavior": {"scaleUp": {"stabilizationWindowSeconds": None, "policies": [
                {"!type": None, "!value": None, "!periodSeconds": None}]},
                         "scaleDown": {"stabilizationWindowSeconds": None}}}},
    }

    def setUp(self):
        self.objects = []
        for path in sorted((DEPLOY / "kubernetes").glob("*.yaml")):
            if path.name != "prometheus_adapter.yaml":  # values of a chart
                self.objects += list(yaml.safe_load_all(path.read_text()))
        self.config = yaml.safe_load(self.of_kind("ConfigMap")["data"]["edge_server.yaml"])
        self.deployment = self.of_kind("Deployment")
        self.pod = self.deployment["spec"]["template"]["spec"]
        self.container = self.pod["containers"][0]
        self.nats = self.of_kind("StatefulSet")

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
        self.assertEqual({"health": self.parameter("health/port")}, ports)
        annotations = self.deployment["spec"]["template"]["metadata"]["annotations"]
        self.assertEqual(str(self.parameter("health/port")), annotations["prometheus.io/port"])
        nats = self.nats["spec"]["template"]["spec"]["containers"][0]
        ports = {port["name"]: port["containerPort"] for port in nats["ports"]}
        self.assertEqual({"vehicles": 4222, "sites": 6222}, ports)  # the defaults of pi_edge fleet add-site
        self.assertEqual(ports["vehicles"], int(self.parameter("address").rpartition(":")[2]))
        service = self.of_kind("Service")
        self.assertEqual(ports, {port["targetPort"]: port["port"] for port in service["spec"]["ports"]})
        self.assertEqual([f"{service['metadata']['name']}:{ports['vehicles']}"], self.parameter("nats/servers"))

    def test_probes_are_those_of_the_server(self):
        for probe, path in (("startupProbe", "/readyz"), ("readinessProbe", "/readyz"), ("livenessProbe", "/healthz")):
            self.assertEqual({"path": path, "port": "health"}, self.container[probe]["httpGet"])
        # A worker that hangs is the only thing that a new start mends: nobody is killed for being busy or draining.
        self.assertTrue(self.parameter("health/enabled"))
        self.assertEqual("0.0.0.0", self.parameter("health/host"))

    def test_there_is_time_to_drain(self):
        self.assertGreater(self.pod["terminationGracePeriodSeconds"], self.parameter("drain_s") + FLUSH_S)

    def test_objects_find_each_other(self):
        labels = self.deployment["spec"]["template"]["metadata"]["labels"]
        for selector in (self.deployment["spec"]["selector"]["matchLabels"],
                         self.of_kind("PodDisruptionBudget")["spec"]["selector"]["matchLabels"],
                         self.pod["topologySpreadConstraints"][0]["labelSelector"]["matchLabels"]):
            self.assertLessEqual(selector.items(), labels.items())
        nats = self.nats["spec"]
        for selector in (nats["selector"]["matchLabels"], self.of_kind("Service")["spec"]["selector"]):
            self.assertLessEqual(selector.items(), nats["template"]["metadata"]["labels"].items())
        self.assertEqual(self.of_kind("Service")["metadata"]["name"], nats["serviceName"])
        target = self.of_kind("HorizontalPodAutoscaler")["spec"]["scaleTargetRef"]
        self.assertEqual({"apiVersion": self.deployment["apiVersion"], "kind": "Deployment",
                          "name": self.deployment["metadata"]["name"]}, target)
        volumes = {volume["name"]: volume for volume in self.pod["volumes"]}
        self.assertEqual(set(volumes), {mount["name"] for mount in self.container["volumeMounts"]})
        self.assertEqual(self.of_kind("ConfigMap")["metadata"]["name"], volumes["config"]["configMap"]["name"])
        mount = next(m for m in self.container["volumeMounts"] if m["name"] == "config")
        self.assertEqual(["--config", mount["mountPath"]], self.container["args"])
        self.assertIn(mount["subPath"], self.of_kind("ConfigMap")["data"])

    def test_keys_lie_where_the_configuration_looks(self):
        mount = next(m["mountPath"] for m in self.container["volumeMounts"] if m["name"] == "keys")
        self.assertEqual([f"{mount}/{name}" for name in ("ca.pem", "certificate.pem", "key.pem")],
                         [self.parameter(f"nats/{name}") for name in ("ca_file", "certificate_file", "key_file")])
        self.assertEqual("nats", self.parameter("transport"))
        pod = self.nats["spec"]["template"]["spec"]
        mount = next(m["mountPath"] for m in pod["containers"][0]["volumeMounts"] if m["name"] == "keys")
        self.assertEqual(["nats-server", "-c", mount + "/nats-server.conf"], pod["containers"][0]["command"])
        for one in (pod, self.pod):
            keys = next(volume["secret"] for volume in one["volumes"] if volume["name"] == "keys")
            self.assertEqual(0o440, keys["defaultMode"])
            self.assertEqual(one["securityContext"]["runAsGroup"], one["securityContext"]["fsGroup"])

    def test_it_scales_on_what_vehicles_wait_for(self):
        metrics = self.of_kind("HorizontalPodAutoscaler")["spec"]["metrics"]
        rules = yaml.safe_load((DEPLOY / "kubernetes/prometheus_adapter.yaml").read_text())["rules"]["custom"]
        self.assertEqual(["Pods"] * 2, [metric["type"] for metric in metrics])
        self.assertEqual([rule["name"]["as"] for rule in rules],
                         [metric["pods"]["metric"]["name"] for metric in metrics])
        for rule in rules:
            series = rule["seriesQuery"].partition("{")[0]
            self.assertEqual(f"^{series}$", rule["name"]["matches"])
            self.assertIn("<<.Series>>{<<.LabelMatchers>>}", rule["metricsQuery"])
            self.assertEqual({"namespace", "pod"}, set(rule["resources"]["overrides"]))

    def test_several_replicas_one_of_which_may_go(self):
        spec = self.of_kind("HorizontalPodAutoscaler")["spec"]
        self.assertNotIn("replicas", self.deployment["spec"])  # each apply would reset what the autoscaler chose
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

    def test_image_and_user_are_those_of_make_image(self):
        version = edge_image.version_of(PACKAGE)
        for pod in (self.pod, self.nats["spec"]["template"]["spec"]):
            self.assertEqual(f"{edge_image.EdgeNode.name}:{version}", pod["containers"][0]["image"])
            security = pod["securityContext"]
            self.assertEqual([edge_image.USER] * 2, [security["runAsUser"], security["runAsGroup"]])
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
