"""Checks of what is plugged in: serial ports, cameras, microphones."""

import grp
import os
from pathlib import Path

from pi_bringup.doctor.result import fail, ok, warn

SERIAL = ("ttyUSB*", "ttyACM*", "ttyTHS*", "ttyAMA*")
UNKNOWN_GROUP = "?"


def _group(path):
    try:
        return grp.getgrgid(path.stat().st_gid).gr_name
    except (KeyError, OSError):
        return UNKNOWN_GROUP


def _rights(name, what, paths, wish):
    """The result for devices that there are."""
    closed = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    shown = ", ".join(path.name for path in paths)
    if closed:
        group = _group(closed[0])
        return fail(name, f"{closed[0].name} may not be opened",
                    f"usermod -aG {group if group not in ('root', UNKNOWN_GROUP) else wish} $USER, then log in again")
    return ok(name, f"{len(paths)} {what}: {shown}")


def check_serial_ports(root="/", port=None):
    """@param port  that of the chassis, if it is known."""
    name = "serial ports"
    folder = Path(root) / "dev"
    if port:
        path = Path(root) / port.lstrip("/") if "/" in port else folder / port
        if not path.exists():
            return fail(name, f"{port} is not there", "plug the chassis in; dmesg shows the name that it gets")
        return _rights(name, "port", [path], "dialout")
    paths = sorted(path for pattern in SERIAL for path in folder.glob(pattern))
    if not paths:
        return warn(name, "there is none", "plug the chassis in; the simulated one needs none")
    return _rights(name, "port(s)", paths, "dialout")


def check_cameras(root="/"):
    name = "cameras"
    paths = sorted((Path(root) / "dev").glob("video*"))
    if not paths:
        return warn(name, "there is no /dev/video*", "plug cameras in; network cameras and recordings need none")
    result = _rights(name, "device(s)", paths, "video")
    names = []
    for path in paths:
        try:
            label = Path(root) / "sys/class/video4linux" / path.name / "name"
            names.append(label.read_text(encoding="utf-8").strip())
        except OSError:
            pass
    if result.level == "OK" and names:
        result.text += f" ({', '.join(sorted(set(names)))})"
    return result


def check_microphones(root="/"):
    name = "microphones"
    root = Path(root)
    paths = sorted((root / "dev/snd").glob("pcmC*D*c"))
    if not paths:
        return warn(name, "ALSA has no device that records", "plug a microphone in; recordings need none")
    result = _rights(name, "device(s) of ALSA", paths, "audio")
    try:
        cards = [line.rpartition(": ")[2].strip() for line in
                 (root / "proc/asound/cards").read_text(encoding="utf-8").splitlines() if "]:" in line]
    except OSError:
        cards = []
    if result.level == "OK" and cards:
        result.text += f" ({', '.join(cards)})"
    return result
