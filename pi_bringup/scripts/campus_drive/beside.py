"""Drives beside each other: the figures that have a bar first, then the rest; the same numbers as JSON. No ROS."""

import json
import os

from first_drive.errors import DemoError
from first_drive.report import number, table

from .judge import STOP_LIMIT_S, quantile

LIMIT_CPU = 1.4          # cores, of the whole vehicle
LIMIT_SPEECH_S = 0.5     # from the end of speech to the command
STEREO_HZ, POSE_HZ, DETECTION_HZ = 20.0, 200.0, 10.0
SHARE = 0.95
TITLES = {"π-OS": "over π-OS", "TCPROS": "over TCPROS"}


def rate_of(tree, topic):
    return (tree["topics"].get(topic) or {}).get("rate_hz")


def latency_of(tree, topic, key):
    return ((tree["topics"].get(topic) or {}).get("latency_ms") or {}).get(key)


def heard(tree):
    """Latencies of the commands that were heard [s]."""
    return [one["latency"] for one in tree["commands"] if one["accepted"]]


def arrived(tree):
    return bool(tree["action"] and tree["action"]["success"]) and not tree["collisions"]


def figure(value, digits, unit, met=None):
    """A value as JSON and screen have it: rounded once. @param met  whether the rounded value is within its bar."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        value = round(value, digits)
        text = number(value, digits) + unit
    else:
        text = {True: "yes", False: "no", None: "-"}[value]
    return {"value": value, "text": text,
            "met": None if met is None else value is not None and bool(met(value))}


def bars(tree):
    """[(what, its bar, figure)]"""
    braking = [one["braking_s"] for one in tree["stops"]]
    stop = max(braking, default=None) if None not in braking else None

    def at_least(limit):
        return lambda value: value >= limit

    return [
        ("reaches B without a collision", "yes", figure(arrived(tree), 0, "", lambda value: value)),
        ("stereo pairs into localisation", ">= %.0f /s" % STEREO_HZ,
         figure(tree["pairs_hz"], 1, " /s", at_least(STEREO_HZ))),
        ("pose", ">= %.0f Hz" % POSE_HZ, figure(rate_of(tree, "/odometry"), 1, " Hz", at_least(POSE_HZ))),
        ("detection", ">= %.0f Hz" % DETECTION_HZ,
         figure(rate_of(tree, "/detections"), 1, " Hz", at_least(DETECTION_HZ))),
        ("spoken command, p95", "<= %.0f ms" % (1000 * LIMIT_SPEECH_S),
         figure(milliseconds(quantile(heard(tree), SHARE)), 0, " ms", lambda value: value <= 1000 * LIMIT_SPEECH_S)),
        ("\"stop\", end of word to braking", "<= %.1f s" % STOP_LIMIT_S,
         figure(stop, 2, " s", lambda value: value <= STOP_LIMIT_S)),
        ("processor, whole vehicle", "<= %.0f %%" % (100 * LIMIT_CPU),
         figure(100 * tree["vehicle_cores"], 0, " %", lambda value: value <= 100 * LIMIT_CPU)),
        ("errors in the log", "0", figure(len(tree["errors"]), 0, "", lambda value: value == 0))]


def milliseconds(seconds):
    return None if seconds is None else 1000.0 * seconds


def others(tree):
    """[(what, figure)] without a bar."""
    memory = sum((tree["memory_mb"].get(node) or {}).get("pss", 0.0) for node in tree["cpu_cores"].get("vehicle", {}))
    tasks = tree["offloading"].get("detection", {"tasks": 0, "by": {}})
    away = sum(count for how, count in tasks["by"].items() if how.startswith("remote"))
    seen = tree["sightings"]
    rows = [
        ("length of the drive", figure(tree["seconds"], 1, " s")),
        ("obstacles", figure(rate_of(tree, "/obstacles"), 1, " Hz")),
        ("picture to obstacles, p50", figure(latency_of(tree, "/obstacles", "p50"), 0, " ms")),
        ("picture to obstacles, p99", figure(latency_of(tree, "/obstacles", "p99"), 0, " ms")),
        ("picture to detections, p50", figure(latency_of(tree, "/detections", "p50"), 0, " ms")),
        ("picture to detections, p99", figure(latency_of(tree, "/detections", "p99"), 0, " ms")),
        ("pictures that the renderer skipped", figure(integer(tree["cameras"].get("skipped pairs")), 0, "")),
        ("error of the localisation, RMS", figure(tree["localisation"]["rms_m"], 2, " m")),
        ("error of the localisation, most", figure(tree["localisation"]["max_m"], 2, " m")),
        ("people and things on the way: reported", figure(sum(one["reported"] > 0 for one in seen.values()), 0, "")),
        ("people and things on the way: missed", figure(sum(one["reported"] == 0 for one in seen.values()), 0, "")),
        ("commands said", figure(len(tree["said"]), 0, "")),
        ("commands heard", figure(len(heard(tree)), 0, "")),
        ("pictures detected at edge nodes", figure(100.0 * away / tasks["tasks"] if tasks["tasks"] else 0.0, 0, " %")),
        ("memory of the vehicle (PSS)", figure(memory, 0, " MB")),
        ("power of the computer (%s)" % tree["watts_source"], figure(tree["watts"], 1, " W"))]
    for group, nodes in sorted(tree["cpu_cores"].items()):
        if group != "vehicle":
            rows.append(("processor, not of the vehicle: %s" % group, figure(100 * sum(nodes.values()), 0, " %")))
    return rows


def integer(text):
    return int(text) if str(text).isdigit() else None


def by_name(drives, rows_of):
    """[(name, [figure of each drive])] in the order of the drive that has most; a dash where one lacks it."""
    every = [dict(rows_of(tree)) for tree in drives]
    names = list(dict.fromkeys(name for rows in every for name in rows))
    return [(name, [rows.get(name, figure(None, 0, "")) for rows in every]) for name in names]


def transport(drives):
    """[{topic, and per drive Hz, p50 and p99 [ms]; ratios}] of the topics that every drive has."""
    topics = [topic for topic in sorted(drives[0]["topics"])
              if all((tree["topics"].get(topic) or {}).get("messages") for tree in drives)]
    rows = []
    for topic in topics:
        rows.append({"topic": topic, "hz": [rounded(rate_of(tree, topic), 1) for tree in drives],
                     "p50_ms": [rounded(latency_of(tree, topic, "p50"), 2) for tree in drives],
                     "p99_ms": [rounded(latency_of(tree, topic, "p99"), 2) for tree in drives]})
    for row in rows:
        for key in ("p50", "p99"):
            ours, theirs = row[key + "_ms"][0], row[key + "_ms"][-1]
            row[key + "_ratio"] = round(theirs / ours, 1) if ours and theirs else None
    return rows


def rounded(value, digits):
    return None if value is None else round(value, digits)


def links(tree):
    return ", ".join("%d %s" % (count, name) for name, count in sorted(tree["transports"].items())) or "-"


def compare(drives):
    """@param drives  trees of drives, that over π-OS first. @return the tree of the report"""
    rows = [bars(tree) for tree in drives]
    table_of_bars = [{"what": one[0][0], "bar": one[0][1], "drives": [entry[2] for entry in one]} for one in zip(*rows)]
    missed = [one["what"] for one in table_of_bars if not one["drives"][0]["met"]]
    return {"titles": [TITLES[tree["transport"]] for tree in drives], "scenario": drives[0]["scenario"],
            "seed": drives[0]["seed"], "machine": drives[0]["machine"], "passed": not drives[0]["failures"],
            "failures": [tree["failures"] for tree in drives], "bars": table_of_bars, "missed": missed,
            "others": [{"what": name, "drives": figures} for name, figures in by_name(drives, others)],
            "links": [links(tree) for tree in drives], "transport": transport(drives),
            "nodes": nodes(drives), "services": services(drives), "sightings": [tree["sightings"] for tree in drives],
            "errors": [tree["errors"] for tree in drives], "drives": drives}


def verdict(tree):
    count = len(tree["bars"])
    first = tree["failures"][0]
    if first:
        return "FAILED %s: %s" % (tree["titles"][0], "; ".join(first))
    if tree["missed"]:
        return "The vehicle drove from A to B %s; %d of %d bars met, not: %s" % (
            tree["titles"][0], count - len(tree["missed"]), count, ", ".join(tree["missed"]))
    return "PASSED: the vehicle drove from A to B %s; all %d bars met" % (tree["titles"][0], count)


def nodes(drives):
    """[{node, group, cpu percent and PSS of each drive}], the vehicle's first, then by what they take."""
    rows = {}
    for index, tree in enumerate(drives):
        for group, members in tree["cpu_cores"].items():
            for node, cores in members.items():
                row = rows.setdefault(node, {"node": node, "group": group, "cpu": [None] * len(drives),
                                             "pss_mb": [None] * len(drives)})
                row["cpu"][index] = round(100 * cores, 1)
                row["pss_mb"][index] = rounded((tree["memory_mb"].get(node) or {}).get("pss"), 0)
    return sorted(rows.values(), key=lambda row: (row["group"] != "vehicle", row["group"],
                                                  -max(value or 0.0 for value in row["cpu"])))


