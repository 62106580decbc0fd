"""Makes a container image: of an edge node (edge_server, its models, nats-server), or of the whole vehicle, and of what
they need of Debian.

The root file system is made by mmdebstrap from the Debian packages that own the programs' libraries; nothing comes from
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
from pi_offload.interrupts import end_by_signals

PREFIX = Path("/opt/pi_edge")
USER = 10001
SPEECH_MODEL = "pocketsphinx-en-us"
PROGRAMS = ("pi_offload/edge_server", "pi_detect/check_model", "pi_speech/check_speech_model")
SHARES = ("pi_detect", "pi_offload", "pi_speech")
UNNEEDED = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*", "/usr/include/*",
            "/usr/lib/*.a")
NEEDED = ("/usr/lib/gcc/*/libgcc.a", "/usr/lib/*/libc_nonshared.a")  # nevertheless: PoCL links kernels with them
CONFIGURATION = "/etc/pi_edge/edge_server.yaml"
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "XDG_DATA_HOME": f"{PREFIX}/share", "LC_ALL": "C.UTF-8"}
# What a program that ends early leaves mounted or running is not seen by anybody else, and ends with it. As root
# mmdebstrap mounts /proc, /sys and parts of /dev, which must not be there when the folder is removed.
ALONE = ("unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc")
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


def libraries(programs):
    """What the programs load, as paths that the loader sees. @throws ToolError"""
    text = run(["ldd", *programs], "libc-bin")
    missing = sorted(set(re.findall(r"^\s*(\S+) => not found", text, re.MULTILINE)))
    if missing:
        raise ToolError(f"{programs[0].parent} does not find {', '.join(missing)}: build the suite, and source its "
                        "setup.sh")
    return sorted({Path(path) for path in re.findall(r"(/\S+) \(0x", text)})


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


def copy_networks(folder):
    """The public networks, if they are here; without them the suite's own stands in."""
    weights = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share") / "pi_detect/models"
    if weights.is_dir():
        shutil.copytree(weights, folder / "share/pi_detect/models")


class EdgeNode:
    """The files of the suite that the image of an edge node holds, and how it starts."""

    name = "pi_edge/edge_server"
    output = "edge_server.oci.tar"
    packages = (SPEECH_MODEL, "nats-server")      # beside those of the libraries
    ports = (5680, 5681)
    home = None
    environment = {**ENVIRONMENT, "LD_LIBRARY_PATH": f"{PREFIX}/lib", "ROS_HOME": "/tmp"}
    entry_point = [f"{PREFIX}/lib/pi_offload/edge_server"]
    arguments = ["--config", CONFIGURATION]
    check = [*entry_point, *arguments, "--check"]  # finds a library or model that is missing

    def __init__(self, library_folder, shares):
        """@param library_folder  of an install or devel space. @param shares  {package: folder with its config}"""
        self.programs, self.shares = {name: library_folder / name for name in PROGRAMS}, shares
        missing = [str(program) for program in self.programs.values() if not program.is_file()]
        if missing:
            raise ToolError(f"{missing[0]} is missing: call make build, or give the install space as --prefix")
        found = libraries(list(self.programs.values()))
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
        copy_networks(folder)
        configuration = root / CONFIGURATION[1:]
        configuration.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(self.shares["pi_offload"] / "config/edge_server.yaml", configuration)


def installed():
    """Names of the Debian packages of this machine."""
    listed = run(["dpkg-query", "--show", "--showformat", "${db:Status-Status} ${Package}\\n"], "dpkg")
    return {line.partition(" ")[2] for line in listed.splitlines() if line.startswith("installed ")}


def run_time_packages(control):
    """What the suite's Debian packages but pi-edge-dev depend on, by their debian/control; not the suite's own.
    @throws ToolError"""
    try:
        paragraphs = control.read_text(encoding="utf-8").split("\n\n")
    except OSError as error:
        raise ToolError(f"--control {control}: {error.strerror}; it must be the suite's debian/control") from error
    own, needed, here = set(), set(), installed()
    for paragraph in paragraphs:
        package = re.search(r"^Package: *(\S+)", paragraph, re.MULTILINE)
        depends = re.search(r"^Depends:((?:.|\n )*)", paragraph, re.MULTILINE)
        if package:
            own.add(package[1])
        if package and depends and not package[1].endswith("-dev"):
            for item in depends[1].split(","):  # of alternatives the first that is here
                names = re.findall(r"(?:^|\|)\s*([a-z0-9][a-z0-9.+-]+)", item)
                needed.update([*(name for name in names if name in here), *names][:1])
    if not needed - own:
        raise ToolError(f"--control {control} names no package that the suite needs at run time")
    return sorted(needed - own)


