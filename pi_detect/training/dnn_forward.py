"""Builds and calls forward_pictures.cpp: networks run in OpenCV's dnn module, where they are deployed."""

import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np

LIBRARIES = ("opencv_core", "opencv_imgcodecs", "opencv_dnn")


def build(folder):
    """Compiles forward_pictures.cpp into the folder unless a newer program is there; returns its path."""
    source = Path(__file__).with_name("forward_pictures.cpp")
    program = Path(folder) / "forward_pictures"
    if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
        program.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(["/usr/bin/g++", "-std=c++17", "-O2", "-I/usr/include/opencv4", str(source), "-o", str(program),
                        *[f"-l{name}" for name in LIBRARIES]], check=True)
    return program


def forward(program, model, pictures, size, threads=2):
    """Runs the network over picture files stretched to size x size, RGB, (value - 127.5) / 127.5.

    @return (dict output name -> array with one entry per picture, dict of forward times in ms)
    @throws RuntimeError with the program's message if the network or a picture cannot be used
    """
    with tempfile.TemporaryDirectory() as folder:
        listing = Path(folder) / "pictures.txt"
        listing.write_text("".join(f"{path}\n" for path in pictures))
        done = subprocess.run([program, f"--model={model}", f"--pictures={listing}", f"--output={folder}/",
                               f"--size={size}", f"--threads={threads}"], capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{model}: {done.stderr.strip() or 'ended with status %d' % done.returncode}")
        outputs = {path.stem: np.load(path) for path in Path(folder).glob("*.npy")}
    return outputs, json.loads(done.stdout.strip().splitlines()[-1])
