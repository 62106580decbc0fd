"""pi_edge new service: writes a working package, outside the suite, that vehicle.launch can start."""

import re
import sys
from pathlib import Path


class NewServiceError(Exception):
    """What is wrong, with its value and the way out."""


def template_folder(package_folder):
    return Path(package_folder) / "templates" / "service"


def check_name(name):
    """Names of packages: lower case, as catkin asks for; here also a C++ namespace."""
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name):
        raise NewServiceError("NAME = %s, must be lower case letters, digits and single underscores, as lane_keeper" % name)


def write_service(name, folder, template):
    """Writes the package NAME into FOLDER/NAME. @return its folder"""
    check_name(name)
    target = Path(folder) / name
    if target.exists():
        raise NewServiceError("%s is there already: choose another NAME or --folder" % target)
    if not Path(template).is_dir():
        raise NewServiceError("%s is missing: install the suite again" % template)
    words = {"@NAME@": name, "@CLASS@": "".join(word.capitalize() for word in name.split("_")),
             "@THREAD@": name[:15]}  # the kernel's limit for names of threads
    try:
        for source in sorted(Path(template).rglob("*.in")):
            file = target / str(source.relative_to(template))[:-len(".in")].replace("NAME", name)
            text = source.read_text(encoding="utf-8")
            for word, value in words.items():
                text = text.replace(word, value)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise NewServiceError("%s cannot be written: %s; give another --folder" % (target, error.strerror)) from error
    return target


def main(options, package_folder):
    """@return the exit status"""
    try:
        folder = write_service(options.name, options.folder, template_folder(package_folder))
    except NewServiceError as error:
        print("pi_edge new service: %s" % error, file=sys.stderr)
        return 1
    print("Wrote %s; its README.md says how to build it and how it joins the vehicle." % folder)
    return 0
