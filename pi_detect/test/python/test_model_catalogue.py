#!/usr/bin/python3
import copy
import sys
import tempfile
import unittest
from pathlib import Path

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from pi_detect.errors import ToolError
from pi_detect.model_catalogue import describe, described_sums, load_catalogue

SHIPPED = Path(__file__).resolve().parents[2] / "config" / "models" / "catalogue.yaml"
VALID = {
    "label_sets": {"pets": {1: "cat", 3: "dog"}},
    "models": {"net": {
        "title": "A network",
        "files": [{"name": "net.pb", "role": "weights", "urls": ["https://server.test/a/net.tar.gz"], "bytes": 7,
                   "sums": {"sha256": "0" * 64}, "member": "net/graph.pb"},
                  {"name": "net.pbtxt", "role": "config", "urls": ["https://server.test/net.txt"],
                   "sums": {"sha1": "1" * 40}}],
        "description": {"input": {"width": 300, "height": 300}, "output": {"kind": "detections"}, "labels": "pets",
                        "score_threshold": 0.5, "class_agnostic_overlap": 0.0, "origin": "o", "licence": "l"}}}}


class ModelCatalogue(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "catalogue.yaml"

    def load(self, content):
        self.path.write_text(yaml.safe_dump(content))
        return load_catalogue(self.path)

    def test_the_shipped_catalogue_is_valid_and_every_sum_has_a_source(self):
        models = load_catalogue(SHIPPED)
        self.assertGreaterEqual(len(models), 5)
        for entry in yaml.safe_load(SHIPPED.read_text())["models"].values():
            for file in entry["files"]:
                self.assertTrue(file["published"])
        names = [file.name for model in models.values() for file in model.files]
        self.assertEqual(len(names), len(set(names)))  # all lie in one folder
        self.assertEqual(len(models["ssd_mobilenet_v2_coco"].description["labels"]), 80)
        self.assertEqual(models["mobilenet_ssd_voc"].description["labels"][15], "person")

    def test_a_download_is_named_by_its_address_if_it_is_an_archive(self):
        weights, config = self.load(VALID)["net"].files
        self.assertEqual(weights.download_name, "net.tar.gz")
        self.assertEqual(config.download_name, "net.pbtxt")

    def test_the_description_names_files_sums_and_labels(self):
        model = self.load(VALID)["net"]
        text = describe(model, {"net.pb": "a" * 64, "net.pbtxt": "b" * 64})
        content = yaml.safe_load(text)
        self.assertEqual(content["name"], "net")
        self.assertEqual(content["weights"], {"file": "net.pb", "sha256": "a" * 64})
        self.assertEqual(content["config"], {"file": "net.pbtxt", "sha256": "b" * 64})
        self.assertEqual(content["labels"], {1: "cat", 3: "dog"})
        self.assertEqual(content["output"], {"kind": "detections"})
        self.path.write_text(text)
        self.assertEqual(described_sums(self.path), [{"net.pb": "a" * 64, "net.pbtxt": "b" * 64}])

    def test_a_description_may_lie_beside_the_catalogue(self):
        models = load_catalogue(SHIPPED)
        for name in ("fast", "accurate"):
            described_in = models[name].described_in
            self.assertEqual(described_in, SHIPPED.with_name(f"{name}.yaml"))
            file = models[name].files[0]
            self.assertIn({file.name: file.sums["sha256"]}, described_sums(described_in))
        content = copy.deepcopy(VALID)
        content["models"]["net"]["description"] = "absent.yaml"
        with self.assertRaisesRegex(ToolError, "models/net/description = 'absent.yaml', must be a map, or the name of"):
            self.load(content)

    def test_what_is_no_description_has_no_sums(self):
        self.assertEqual(described_sums(self.path), [])
        for text in ("[", "3", "weights: x"):
            self.path.write_text(text)
            self.assertEqual(described_sums(self.path), [])

    def test_wrong_fields_are_refused_by_name_and_value(self):
        def file(field, value):
            return lambda content: content["models"]["net"]["files"][0].update({field: value})

        cases = [
            (file("name", "../net.pb"), "files/0/name = '../net.pb'"),
            (file("name", ".net"), "files/0/name"),
            (file("role", "labels"), "files/0/role = 'labels', must be weights or config"),
            (file("role", "config"), "one file of weights"),
            (file("urls", []), "files/0/urls"),
            (file("urls", ["file:///etc/passwd"]), "file:///etc/passwd.*http"),
            (file("urls", ["https://server.test/"]), "ends in a file name"),
            (file("sums", {}), "files/0/sums = {}, must be a map with at least one of sha256, sha384, sha1"),
            (file("sums", {"md5": "0" * 32}), "md5"),
            (file("sums", {"sha256": "abc"}), "files/0/sums/sha256 = 'abc', must be 64"),
            (file("bytes", -1), "bytes = -1"),
            (file("member", "../graph.pb"), "member = '../graph.pb'"),
            (file("member", "/graph.pb"), "member"),
            (lambda content: content["models"]["net"]["description"].pop("input"), "description"),
            (lambda content: content["models"]["net"]["description"].update(labels="fruit"), "labels = 'fruit'"),
            (lambda content: content["models"].update({"a/b": {}}), "a/b"),
            (lambda content: content.update(models={}), "models"),
        ]
        for change, message in cases:
            content = copy.deepcopy(VALID)
            change(content)
            with self.assertRaisesRegex(ToolError, message):
                self.load(content)

    def test_a_file_that_is_missing_or_no_yaml_is_refused(self):
        with self.assertRaisesRegex(ToolError, "catalogue.yaml: No such file"):
            load_catalogue(self.path)
        self.path.write_text("a: [")
        with self.assertRaisesRegex(ToolError, "is not YAML"):
            load_catalogue(self.path)


if __name__ == "__main__":
    unittest.main()
