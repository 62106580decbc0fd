"""The list of public networks that fetch_models gets, and the description that it writes beside each."""

import os
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import urlsplit

import yaml

from pi_detect.errors import ToolError

SUMS = {"sha256": 64, "sha384": 96, "sha1": 40}  # hexadecimal digits
ROLES = ("weights", "config")
# Of a description, besides name, weights and config.
FIELDS = ("input", "output", "labels", "score_threshold", "class_agnostic_overlap", "origin", "licence")


@dataclass(frozen=True)
class CatalogueFile:
    """A file of a model and where it comes from."""

    name: str          # plain file name under which it is kept
    role: str          # of ROLES
    urls: tuple        # tried in this order
    size: int          # bytes of the download; 0: not published
    sums: dict         # algorithm -> hexadecimal digits, of the download; never empty
    member: str        # file inside the archive that is downloaded; "": the download is the file
    member_sums: dict  # likewise, of the member; may be empty

    @property
    def download_name(self):
        """File name of the download."""
        return PurePosixPath(urlsplit(self.urls[0]).path).name if self.member else self.name


@dataclass(frozen=True)
class CatalogueModel:
    name: str
    title: str
    files: tuple
    description: dict    # empty: the package has it, in `described_in`
    described_in: object = None  # path; None: fetch_models writes the description


def _check(valid, path, place, value, bound):
    if not valid:
        raise ToolError(f"{path}: {place} = {value!r}, must be {bound}")


def _is_file_name(name):
    """Whether it names a file in the folder it is joined to, and nothing hidden."""
    return isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", name) is not None


def _read_sums(path, place, sums, required):
    _check(isinstance(sums, dict) and (sums or not required), path, place, sums,
           f"a map with at least one of {', '.join(SUMS)}")
    for algorithm, digits in sums.items():
        _check(algorithm in SUMS, path, place, algorithm, f"one of {', '.join(SUMS)}")
        _check(isinstance(digits, str) and re.fullmatch("[0-9a-f]{%d}" % SUMS[algorithm], digits), path,
               f"{place}/{algorithm}", digits, f"{SUMS[algorithm]} hexadecimal digits")
    return sums


def _read_file(path, place, entry):
    _check(isinstance(entry, dict), path, place, entry, "a map")
    name, urls, member = entry.get("name"), entry.get("urls"), entry.get("member", "")
    _check(_is_file_name(name), path, f"{place}/name", name, "a plain file name")
    _check(entry.get("role") in ROLES, path, f"{place}/role", entry.get("role"), " or ".join(ROLES))
    _check(isinstance(urls, list) and urls, path, f"{place}/urls", urls, "a list of addresses")
    for url in urls:
        parts = urlsplit(str(url))
        _check(parts.scheme in ("http", "https") and parts.netloc, path, f"{place}/urls", url, "an http(s) address")
    size = entry.get("bytes", 0)
    _check(isinstance(size, int) and size >= 0, path, f"{place}/bytes", size, "a number of bytes")
    is_safe = isinstance(member, str) and not member.startswith("/") and ".." not in PurePosixPath(member).parts
    _check(is_safe, path, f"{place}/member", member, "a path inside the archive")
    sums = _read_sums(path, f"{place}/sums", entry.get("sums"), True)
    member_sums = _read_sums(path, f"{place}/member_sums", entry.get("member_sums", {}), False)
    file = CatalogueFile(name, entry["role"], tuple(urls), size, sums, member, member_sums)
    _check(_is_file_name(file.download_name), path, f"{place}/urls", urls[0], "an address that ends in a file name")
    return file


def load_catalogue(path):
    """Models of a catalogue by name, in the file's order. @throws ToolError naming file, field, value and bound"""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ToolError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    entries = content.get("models") if isinstance(content, dict) else None
    _check(isinstance(entries, dict) and entries, path, "models", entries, "a map of models")
    label_sets = content.get("label_sets", {})
    models = {}
    for name, entry in entries.items():
        place = f"models/{name}"
        _check(_is_file_name(name) and "." not in name, path, place, name, "made of letters, digits, _ and -")
        _check(isinstance(entry, dict) and isinstance(entry.get("title"), str), path, place, entry,
               "a map with a title")
        _check(isinstance(entry.get("files"), list), path, f"{place}/files", entry.get("files"), "a list")
        files = tuple(_read_file(path, f"{place}/files/{i}", file) for i, file in enumerate(entry["files"]))
        roles = [file.role for file in files]
        _check(roles.count("weights") == 1 and roles.count("config") <= 1, path, f"{place}/files", roles,
               "one file of weights and at most one config")
        description = entry.get("description")
        if isinstance(description, str):
            described_in = path.with_name(description)
            _check(_is_file_name(description) and described_in.is_file(), path, f"{place}/description", description,
                   "a map, or the name of a description beside the catalogue")
            models[name] = CatalogueModel(name, entry["title"], files, {}, described_in)
            continue
        _check(isinstance(description, dict) and set(description) == set(FIELDS), path, f"{place}/description",
               description and sorted(description), f"a map of {', '.join(FIELDS)}")
        labels = description["labels"]
        _check(labels in label_sets, path, f"{place}/description/labels", labels, "a name in label_sets")
        models[name] = CatalogueModel(name, entry["title"], files, {**description, "labels": label_sets[labels]})
    return models


def describe(model, sha256):
    """The description of a model as text, with the files in the same folder.

    @param sha256  dict file name -> sha256 of the file that lies there
    """
    content = {"name": model.name}
    for role in ROLES:
        for file in model.files:
            if file.role == role:
                content[role] = {"file": file.name, "sha256": sha256[file.name]}
    content.update((field, model.description[field]) for field in FIELDS)
    return (f"# {model.title}\n# Written by fetch_models of pi_detect.\n" +
            yaml.safe_dump(content, sort_keys=False, width=120))


def described_sums(path):
    """The files that a description needs, as list of dicts file name -> sha256, any of which is enough; empty if it is
    no description or not there."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        weights = content["weights"] if isinstance(content["weights"], list) else [content["weights"]]
        config = [content["config"]] if "config" in content else []
        return [{file["file"]: file["sha256"] for file in [choice, *config]} for choice in weights]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, TypeError, KeyError):
        return []


def weights_folders():
    """Where the nodes look for weights besides the description's folder, as pi_detect/model_catalogue.h."""
    data = os.environ.get("PI_EDGE_DATA")
    return ([Path(data) / "detect" / "models"] if data else []) + [default_output()]


def default_output():
    """Where fetch_models keeps what it fetches."""
    home = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(home) / "pi_detect" / "models"
