"""Makes the container image of an edge node: edge_server, its models, nats-server, and what they need of Debian.

The root file system is made by mmdebstrap from the Debian packages that own the program's libraries; nothing comes from
a registry of images. The image is an archive in OCI's format: `podman load`, `skopeo copy`, `ctr images import` take
it, or runc starts the unpacked file system. --root-of-this-machine copies the libraries of this machine in place of
packages, in seconds: for tests.
"""

import argparse
import gzip
import hashlib
import io
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from pi_offload.errors import ToolError

PREFIX = Path("/opt/pi_edge")
NAME = "pi_edge/edge_server"
USER = 10001
PORTS = (5680, 5681)
SPEECH_MODEL = "pocketsphinx-en-us"
PACKAGES = (SPEECH_MODEL, "nats-server")      # beside those of the libraries
PROGRAMS = ("pi_offload/edge_server", "pi_detect/check_model", "pi_speech/check_speech_model")
SHARES = ("pi_detect", "pi_offload", "pi_speech")
UNNEEDED = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*")
CONFIGURATION = "/etc/pi_edge/edge_server.yaml"
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "ROS_HOME": "/tmp", "XDG_DATA_HOME": f"{PREFIX}/share",
               "LD_LIBRARY_PATH": f"{PREFIX}/lib", "LC_ALL": "C.UTF-8"}
ENTRY_POINT = [f"{PREFIX}/lib/pi_offload/edge_server"]
ARGUMENTS = ["--config", CONFIGURATION]
ARCHITECTURES = {"x86_64": "amd64", "aarch64": "arm64"}


def run(words, missing):
    """@return its output. @param missing  the Debian package of the program. @throws ToolError"""
    try:
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise ToolError(f"{words[0]} is missing: apt-get install {missing}") from None
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip()[-1000:]
        raise ToolError(f"{words[0]} ended with status {done.returncode}: {said}")
    return done.stdout


def libraries(program):
    """What the program loads, as paths that the loader sees. @throws ToolError"""
    text = run(["ldd", program], "libc-bin")
    missing = re.findall(r"^\s*(\S+) => not found", text, re.MULTILINE)
    if missing:
        raise ToolError(f"{program} does not find {', '.join(missing)}: build the suite, and source its setup.sh")
    return [Path(path) for path in re.findall(r"(/\S+) \(0x", text)]


def packages(paths):
    """Names of the Debian packages that own these files. @throws ToolError"""
    files = {str(path.resolve()).removeprefix("/usr") for path in paths}  # packages name some without /usr, some with
    text = subprocess.run(["dpkg-query", "--search", *(prefix + file for file in files for prefix in ("", "/usr"))],
                          capture_output=True, text=True, check=False).stdout
    owners = {match[2].removeprefix("/usr"): match[1]
              for match in re.finditer(r"^([a-z0-9.+-]+)(?::\S+)?: (/\S+)$", text, re.MULTILINE)}
    strangers = sorted(files - set(owners))
    if strangers:
        raise ToolError(f"{strangers[0]} belongs to no Debian package, so an image of packages cannot hold it")
    return sorted({owners[file] for file in files})


class Suite:
    """The files of the suite that the image holds."""

    def __init__(self, library_folder, shares):
        """@param library_folder  of an install or devel space. @param shares  {package: folder with its config}"""
        self.programs, self.shares = {name: library_folder / name for name in PROGRAMS}, shares
        missing = [str(program) for program in self.programs.values() if not program.is_file()]
        if missing:
            raise ToolError(f"{missing[0]} is missing: call make build, or give the install space as --prefix")
        found = sorted({path for program in self.programs.values() for path in libraries(program)})
        self.own = [path for path in found if not str(path).startswith(("/lib", "/usr"))]
        self.system = [path for path in found if path not in self.own]

    @classmethod
    def installed(cls, prefix):
        return cls(prefix / "lib", {name: prefix / "share" / name for name in SHARES})

    def copy_to(self, root):
        folder = root / str(PREFIX)[1:]
        for name, program in self.programs.items():
            (folder / "lib" / name).parent.mkdir(parents=True)
            shutil.copy2(program, folder / "lib" / name)
        for path in self.own:
            shutil.copy2(path, folder / "lib")
        for name, share in self.shares.items():
            shutil.copytree(share / "config", folder / "share" / name / "config")
            shutil.copy2(share / "package.xml", folder / "share" / name)
        weights = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "pi_detect/models"
        if weights.is_dir():  # the public networks; without them the suite's own stands in
            shutil.copytree(weights, folder / "share/pi_detect/models")
        configuration = root / CONFIGURATION[1:]
        configuration.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(self.shares["pi_offload"] / "config/edge_server.yaml", configuration)


def debian_root(root, suite):
    """Fills the folder with Debian's packages."""
    sources = [path for path in (Path("/etc/apt/sources.list"), *sorted(Path("/etc/apt/sources.list.d").glob("*")))
               if path.suffix in (".list", ".sources") and path.stat().st_size > 0]
    if not sources:
        raise ToolError("/etc/apt names no source of Debian packages: mmdebstrap needs one")
    run(["mmdebstrap", "--variant=essential", "--include=" + ",".join([*packages(suite.system), *PACKAGES]),
         "--aptopt=APT::Install-Recommends \"false\"", *(f"--dpkgopt=path-exclude={path}" for path in UNNEEDED),
         platform.freedesktop_os_release()["VERSION_CODENAME"], root, *sources], "mmdebstrap")


