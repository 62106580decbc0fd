"""Fetches public networks for pi_detect and describes them.

  fetch_models --list
  fetch_models fast accurate

Every file is checked by its published sum before it gets its name. An interrupted download goes on at the next start.
Beside the files of each model lies its description MODEL.yaml, which the nodes and tools of pi_detect take; fast and
accurate have theirs in the package, and the nodes take them by these names. Exit
status: 0; 1 if something could not be fetched; 2 for a wrong command line; 128 + number of the signal that ended it.
"""

import argparse
import contextlib
import fcntl
import os
import signal
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

from pi_detect import downloads, model_catalogue
from pi_detect.errors import ToolError

REFRESH_S = 0.2  # of the progress line


class _Ended(BaseException):
    """By a signal."""

    def __init__(self, number):
        super().__init__()
        self.number = number


class Progress:
    """One line on a terminal about the current download; elsewhere nothing until it is done."""

    def __init__(self, stream):
        self._stream = stream
        self._is_terminal = stream.isatty()
        self._name, self._began, self._first, self._shown = "", 0.0, None, 0.0

    def begin(self, name):
        self._name, self._began, self._first, self._shown = name, time.monotonic(), None, 0.0

    def update(self, done, total):
        now = time.monotonic()
        if self._first is None:
            self._first = done
        if not self._is_terminal or now - self._shown < REFRESH_S:
            return
        self._shown = now
        rate = (done - self._first) / 1e6 / max(now - self._began, 1e-3)
        share = f" of {total / 1e6:.1f} MB, {100 * done // total} %" if total else " MB"
        self._stream.write(f"\r{self._name}: {done / 1e6:.1f}{share}, {rate:.1f} MB/s\x1b[K")
        self._stream.flush()

    def end(self):
        """Clears the line."""
        if self._is_terminal and self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def _holds(folder, sums):
    """Whether a folder has all the files of a dict file name -> sha256."""
    try:
        return all(not downloads.mismatch(folder / name, {"sha256": sha256}) for name, sha256 in sums.items())
    except OSError:
        return False


class Fetcher:
    """Brings models to a folder."""

    def __init__(self, folder, offline=None, mirror=None, progress=None, patience=None):
        """@param folder   where the models are kept
        @param offline  folder that has the downloads already; None: from servers
        @param mirror   address that stands for the catalogue's, with the same file names; None: the catalogue's
        @param patience  downloads.Patience with servers
        """
        self.folder = folder
        self._offline = offline
        self._mirror = mirror
        self._progress = progress or Progress(sys.stderr)
        self._patience = patience or downloads.Patience()

    def is_there(self, model):
        """Whether the description and all files with the sums in it are there."""
        if model.described_in is None:
            choices = [sums for sums in model_catalogue.described_sums(self.description(model))
                       if set(sums) == {file.name for file in model.files}]
            return any(_holds(self.folder, sums) for sums in choices)
        return any(_holds(folder, sums) for sums in model_catalogue.described_sums(model.described_in)
                   for folder in [self.folder, *model_catalogue.weights_folders()])

    def fetch(self, model):
        """@return path of the description @throws ToolError @throws OSError"""
        for file in model.files:
            self._fetch_file(file)
        path = self.description(model)
        if model.described_in is not None:
            return path
        sums = {file.name: downloads.sums_of(self.folder / file.name, ("sha256",))["sha256"] for file in model.files}
        part = downloads.part_of(path)
        part.write_text(model_catalogue.describe(model, sums), encoding="utf-8")
        os.replace(part, path)
        return path

    def description(self, model):
        return model.described_in or self.folder / f"{model.name}.yaml"

    def _fetch_file(self, file):
        path = self.folder / file.name
        sums = file.member_sums if file.member else file.sums
        if sums and path.is_file() and not downloads.mismatch(path, sums):
            return
        if self._offline is not None:
            self._take_offline(file, path)
        elif not file.member:
            self._download(file, path)
        else:
            archive = self.folder / file.download_name
            if not archive.is_file() or downloads.mismatch(archive, file.sums):
                self._download(file, archive)
            downloads.extract(archive, file.member, path, file.member_sums)
            archive.unlink()

    def _download(self, file, path):
        urls = [f"{self._mirror.rstrip('/')}/{file.download_name}"] if self._mirror else file.urls
        self._progress.begin(file.download_name)
        try:
            downloads.download(urls, path, file.sums, file.size, self._progress.update, self._patience)
        finally:
            self._progress.end()

    def _take_offline(self, file, path):
        download = self._offline / file.download_name
        if download.is_file() and file.member:
            wrong = downloads.mismatch(download, file.sums)
            if wrong:
                raise ToolError(f"{download}: {wrong}: it is not the published file, get another copy")
            downloads.extract(download, file.member, path, file.member_sums)
        elif download.is_file():
            downloads.copy(download, path, file.sums)
        elif file.member_sums and (self._offline / file.name).is_file():
            downloads.copy(self._offline / file.name, path, file.member_sums)
        else:
            raise ToolError(f"{download} is not there: get it from {file.urls[0]}")