class Vehicle:
    """The whole install space and what its programs need, and how the demo starts."""

    name = "pi_edge/vehicle"
    output = "vehicle.oci.tar"
    ports = (8890,)
    home = "/home/pi_edge"  # of the user: ROS makes its logs only in a folder of the same group
    environment = {**ENVIRONMENT, "HOME": home, "USER": "pi_edge", "ROS_HOSTNAME": "localhost",
                   "PYTHONUNBUFFERED": "1", "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1"}  # what nodes say is seen at once
    entry_point = [f"{PREFIX}/run"]
    arguments = ["pi_edge", "demo", "--output", f"{home}/report"]
    check = [*entry_point, "sh", "-c", "roslaunch --nodes pi_bringup simulation.launch && "  # finds all launch files
             "POCL_CACHE_DIR=$(mktemp -d) && export POCL_CACHE_DIR && trap 'rm -r \"$POCL_CACHE_DIR\"' EXIT && "
             "python3 -m pi_bringup.doctor.opencl_probe"]  # compiles a kernel
    left_out = ("include", "pkgconfig", "cmake", "common-lisp", "gennodejs", "roseus", "*.a", ".rosinstall",
                "__pycache__")  # what compilers need

    def __init__(self, prefix, control):
        """@param prefix  the install space. @param control  debian/control, which names what is needed at run time"""
        if not (prefix / "setup.sh").is_file():
            raise ToolError(f"{prefix / 'setup.sh'} is missing: call make build, or give the install space as --prefix")
        self.prefix, self.packages = prefix, run_time_packages(control)
        self.system = [path for path in libraries(self.programs()) if not path.is_relative_to(prefix)]

    def programs(self):
        """Programs and libraries of the space."""
        found = [path for path in sorted((self.prefix / "lib").rglob("*")) if path.is_file() and not path.is_symlink()]
        return [path for path in found if is_elf(path)]

    def copy_to(self, root):
        folder = root / str(PREFIX)[1:]
        shutil.copytree(self.prefix, folder, symlinks=True, ignore=shutil.ignore_patterns(*self.left_out))
        for path in folder.rglob("*"):
            if path.is_file() and not path.is_symlink() and not is_elf(path):
                content = path.read_bytes()
                moved = content.replace(os.fsencode(self.prefix), os.fsencode(PREFIX))
                if moved != content:  # the set-up files name the folder of the space
                    path.write_bytes(moved)
        copy_networks(folder)
        (root / self.home[1:]).mkdir(parents=True)
        hosts = root / "etc/hosts"  # runc makes none
        hosts.parent.mkdir(exist_ok=True)
        hosts.write_text("127.0.0.1 localhost\n", encoding="utf-8")
        # A function: setup.sh looks at the arguments of whoever reads it.
        write_script(folder / "run", f'set_up()\n{{\n  . {PREFIX}/setup.sh\n}}\nset_up\nexec "$@"\n')
        write_script(root / "usr/bin/pi_edge", f'exec {PREFIX}/run {PREFIX}/lib/pi_bringup/pi_edge "$@"\n')


def write_script(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + lines, encoding="utf-8")
    path.chmod(0o755)


def is_elf(path):
    with path.open("rb") as file:
        return file.read(4) == b"\x7fELF"


def debian_root(root, contents):
    """Fills the folder with Debian's packages."""
    sources = [path for path in (Path("/etc/apt/sources.list"), *sorted(Path("/etc/apt/sources.list.d").glob("*")))
               if path.suffix in (".list", ".sources") and path.is_file() and path.stat().st_size > 0]
    if not sources:
        raise ToolError("/etc/apt names no source of Debian packages: mmdebstrap needs one")
    if not shutil.which("mmdebstrap"):
        raise ToolError("mmdebstrap is missing: apt-get install mmdebstrap")
    names = [*packages(contents.system), *contents.packages]
    run([*(ALONE if os.geteuid() == 0 else ()), "mmdebstrap", "--variant=essential", "--include=" + ",".join(names),
         "--aptopt=APT::Install-Recommends \"false\"", *(f"--dpkgopt=path-exclude={path}" for path in UNNEEDED),
         *(f"--dpkgopt=path-include={path}" for path in NEEDED),
         platform.freedesktop_os_release()["VERSION_CODENAME"], root, *sources], "util-linux")


def root_of_this_machine(root, contents):
    """Fills the folder with this machine's libraries and models, where the loader sees them here."""
    for name in ("lib", "lib64"):
        (root / "usr" / name).mkdir(parents=True)
        (root / name).symlink_to(f"usr/{name}")
    for name in ("tmp", "proc", "dev", "sys", "etc"):
        (root / name).mkdir()
    for path in contents.system:
        target = root / str(path)[1:]
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)
    for path in run(["dpkg-query", "--listfiles", SPEECH_MODEL], "dpkg").split():
        if Path(path).is_file() and "/doc/" not in path:
            (root / path[1:]).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, root / path[1:])


def check(root, contents):
    """Starts the image's program for a moment: what it does not find is known now."""
    if os.geteuid() == 0:  # the program finds its models by /proc, OpenCL its cores by /sys
        run([*ALONE[:-1], f"--mount-proc={root}/proc", "sh", "-c", 'mount --rbind /sys "$0/sys" && exec chroot "$0" "$@"',
             root, "/usr/bin/env", "-i",
             *variables(contents), *contents.check], "util-linux")