def services(drives):
    """[{service, cpu percent, watts and memory of each drive}] as the node `power` has them."""
    names = list(dict.fromkeys(name for tree in drives for name in tree["services"]))
    return [{"service": name, **{
        key: [rounded(scale * tree["services"][name][field], digits) if name in tree["services"]
              and tree["services"][name][field] is not None else None for tree in drives]
        for key, field, scale, digits in (("cpu", "cpu", 100.0, 1), ("watts", "watts", 1.0, 2),
                                          ("memory_mb", "memory_mb", 2.0 ** -20, 0))}} for name in names]


def print_first(tree):
    """The first screen."""
    facts = tree["machine"]
    print("\n%s\n" % verdict(tree))
    rows = [["", "bar", *tree["titles"]]]
    for one in tree["bars"]:
        rows.append([one["what"], one["bar"]] + [value["text"] + ("" if value["met"] else " !")
                                                 for value in one["drives"]])
    print(table(rows, "<<" + "<" * len(tree["titles"])))
    for title, failures in list(zip(tree["titles"], tree["failures"]))[1:]:
        if failures:
            print("  %s: %s" % (title, "; ".join(failures)))
    print("  ! misses its bar. %s, seed %d; %s, %d cores, %.1f GB, load %.1f at the start" % (
        tree["scenario"], tree["seed"], facts["cpu"], facts["cores"], facts["memory_gb"], facts["load"]))


