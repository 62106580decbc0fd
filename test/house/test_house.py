"""The rules of the house that a program can check: where a line may live, and how long its function may be."""

import collections
import re
import shutil
import subprocess
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MOST_LINES_OF_A_FUNCTION = 100
MOST_LINES_OF_AN_ADAPTER = 400
MOST_FILES_OF_A_FOLDER = 40
CONSTANT = re.compile(r"^(?:static |inline )?(?:constexpr|const) [^=({;]*?\b([A-Z][A-Z0-9_]+)(?:\[\w*\])? *[={]",
                      re.MULTILINE)
# Who may include whom: every package may include pi_node and itself.
MAY_INCLUDE = {
    "pi_node": [],
    "pi_os_transport": [],
    "pi_runtime": [],
    "pi_slam": ["pi_os_transport", "pi_runtime"],
    "pi_detect": ["pi_os_transport", "pi_runtime"],
    "pi_speech": ["pi_os_transport", "pi_runtime"],
    "pi_offload": ["pi_os_transport", "pi_runtime", "pi_detect", "pi_speech"],
    "pi_vehicle": ["pi_os_transport", "pi_detect", "pi_speech"],
    "pi_simulation": ["pi_os_transport", "pi_slam", "pi_detect", "pi_speech", "pi_vehicle"],
    "pi_web": [],
    "pi_bringup": [],
}


def tracked(*patterns):
    if shutil.which("git"):
        listing = subprocess.run(["git", "-C", ROOT, "ls-files", *patterns], stdout=subprocess.PIPE, text=True,
                                 check=False)
        files = [Path(line) for line in listing.stdout.splitlines() if (ROOT / line).is_file()]
        if files or listing.returncode == 0:
            return files
    return [path.relative_to(ROOT) for path in ROOT.rglob("*")  # a copy without its history
            if path.is_file() and path.parts[len(ROOT.parts)] not in ("build", "install", ".git") and
            (not patterns or any(path.match(pattern) for pattern in patterns))]


def includes(file):
    return re.findall(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', (ROOT / file).read_text(errors="replace"), re.MULTILINE)


def is_product(file):
    return not {"test", "bench", "examples"} & set(file.parts)


def long_functions(file):
    """[(line, number of lines)] of functions, by the house's layout: braces have lines of their own."""
    lines = (ROOT / file).read_text(errors="replace").split("\n")
    found = []
    for indent in ("", "  "):
        start = None
        for number, line in enumerate(lines):
            if line == indent + "{":
                start = number
            elif start is not None and (line == indent + "}" or line == indent + "};"):
                head = start
                while head > 0 and lines[head - 1].strip() and not lines[head - 1].lstrip().startswith(("//", "#", "{")):
                    head -= 1
                kind = lines[head].strip()
                if line == indent + "}" and not re.match(r"(namespace|class|struct|enum|union|extern)\b", kind):
                    found.append((head + 1, number - head + 1))
                start = None
    return [(line, count) for line, count in found if count > MOST_LINES_OF_A_FUNCTION]


def libraries(package):
    """{library: sources} of a package; without those that share no translation unit with others."""
    text = (ROOT / package / "CMakeLists.txt").read_text()
    alone = " ".join(re.findall(r"set_source_files_properties\(([^)]*)\)", text)).split()
    return {name: [source for source in sources.split() if source.endswith(".cpp") and source not in alone]
            for name, sources in re.findall(r"add_library\((\w+)([^)]*)\)", text)}


class House(unittest.TestCase):
    def assertNone(self, wrong, rule):
        self.assertFalse(wrong, rule + ":\n  " + "\n  ".join(str(one) for one in wrong))

    def test_public_headers_are_those_that_others_use(self):
        users = collections.defaultdict(set)
        headers = {"/".join(path.parts[2:]): path for path in tracked("pi_*/include/*") if path.suffix == ".h"}
        for file in tracked():
            if file.suffix in (".h", ".cpp", ".in"):
                for name in includes(file):
                    users[name].add(file)
        readmes = "".join((ROOT / path).read_text() for path in tracked("*.md"))
        used = {name for name, path in headers.items()
                if name in readmes or "`%s`" % path.name in readmes or
                any(user.parts[0] not in (path.parts[0], "test") or "examples" in user.parts for user in users[name])}
        unread = list(used)
        while unread:  # and what these include
            for name in includes(headers[unread.pop()]):
                if name in headers and name not in used:
                    used.add(name)
                    unread.append(name)
        self.assertNone(sorted(set(headers) - used), "a header that only its package uses lies beside its source")

    def test_dependencies_point_one_way(self):
        wrong = []
        for file in tracked("pi_*"):
            if file.suffix in (".h", ".cpp") and "templates" not in file.parts:
                allowed = MAY_INCLUDE[file.parts[0]] + ["pi_node", file.parts[0]]
                wrong += ["%s includes %s" % (file, name) for name in includes(file)
                          if name.startswith("pi_") and "/" in name and name.split("/")[0] in MAY_INCLUDE and
                          name.split("/")[0] not in allowed]
        self.assertNone(wrong, "dependencies point one way")

    def test_bringup_only_starts_things(self):
        self.assertNone([path for path in tracked("pi_bringup/*") if path.suffix in (".h", ".cpp")],
                        "pi_bringup has no C++")

    def test_folders_are_small(self):
        folders = collections.Counter(path.parent for path in tracked("pi_*", "test"))
        data = {"data", "corpus", "models"}
        self.assertNone(["%s: %d files" % entry for entry in folders.items()
                         if entry[1] > MOST_FILES_OF_A_FOLDER and not data & set(entry[0].parts)],
                        "no flat folder of more than %d files" % MOST_FILES_OF_A_FOLDER)

    def test_functions_are_short(self):
        wrong = ["%s:%d: %d lines" % (file, line, count) for file in tracked("pi_*")
                 if file.suffix in (".h", ".cpp") and is_product(file) for line, count in long_functions(file)]
        self.assertNone(wrong, "no function above %d lines" % MOST_LINES_OF_A_FUNCTION)

    def test_constants_of_a_library_have_names_of_their_own(self):
        wrong = []
        for package in MAY_INCLUDE:
            for library, sources in libraries(package).items():
                owners = collections.defaultdict(list)
                for source in sources:
                    for name in CONSTANT.findall((ROOT / package / source).read_text()):
                        owners[name].append(source)
                wrong += ["%s: %s in %s" % (library, name, " and ".join(files))
                          for name, files in owners.items() if len(files) > 1]
        self.assertNone(wrong, "sources of a library share translation units, so a name is theirs together")

    def test_adapters_are_small(self):
        wrong = []
        for header in tracked("pi_*"):
            if header.name.endswith("_ros.h") and is_product(header):
                parts = [path for path in tracked(str(header.parent) + "/*")
                         if path.suffix in (".h", ".cpp")
                         and re.match(re.escape(header.stem) + r"(_(?!options).*)?$", path.stem)
                         and (path.stem == header.stem or not (ROOT / path.with_suffix(".h")).exists())]
                count = sum(len((ROOT / path).read_text().splitlines()) for path in parts)
                if count > MOST_LINES_OF_AN_ADAPTER:
                    wrong.append("%s: %d lines with its sources" % (header, count))
        self.assertNone(wrong, "no adapter above %d lines" % MOST_LINES_OF_AN_ADAPTER)


if __name__ == "__main__":
    unittest.main()
