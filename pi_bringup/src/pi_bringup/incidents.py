"""pi_edge incidents: lists what the recorder kept of incidents, and makes the drive's report of one."""

import os
import sys
from pathlib import Path

FOLDER = Path("~/.ros/pi_edge/recordings")
INCIDENT_TYPE = "pi_vehicle/Incident"


def add_to(commands):
    """Adds the command to pi_edge."""
    command = commands.add_parser("incidents", help="lists the recorded incidents; makes a report of one",
                                  description=__doc__)
    command.add_argument("--folder", type=Path, default=FOLDER, help="of the recorder; default: %(default)s")
    report = command.add_subparsers(dest="what").add_parser("report", help="an HTML page of one incident")
    report.add_argument("file", type=Path, metavar="FILE", help="bag of an incident, or of the continuous recording")
    report.add_argument("--output", type=Path, metavar="PAGE", help="default: FILE's name with .html, here")


def triggers_in(bag):
    """[(time, cause, text)] of an open bag, by time."""
    topics = [topic for topic, one in bag.get_type_and_topic_info().topics.items() if one.msg_type == INCIDENT_TYPE]
    return sorted({(message.header.stamp.to_sec(), message.cause, message.text)
                   for _, message, _ in bag.read_messages(topics)}) if topics else []


def errors_of_bags():
    """What rosbag raises for files that are no bags, or damaged."""
    import struct
    import rosbag
    return (rosbag.ROSBagException, OSError, ValueError, struct.error)


def describe(path):
    """A row of the list: when, cause, duration, size, path."""
    import rosbag  # here: doctor must start where ROS is broken
    size = "%.1f MB" % (path.stat().st_size / 1e6)
    if path.suffix != ".bag":
        return [path.name.split("_")[1], "is being written, or awaits its recovery", "", size, str(path)]
    try:
        with rosbag.Bag(str(path)) as bag:
            causes = list(dict.fromkeys(cause for _, cause, _ in triggers_in(bag)))
            return [path.name.split("_")[1], ", ".join(causes) or "unknown",
                    "%.1f s" % (bag.get_end_time() - bag.get_start_time()), size, str(path)]
    except errors_of_bags() as error:
        return [path.name.split("_")[1], "not readable: %s" % error, "", size, str(path)]


def rows(folder):
    """Rows of texts, the header first. @throws OSError"""
    names = sorted(name for name in os.listdir(folder)
                   if name.startswith("incident_") and name.endswith((".bag", ".bag.active")))
    return [["time", "cause", "duration", "size", "file"]] + [describe(folder / name) for name in names]


def main(options):
    """@return the exit status"""
    from campus_drive import incident
    from first_drive.errors import DemoError
    from first_drive.report import table
    try:
        if options.what == "report":
            print("Wrote %s" % incident.write_report(
                options.file, options.output or Path(options.file.name).with_suffix(".html")))
            return 0
        folder = options.folder.expanduser()
        if not folder.is_dir():
            raise DemoError("%s is no folder: the recorder has not run, or records elsewhere: give --folder" % folder)
        found = rows(folder)
        print(table(found, "<<>><") if len(found) > 1 else "no incident in %s" % folder)
        return 0
    except (DemoError, OSError) as error:
        print("pi_edge incidents: %s" % error, file=sys.stderr)
        return 1