def print_rest(tree):
    titles = tree["titles"]
    print("\nThe same drives, figures without a bar")
    print(table([["", *titles]] + [[one["what"]] + [value["text"] for value in one["drives"]]
                                   for one in tree["others"]], "<" + ">" * len(titles)))
    print("  links: %s" % "; ".join("%s: %s" % pair for pair in zip(titles, tree["links"])))
    print("\nTopics: from the stamp to arrival at a monitor. The stamps of pictures, and of what is made of them, are "
          "those of the exposure:\ntheir rendering is most of it; from hand-over to arrival: make demo-recording")
    header = ["topic"]
    for title in titles:
        header += [title + ": Hz", "p50/ms", "p99/ms"]
    rows = [header + ["p50 ratio", "p99 ratio"]]
    for one in tree["transport"]:
        row = [one["topic"]]
        for index in range(len(titles)):
            row += [number(one["hz"][index], 1), number(one["p50_ms"][index], 2), number(one["p99_ms"][index], 2)]
        rows.append(row + [number(one["p50_ratio"], 1), number(one["p99_ratio"], 1)])
    print(table(rows, "<" + ">" * (len(header) + 1)))
    print("\nProcessor in % of one core, memory (PSS); the group tells what is not of the vehicle")
    header = ["node"]
    for title in titles:
        header += [title + ": CPU %", "MB"]
    rows = [header + ["group"]]
    for one in tree["nodes"]:
        row = [one["node"]]
        for index in range(len(titles)):
            row += [number(one["cpu"][index], 1), number(one["pss_mb"][index], 0)]
        rows.append(row + [one["group"]])
    print(table(rows, "<" + ">" * (len(header) - 1) + "<"))
    print("\nServices, as the node `power` has them")
    header = ["service"]
    for title in titles:
        header += [title + ": CPU %", "W", "MB"]
    rows = [header]
    for one in tree["services"]:
        row = [one["service"]]
        for index in range(len(titles)):
            row += [number(one["cpu"][index], 1), number(one["watts"][index], 2), number(one["memory_mb"][index], 0)]
        rows.append(row)
    print(table(rows, "<" + ">" * (len(header) - 1)))


def write(tree, output):
    """drives.json in the folder. @return its path. @throws DemoError"""
    path, temporary = output / "drives.json", output / "drives.json.tmp"
    try:
        temporary.write_text(json.dumps({"verdict": verdict(tree), **tree}, indent=1, ensure_ascii=False, default=str) +
                             "\n", encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise DemoError("%s cannot be written: %s; make room there or choose another folder with --output" %
                        (path, error.strerror)) from error
    return path