def variables(contents):
    return [f"{name}={value}" for name, value in contents.environment.items()]


def configuration(contents, layer, version):
    """OCI's description of the image."""
    return {"architecture": ARCHITECTURES.get(platform.machine(), platform.machine()), "os": "linux",
            "config": {"User": f"{USER}:{USER}", "Env": variables(contents),
                       "Entrypoint": contents.entry_point, "Cmd": contents.arguments, "WorkingDir": "/",
                       "StopSignal": "SIGTERM", "ExposedPorts": {f"{port}/tcp": {} for port in contents.ports},
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


def write_archive(root, path, contents, version):
    """Packs a root file system into an archive of OCI's image layout. All is root's but the user's home."""
    def owned(entry):
        entry.uid = entry.gid = USER if contents.home and entry.name == "." + contents.home else 0
        entry.uname = entry.gname = "" if entry.uid else "root"
        return None if entry.ischr() or entry.isblk() else entry

    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        packed = Path(folder) / "layer"
        with open(packed, "wb") as file:
            compressed = _Hashing(file)
            with gzip.GzipFile(fileobj=compressed, mode="wb", compresslevel=1, mtime=0) as zipped:
                plain = _Hashing(zipped)
                with tarfile.open(fileobj=plain, mode="w|", format=tarfile.PAX_FORMAT) as layer:
                    layer.add(root, ".", filter=owned)
        blobs = {}

        def blob(tree, kind):
            data = json.dumps(tree).encode()
            digest = hashlib.sha256(data).hexdigest()
            blobs[f"blobs/sha256/{digest}"] = data
            return {"mediaType": f"application/vnd.oci.image.{kind}.v1+json", "digest": "sha256:" + digest,
                    "size": len(data)}

        described = blob(configuration(contents, plain.checksum.hexdigest(), version), "config")
        manifest = blob({"schemaVersion": 2, "mediaType": "application/vnd.oci.image.manifest.v1+json",
                         "config": described, "layers": [{
                             "mediaType": "application/vnd.oci.image.layer.v1.tar+gzip", "size": compressed.size,
                             "digest": "sha256:" + compressed.checksum.hexdigest()}]}, "manifest")
        manifest["annotations"] = {"org.opencontainers.image.ref.name": f"{contents.name}:{version}"}
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


def make_root(root, contents, of_this_machine):
    """Fills an empty folder with the image's files."""
    if of_this_machine:
        root_of_this_machine(root, contents)
    else:
        debian_root(root, contents)
    contents.copy_to(root)


def version_of(share):
    return re.search(r"<version>([^<]+)</version>", (share / "package.xml").read_text(encoding="utf-8")).group(1)


def size_of(root):
    """Bytes of its files."""
    return sum(path.lstat().st_size for path in root.rglob("*") if path.is_file() and not path.is_symlink())


def main():
    """@return the exit status"""
    parser = argparse.ArgumentParser(prog="edge_image", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--prefix", type=Path, required=True, metavar="DIR", help="install space of the suite")
    parser.add_argument("--target", choices=("edge", "vehicle"), default="edge", help="default: %(default)s")
    parser.add_argument("--control", type=Path, metavar="FILE", help="of a vehicle: the suite's debian/control, which "
                        "names the packages that its programs need")
    parser.add_argument("--output", type=Path, metavar="FILE", help="or folder; default: edge_server.oci.tar or "
                        "vehicle.oci.tar")
    parser.add_argument("--root-of-this-machine", action="store_true", help="copies libraries; no packages; not of a "
                        "vehicle")
    options = parser.parse_args()
    end_by_signals()
    is_vehicle = options.target == "vehicle"
    if is_vehicle and (not options.control or options.root_of_this_machine):
        parser.error("--target vehicle needs --control FILE, and no --root-of-this-machine")
    try:
        prefix = options.prefix.resolve()
        contents = Vehicle(prefix, options.control) if is_vehicle else EdgeNode.installed(prefix)
        output = (options.output or Path()).absolute()
        output = output / contents.output if output.is_dir() else output
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix="edge_image_", dir=output.parent) as folder:
            root = Path(folder) / "root"
            root.mkdir(mode=0o755)
            make_root(root, contents, options.root_of_this_machine)
            if not options.root_of_this_machine:
                check(root, contents)
            version = version_of(prefix / "share/pi_offload")
            write_archive(root, output, contents, version)
            size = size_of(root)
        print(f"{contents.name}:{version} is in {output}, {output.stat().st_size / 1e6:.0f} MB, {size / 1e6:.0f} MB "
              f"unpacked. podman load -i {output}")
        return 0
    except ToolError as error:
        print(f"edge_image: {error}", file=sys.stderr)
    except OSError as error:
        print(f"edge_image: {error.filename}: {error.strerror}", file=sys.stderr)
    except KeyboardInterrupt:
        return 130
    return 1