@contextlib.contextmanager
def claim(folder):
    """Makes the folder and holds it against other runs. @throws ToolError"""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / ".fetch_models.lock", "w", encoding="utf-8")
    except OSError as error:
        raise ToolError(f"--output {folder}: {error.strerror or error}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ToolError(f"{folder} is in use by another fetch_models: wait for it, or choose another "
                            "--output") from error
        yield


def default_catalogue():
    """Beside the sources, or in share/ of an install space, where this module's program lies in lib/pi_detect."""
    program = Path(sys.argv[0]).resolve()
    candidates = [Path(__file__).resolve().parents[2] / "config" / "models" / "catalogue.yaml",
                  program.parents[2] / "share" / "pi_detect" / "config" / "models" / "catalogue.yaml"]
    return next((path for path in candidates if path.is_file()), candidates[-1])


def _mirror(text):
    parts = urlsplit(text)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        raise argparse.ArgumentTypeError(f"'{text}', must be an http(s) address")
    return text


def _seconds(text):
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"'{text}', must be a number of seconds above 0")
    return value


def parse(arguments):
    parser = argparse.ArgumentParser(prog="fetch_models", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", metavar="MODEL", help="names of --list")
    parser.add_argument("--all", action="store_true", help="all models of the catalogue")
    parser.add_argument("--list", action="store_true", help="show the models and whether they are there")
    parser.add_argument("--missing", action="store_true", help="print those that are not there, and fetch nothing")
    parser.add_argument("--output", type=Path, default=model_catalogue.default_output(), metavar="FOLDER",
                        help="where the models are kept; default: %(default)s")
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--from", type=Path, dest="offline", metavar="FOLDER",
                        help="take the downloads from this folder, without network")
    source.add_argument("--mirror", type=_mirror, metavar="ADDRESS",
                        help="get ADDRESS/FILE in place of the catalogue's addresses")
    parser.add_argument("--catalogue", type=Path, default=default_catalogue(), metavar="FILE",
                        help="list of models; default: %(default)s")
    parser.add_argument("--patience", type=_seconds, metavar="S",
                        help="give up after S seconds in a row without a byte; default: several tries per address")
    line = parser.parse_args(arguments)
    if not line.list and not line.all and not line.models:
        parser.error("nothing to do: name models, or give --all or --list")
    return line


def show(catalogue, fetcher):
    for name, model in catalogue.items():
        size = sum(file.size for file in model.files)
        known = f"{size / 1e6:6.1f} MB" if all(file.size for file in model.files) else "  size ?"
        there = "there" if fetcher.is_there(model) else ""
        print(f"{name:28} {known:>9}  {there:5}  {model.title}")


def run(line):
    """@return the exit status @throws ToolError"""
    catalogue = model_catalogue.load_catalogue(line.catalogue)
    for name in line.models:
        if name not in catalogue:
            raise ToolError(f"{line.catalogue} has no model {name}; it has {', '.join(catalogue)}")
    fetcher = Fetcher(line.output, line.offline, line.mirror, patience=downloads.Patience(line.patience))
    names = list(catalogue) if line.all else list(dict.fromkeys(line.models))
    if line.list:
        show(catalogue, fetcher)
        return 0
    if line.missing:
        print("".join(f"{name}\n" for name in names if not fetcher.is_there(catalogue[name])), end="")
        return 0
    status = 0
    with claim(line.output):
        for name in names:
            try:
                note = "is there already" if fetcher.is_there(catalogue[name]) else ""
                path = fetcher.description(catalogue[name]) if note else fetcher.fetch(catalogue[name])
                print(f"{name}: {note or 'fetched'}: {path}")
            except ToolError as error:
                print(f"fetch_models: {name}: {error}", file=sys.stderr)
                status = 1
    return status


def _end(number, _frame):
    raise _Ended(number)


def main(arguments=None):
    """@return the exit status"""
    line = parse(arguments)
    before = {number: signal.signal(number, _end) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        return run(line)
    except ToolError as error:
        print(f"fetch_models: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"fetch_models: {error.filename or line.output}: {error.strerror or error}", file=sys.stderr)
        return 1
    except _Ended as ended:
        print(f"fetch_models: ended by {signal.Signals(ended.number).name}: what came so far is kept, start again to "
              "go on", file=sys.stderr)
        return 128 + ended.number
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
