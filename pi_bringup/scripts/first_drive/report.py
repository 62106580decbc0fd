"""The report of all drives: on the terminal, as JSON and as a plot."""

import json
import os

from first_drive.drive import IMAGE_TOPIC
from first_drive.errors import DemoError

COLOURS = ["#1f8a70", "#bd4b4b"]


def table(rows, alignment):
    """rows: lists of texts, the header first; alignment: "<" or ">" per column."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(alignment))]
    lines = []
    for row in rows:
        cells = [cell.ljust(width) if side == "<" else cell.rjust(width)
                 for cell, width, side in zip(row, widths, alignment)]
        lines.append("  " + "  ".join(cells).rstrip())
    return "\n".join(lines)


def number(value, digits):
    return "-" if value is None else "%.*f" % (digits, value)


def latency(drive, topic, key):
    return ((drive.monitor["topics"].get(topic) or {}).get("latency_ms") or {}).get(key)


def seen_topics(drives):
    """Names of the topics of which some monitor saw a message."""
    return sorted({topic for drive in drives for topic, figures in drive.monitor["topics"].items()
                   if figures.get("messages", 0)})


def all_nodes(drives):
    return sorted({node for drive in drives for node in drive.cpu_s})


def topic_table(drives):
    header = ["topic"]
    for drive in drives:
        header += [drive.title + " Hz", "p50/ms", "p99/ms", "lost"]
    if len(drives) == 2:
        header += ["p50 ratio", "p99 ratio"]
    rows = [header]
    for topic in seen_topics(drives):
        row = [topic]
        for drive in drives:
            figures = drive.monitor["topics"].get(topic, {})
            row += [number(figures.get("rate_hz"), 1), number(latency(drive, topic, "p50"), 3),
                    number(latency(drive, topic, "p99"), 3), number(figures.get("lost"), 0)]
        if len(drives) == 2:
            for key in ("p50", "p99"):
                ours, theirs = latency(drives[0], topic, key), latency(drives[1], topic, key)
                row.append("%.1f" % (theirs / ours) if ours and theirs else "-")
        rows.append(row)
    return table(rows, "<" + ">" * (len(header) - 1))


def node_table(drives):
    header = ["node"]
    for drive in drives:
        header += [drive.title + " CPU", "private", "PSS"]
    rows = [header]
    for node in all_nodes(drives):
        row = [node]
        for drive in drives:
            memory = drive.memory.get(node) or {}
            row += [number(drive.cpu_s.get(node), 2), number(memory.get("private"), 1), number(memory.get("pss"), 1)]
        rows.append(row)
    total = ["all"]
    for drive in drives:
        total += [number(sum(drive.cpu_s.values()), 2), "", ""]
    return table(rows + [total], "<" + ">" * (len(header) - 1))


def link_table(drives):
    topics = seen_topics(drives)
    keys = sorted({link[:3] for drive in drives for link in drive.links
                   if link[0] in topics or link[0].startswith(("/tf", "/ground_truth"))})
    rows = [["topic", "from", "to"] + [drive.title for drive in drives]]
    for key in keys:
        rows.append(list(key) + [", ".join(link[3] for link in drive.links if link[:3] == key) or "-"
                                 for drive in drives])
    return table(rows, "<<<" + "<" * len(drives))


def print_report(drives, description, facts):
    print("\nFirst drive: %s" % description)
    print("Machine: %s, %d cores, %.1f GB, Linux %s, load %.1f at the start" %
          (facts["cpu"], facts["cores"], facts["memory_gb"], facts["kernel"], facts["load"]))
    for drive in drives:
        print("%-7s %.1f s; player behind its schedule by %.2f ms in the mean, %.1f ms at most" %
              (drive.title + ":", drive.played_s, drive.lateness.get("mean", 0.0),
               drive.lateness.get("max", 0.0)))
    print("\nTopics at the monitor: latency from hand-over (header stamp) to callback; TCPROS with tcpNoDelay")
    print(topic_table(drives))
    print("\nNodes: CPU seconds while playing, private and proportional memory in MB")
    print(node_table(drives))
    print("\nLinks of the sensor topics: transport as the publisher states it (getBusInfo)")
    print(link_table(drives))
    print()
    for drive in drives:
        recorded = {topic: drive.bag_counts.get(topic, 0) for topic in drive.published}
        print("%s: rosbag record holds %d of %d published messages%s; rospy peer got %s of %d pictures" %
              (drive.title, sum(recorded.values()), sum(drive.published.values()),
               ", every topic complete" if recorded == drive.published else "",
               drive.peer.get("messages", "no report"), drive.published.get(IMAGE_TOPIC, 0)))


def plot(drives, path):
    """Latency by topic and CPU time by node as PNG."""
    import matplotlib  # takes a second, which only the end of a drive needs
    matplotlib.use("Agg")
    from matplotlib import pyplot
    topics = [topic for topic in sorted(drives[0].monitor["topics"])
              if all(latency(drive, topic, "p50") for drive in drives)]
    nodes = all_nodes(drives)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(13, 5.5), gridspec_kw={"width_ratios": [3, 2]})
    height = 0.8 / len(drives)
    for index, (drive, colour) in enumerate(zip(drives, COLOURS)):
        offset = (index - (len(drives) - 1) / 2) * height
        positions = [row + offset for row in range(len(topics))]
        left.barh(positions, [latency(drive, topic, "p50") for topic in topics], height * 0.9, color=colour,
                  label=drive.title + " p50")
        left.plot([latency(drive, topic, "p99") for topic in topics], positions, "|", markersize=14,
                  markeredgewidth=2, color=colour, label=drive.title + " p99")
        right.barh([row + offset for row in range(len(nodes))], [drive.cpu_s.get(node, 0.0) for node in nodes],
                   height * 0.9, color=colour, label=drive.title)
    left.set_xscale("log")
    for axes, names, label, columns in ((left, topics, "latency from hand-over to callback [ms]", 4),
                                        (right, nodes, "CPU time while playing [s]", 2)):
        axes.set_yticks(range(len(names)))
        axes.set_yticklabels(names)
        axes.invert_yaxis()
        axes.set_xlabel(label)
        axes.grid(axis="x", which="both", alpha=0.3)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncol=columns, frameon=False)
    figure.suptitle("First drive: " + " and ".join(drive.title for drive in drives))
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def write_report(drives, description, facts, output):
    """drive.json and drive_latency.png in the folder `output`; returns the paths of JSON and plot.
    @throws DemoError if they cannot be written."""
    result = {"input": description, "machine": facts, "drives": [drive.as_dict() for drive in drives],
              "failures": {drive.name: drive.failures() for drive in drives}}
    report, picture = output / "drive.json", output / "drive_latency.png"
    temporary = output / "drive.json.tmp"
    try:
        temporary.write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(temporary, report)
        plot(drives, picture)
    except OSError as error:
        raise DemoError("the report cannot be written to %s: %s; make room there or choose another folder with "
                        "--output" % (output, error.strerror)) from error
    return report, picture
