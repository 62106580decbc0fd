"""What the training needs: programs, models, and the suite's own tools."""

import os
import shutil
import subprocess
from pathlib import Path

import package_path  # noqa: F401: leads to pi_speech

from pi_speech.errors import ToolError

MODELS = Path("/usr/share/pocketsphinx/model/en-us")
ACOUSTIC_MODEL = MODELS / "en-us"
DICTIONARY = MODELS / "cmudict-en-us.dict"
LANGUAGE_MODEL = MODELS / "en-us.lm.bin"
BAUM_WELCH = Path("/usr/lib/sphinxtrain/bw")
PROGRAMS = {"flac": "flac", "pocketsphinx_batch": "pocketsphinx", "pocketsphinx_mdef_convert": "pocketsphinx",
            str(BAUM_WELCH): "sphinxtrain"}  # program -> Debian package
FILES = {ACOUSTIC_MODEL / "mdef": "pocketsphinx-en-us", DICTIONARY: "pocketsphinx-en-us"}
PACKAGES = ("flac", "pocketsphinx", "pocketsphinx-en-us", "python3-numpy", "sphinxtrain")
TOOLS = ("recognize_files",)


def missing_packages(programs=None, files=None):
    """@return Debian packages that lack, sorted"""
    programs, files = PROGRAMS if programs is None else programs, FILES if files is None else files
    return sorted({package for program, package in programs.items() if not shutil.which(program)}
                  | {package for path, package in files.items() if not Path(path).is_file()})


def check_packages():
    """@throws ToolError naming all that lack"""
    missing = missing_packages()
    if missing:
        raise ToolError(f"not installed: {', '.join(missing)}; apt-get install {' '.join(missing)}")


def find_tools(folder=None):
    """The suite's tools, in a folder or else in the workspaces of CMAKE_PREFIX_PATH.
    @return name -> path. @throws ToolError"""
    if folder:
        folders = [Path(folder)]
    else:
        folders = [Path(prefix) / "lib/pi_speech" for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(":")
                   if prefix]
    tools = {}
    for name in TOOLS:
        paths = [path / name for path in folders if os.access(path / name, os.X_OK)]
        if not paths:
            where = str(folder) if folder else "the workspaces of CMAKE_PREFIX_PATH"
            raise ToolError(f"{name} is not in {where}; build the suite and source its setup.sh, or name the folder by "
                            "--tools")
        tools[name] = paths[0].resolve()
    return tools


def versions():
    """Debian package -> its version, "" where dpkg does not know it."""
    found = {}
    for package in PACKAGES:
        done = subprocess.run(["dpkg-query", "-W", "-f=${Version}", package], capture_output=True, text=True)
        found[package] = done.stdout if done.returncode == 0 else ""
    return found
