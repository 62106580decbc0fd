"""Work in steps: those that are done are not done again when a run is started once more."""

import fcntl
import json
import subprocess
import time

import package_path  # noqa: F401: leads to pi_speech

from pi_speech.errors import ToolError


class Steps:
    """Steps of one run in its work folder. A step is done when its mark is there, which holds what it returned."""

    def __init__(self, work, settings, total, show=print):
        """@param settings  what all steps depend on, for JSON
        @param total  number of steps, for the progress
        @throws ToolError if the folder is of a run with other settings, or in use"""
        self.work, self.total, self.show = work, total, show
        self.number = 0
        self._marks, self._logs = work / "done", work / "logs"
        try:
            for folder in (self._marks, self._logs):
                folder.mkdir(parents=True, exist_ok=True)
            self._lock = open(work / "lock", "w")
        except OSError as error:
            raise ToolError(f"{work}: cannot be written: {error.strerror or error}") from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise ToolError(f"{work}: another run is at work there; wait for it, or give another folder by "
                            "--work") from None
        self._check_settings(json.loads(json.dumps(settings)))

    def close(self):
        self._lock.close()

    def _check_settings(self, settings):
        path = self.work / "settings.json"
        if not path.exists():
            self._write(path, settings)
            return
        before = json.loads(path.read_text())
        different = sorted(name for name in {**before, **settings} if before.get(name) != settings.get(name))
        if different:
            self.close()
            raise ToolError(f"{self.work}: was begun with other {', '.join(different)}; give another folder by --work, "
                            "or remove this one")

    @staticmethod
    def _write(path, value):
        partial = path.with_name(path.name + ".partial")
        partial.write_text(json.dumps(value, indent=2) + "\n")
        partial.replace(path)

    def run(self, name, function, *arguments, again=False):
        """Does a step unless it is done.
        @param again  do it in any case
        @return what the function returned, which must fit into JSON"""
        self.number += 1
        mark = self._marks / f"{name}.json"
        title = f"{self.number:3d}/{self.total} {name.replace('_', ' ')}"
        if mark.exists() and not again:
            self.show(f"{title}: done before")
            return json.loads(mark.read_text())
        self.show(f"{title} ...")
        begin = time.monotonic()
        result = function(*arguments)
        self._write(mark, result)
        self.show(f"{title}: {time.monotonic() - begin:.0f} s")
        return result

    def call(self, name, command, **options):
        """Runs a program; what it says goes to logs/NAME.log. @return its standard output. @throws ToolError"""
        log = self._logs / f"{name}.log"
        with open(log, "w") as file:
            done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, stderr=file, text=True,
                                  **options)
            file.write(done.stdout)
        if done.returncode:
            lines = log.read_text(errors="replace").strip().splitlines()
            last = lines[-1] if lines else "no message"
            raise ToolError(f"{command[0]} ended with status {done.returncode}: {last}; see {log}")
        return done.stdout