def root_of_this_machine(root, suite):
    """Fills the folder with this machine's libraries and models, where the loader sees them here."""
    for name in ("lib", "lib64"):
        (root / "usr" / name).mkdir(parents=True)
        (root / name).symlink_to(f"usr/{name}")
    for name in ("tmp", "proc", "dev", "sys", "etc"):
        (root / name).mkdir()
    for path in suite.system:
        target = root / str(path)[1:]
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    for path in run(["dpkg-query", "--listfiles", SPEECH_MODEL], "dpkg").split():
        if Path(path).is_file() and "/doc/" not in path:
            (root / path[1:]).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, root / path[1:])


def check(root):
    """Starts the program in the root with --check: a library or model that is missing is found now."""
    if os.geteuid() == 0:  # the program finds its models by /proc
        run(["unshare", "--mount", "--pid", "--fork", f"--mount-proc={root}/proc", "chroot", root, "/usr/bin/env", "-i", *(f"{name}={value}" for name, value in ENVIRONMENT.items()),
             *ENTRY_POINT, *ARGUMENTS, "--check"], "util-linux")


def configuration(layer, version):
    """OCI's description of the image."""
    return {"architecture": ARCHITECTURES.get(platform.machine(), platform.machine()), "os": "linux",
            "config": {"User": f"{USER}:{USER}", "Env": [f"{name}={value}" for name, value in ENVIRONMENT.items()],
                       "Entrypoint": ENTRY_POINT, "Cmd": ARGUMENTS, "WorkingDir": "/", "StopSignal": "SIGTERM",
                       "ExposedPorts": {f"{port}/tcp": {} for port in PORTS},
                       "Labels": {"org.opencontainers.image.version": version}},
            "rootfs": {"type": "layers", "diff_ids": ["sha256:" + layer]},
            "history": [{"created_by": "pi_offload edge_image"}]}


class _Hashing:
    """A file that is written to, with the checksum of what went through."""

    def __init__(self, file):
        self._file, self.checksum, self.size = file, hashlib.sha256(), 0

    def write(self, data):
        self.checksum.update(data)
        self.size += len(data)
        return self._file.write(data)

    def flush(self):
        self._file.flush()


def write_archive(root, path, version):
    """Packs a root file system into an archive of OCI's image layout."""
    def owned_by_root(entry):
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = "root"
        return None if entry.ischr() or entry.isblk() else entry

    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        packed = Path(folder) / "layer"
        with open(packed, "wb") as file:
            compressed = _Hashing(file)
            with gzip.GzipFile(fileobj=compressed, mode="wb", compresslevel=1, mtime=0) as zipped:
                plain = _Hashing(zipped)
                with tarfile.open(fileobj=plain, mode="w|", format=tarfile.PAX_FORMAT) as layer:
                    layer.add(root, ".", filter=owned_by_root)
        blobs = {}

        def blob(tree, kind):
            data = json.dumps(tree).encode()
            digest = hashlib.sha256(data).hexdigest()
            blobs[f"blobs/sha256/{digest}"] = data
            return {"mediaType": f"application/vnd.oci.image.{kind}.v1+json", "digest": "sha256:" + digest,
                    "size": len(data)}

        described = blob(configuration(plain.checksum.hexdigest(), version), "config")
        manifest = blob({"schemaVersion": 2, "mediaType": "application/vnd.oci.image.manifest.v1+json",
                         "config": described, "layers": [{
                             "mediaType": "application/vnd.oci.image.layer.v1.tar+gzip", "size": compressed.size,
                             "digest": "sha256:" + compressed.checksum.hexdigest()}]}, "manifest")
        manifest["annotations"] = {"org.opencontainers.image.ref.name": f"{NAME}:{version}"}
        blobs["oci-layout"] = json.dumps({"imageLayoutVersion": "1.0.0"}).encode()
        blobs["index.json"] = json.dumps({"schemaVersion": 2, "manifests": [manifest]}).encode()
        new = Path(folder) / "archive"
        with tarfile.open(new, "w") as archive:
            for name, data in blobs.items():
                entry = tarfile.TarInfo(name)
                entry.size, entry.mode = len(data), 0o644
                archive.addfile(entry, io.BytesIO(data))
            archive.add(packed, f"blobs/sha256/{compressed.checksum.hexdigest()}")
        new.replace(path)


def make_root(root, suite, of_this_machine):
    """Fills an empty folder with the image's files."""
    if of_this_machine:
        root_of_this_machine(root, suite)
    else:
        debian_root(root, suite)
    suite.copy_to(root)


def version_of(share):
    return re.search(r"<version>([^<]+)</version>", (share / "package.xml").read_text(encoding="utf-8")).group(1)


def main():
    """@return the exit status"""
    parser = argparse.ArgumentParser(prog="edge_image", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prefix", type=Path, required=True, metavar="DIR", help="install space of the suite")
    parser.add_argument("--output", type=Path, default=Path("edge_server.oci.tar"), metavar="FILE",
                        help="default: %(default)s")
    parser.add_argument("--root-of-this-machine", action="store_true", help="copies libraries; no packages")
    options = parser.parse_args()
    try:
        suite = Suite.installed(options.prefix.absolute())
        output = options.output.absolute()
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="edge_image_", dir=output.parent) as folder:
            root = Path(folder) / "root"
            root.mkdir(mode=0o755)
            make_root(root, suite, options.root_of_this_machine)
            if not options.root_of_this_machine:
                check(root)
            version = version_of(suite.shares["pi_offload"])
            write_archive(root, output, version)
        print(f"{NAME}:{version} is in {output}, {output.stat().st_size / 1e6:.0f} MB. podman load -i {output}")
        return 0
    except ToolError as error:
        print(f"edge_image: {error}", file=sys.stderr)
    except OSError as error:
        print(f"edge_image: {error.filename}: {error.strerror}", file=sys.stderr)
    return 1
