"""What the system and the graph say about themselves: processes, links, bags, the machine."""

import os
import platform
import subprocess
import xmlrpc.client

import yaml

from first_drive.errors import DemoError

CALLER = "/drive_demo"


def node_processes(launch_pid):
    """{node name: process id} of the nodes started by a roslaunch process."""
    nodes = {}
    for entry in os.listdir("/proc"):
        if not entry.isdigit():
            continue
        try:
            if int(stat_fields(entry)[1]) != launch_pid:
                continue
            with open("/proc/%s/cmdline" % entry, "rb") as file:
                words = file.read().decode(errors="replace").split("\0")
        except OSError:
            continue
        for word in words:
            if word.startswith("__name:="):
                nodes[word[len("__name:="):]] = int(entry)
    return nodes


def stat_fields(pid):
    """/proc/PID/stat from the third field, the state, on: the second one may contain blanks."""
    with open("/proc/%s/stat" % pid) as file:
        return file.read().rsplit(")", 1)[1].split()


def cpu_seconds(pid):
    """User and system time of a process; None if it has ended."""
    try:
        fields = stat_fields(pid)
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def memory_mb(pid):
    """Resident, proportional and private memory; the pool of π-OS counts in the first two. "kept" is the proportional
    one without pages of files, which depend on who else maps them and can be taken away. None if it has ended."""
    totals = {"Rss": 0, "Pss": 0, "Pss_Anon": 0, "Pss_Shmem": 0, "Private_Clean": 0, "Private_Dirty": 0}
    try:
        with open("/proc/%d/smaps_rollup" % pid) as file:
            for line in file:
                key = line.split(":")[0]
                if key in totals:
                    totals[key] += int(line.split()[1])
    except OSError:
        return None
    return {"rss": totals["Rss"] / 1024, "pss": totals["Pss"] / 1024,
            "kept": (totals["Pss_Anon"] + totals["Pss_Shmem"]) / 1024,
            "private": (totals["Private_Clean"] + totals["Private_Dirty"]) / 1024}


def all_links(master_uri):
    """[(topic, publisher, subscriber, transport)] as every node itself states it (getBusInfo)."""
    master = xmlrpc.client.ServerProxy(master_uri)
    publishers = master.getSystemState(CALLER)[2][0]
    nodes = sorted({node for _, names in publishers for node in names})
    links = []
    for node in nodes:
        code, _, uri = master.lookupNode(CALLER, node)
        if code != 1:
            continue
        try:
            answer = xmlrpc.client.ServerProxy(uri).getBusInfo(CALLER)
        except (OSError, xmlrpc.client.Error):
            continue
        for link in answer[2]:
            if link[2] == "o":
                links.append((link[4], node, link[1], link[3]))
    return sorted(links)


def read_bag(path, environment):
    """{topic: messages} according to `rosbag info`."""
    result = subprocess.run(["rosbag", "info", "--yaml", str(path)], env=environment, stdin=subprocess.DEVNULL,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=60)
    if result.returncode != 0:
        raise DemoError("rosbag info cannot read %s: %s" % (path, result.stdout.strip()))
    return {entry["topic"]: entry["messages"] for entry in yaml.safe_load(result.stdout).get("topics", [])}


def machine():
    model = platform.machine()
    memory_gb = 0.0
    try:
        with open("/proc/cpuinfo") as file:
            for line in file:
                if line.lower().startswith("model name"):
                    model = line.split(":", 1)[1].strip()
                    break
        with open("/proc/meminfo") as file:
            memory_gb = int(file.readline().split()[1]) / 2 ** 20
    except OSError:
        pass
    return {"cpu": model, "cores": os.cpu_count(), "memory_gb": round(memory_gb, 1),
            "kernel": platform.release(), "load": os.getloadavg()[0]}
