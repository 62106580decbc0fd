"""Checks of the computer: processors, memory, shared memory, limits, clock, disk, sensors of power."""

import ctypes
import os
import resource
import shutil
import tempfile
from pathlib import Path

from pi_bringup.doctor import children
from pi_bringup.doctor.result import fail, ok, warn

LEAST_CORES = 2
LEAST_MEMORY = 1.5e9      # bytes that are free for all services
LEAST_SHARED = 256e6      # of /dev/shm
LEAST_DISK = 2e9
WANTED_NICE = -10         # of pi_node/scheduling.h
WANTED_PRIORITY = 16      # of pi_runtime: ABOVE_LANES of fixed_priority_admission.h
WANTED_SHARE = 0.5        # of the time, for real-time programs
WANTED_LOCKED = 64 << 20
UNSYNCHRONISED = 0x40     # STA_UNSYNC of adjtimex()
GOOD_GOVERNORS = ("performance", "schedutil", "ondemand")
LIMIT_S = 5.0


def _read(path):
    """A file's text without the end of line, or None."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def _gigabytes(count):
    return f"{count / 1e9:.1f} GB"


def check_processor(root="/", cores=None):
    name = "processor"
    root = Path(root)
    cores = cores if cores is not None else len(os.sched_getaffinity(0))
    folders = sorted(root.glob("sys/devices/system/cpu/cpu[0-9]*/cpufreq"))
    governors = sorted({_read(folder / "scaling_governor") for folder in folders} - {None})
    throttled = sum(int(count) for count in (
        _read(path) for path in root.glob("sys/devices/system/cpu/cpu*/thermal_throttle/package_throttle_count"))
        if count and count.isdigit())
    text = f"{cores} core(s), governor {', '.join(governors) if governors else 'not told'}"
    if cores < LEAST_CORES:
        return warn(name, text, f"the whole vehicle needs at least {LEAST_CORES}; offload, or start fewer services")
    slow = [governor for governor in governors if governor not in GOOD_GOVERNORS]
    if slow:
        return warn(name, text, "as root: echo performance | tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor")
    if throttled:
        return warn(name, f"{text}, throttled {throttled} times by heat", "cool it, or lower its load")
    return ok(name, text)


def check_temperature(root="/"):
    name = "temperature"
    hottest = None
    for zone in Path(root).glob("sys/class/thermal/thermal_zone*"):
        value = _read(zone / "temp")
        limits = [_read(path) for path in zone.glob("trip_point_*_temp")]
        if value and value.lstrip("-").isdigit():
            trip = min((int(limit) for limit in limits if limit and limit.isdigit() and int(limit) > 50000),
                       default=90000)
            entry = (int(value) - trip, int(value), _read(zone / "type") or zone.name)
            hottest = max(hottest, entry) if hottest else entry
    if hottest is None:
        return ok(name, "no sensor tells it")
    above, value, sensor = hottest
    text = f"{value / 1000:.0f} degrees ({sensor})"
    return warn(name, text, "cool it: the processor slows down") if above > -5000 else ok(name, text)


def check_memory(root="/"):
    name = "memory"
    values = {}
    for line in (_read(Path(root) / "proc/meminfo") or "").splitlines():
        key, _, value = line.partition(":")
        if value.split()[:1] and value.split()[0].isdigit():
            values[key] = 1024 * int(value.split()[0])
    free, total = values.get("MemAvailable"), values.get("MemTotal")
    if free is None or total is None:
        return warn(name, "/proc/meminfo does not tell it", "mount /proc")
    text = f"{_gigabytes(free)} of {_gigabytes(total)} are available"
    if free < LEAST_MEMORY:
        return warn(name, text, f"end other programs; all services together take about {_gigabytes(LEAST_MEMORY)}")
    return ok(name, text)


def check_shared_memory(root="/"):
    """π-OS has its pools there."""
    name = "shared memory"
    folder = Path(root) / "dev/shm"
    if not folder.is_dir():
        return fail(name, "/dev/shm is missing", "mount -t tmpfs tmpfs /dev/shm; π-OS then works over TCP only")
    if not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
        return fail(name, "/dev/shm may not be written to", "chmod 1777 /dev/shm")
    usage = shutil.disk_usage(folder)
    text = f"/dev/shm has {_gigabytes(usage.free)} of {_gigabytes(usage.total)} free"
    if usage.free < LEAST_SHARED:
        return fail(name, text, "remove what is left there, or enlarge it: mount -o remount,size=1G /dev/shm; a "
                    "container needs --shm-size=1g")
    return ok(name, text)


def check_limits(limits=None):
    """@param limits  {resource: soft limit}, those of this process else."""
    name = "limits"
    limits = limits or {key: resource.getrlimit(getattr(resource, key))[0]
                        for key in ("RLIMIT_MEMLOCK", "RLIMIT_NOFILE")}

    def enough(key, least):
        return limits[key] == resource.RLIM_INFINITY or limits[key] >= least

    def shown(key):
        return "unlimited" if limits[key] == resource.RLIM_INFINITY else str(limits[key])

    text = f"memlock {shown('RLIMIT_MEMLOCK')}, open files {shown('RLIMIT_NOFILE')}"
    results = []
    if not (enough("RLIMIT_MEMLOCK", WANTED_LOCKED) or os.geteuid() == 0):
        results.append(warn(name, text, "let the user have \"memlock unlimited\" in /etc/security/limits.d"))
    if not enough("RLIMIT_NOFILE", 1024):
        results.append(fail(name, text, "ulimit -n 4096: each link between nodes takes open files"))
    return results or ok(name, text)


def real_time_denied():
    """Why this process gets no real-time priority, or None: it does."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(WANTED_PRIORITY))
    except OSError as error:
        return error.strerror
    os.sched_setscheduler(0, *before)
    return None


def _group_without_real_time(root):
    """The file that keeps this process's control group from real-time priorities, or None: kernels with
    CONFIG_RT_GROUP_SCHED give new groups no time for them."""
    for line in (_read(Path(root) / "proc/self/cgroup") or "").splitlines():
        _, controllers, path = line.split(":", 2)
        if "cpu" in controllers.split(","):
            file = Path("sys/fs/cgroup") / controllers / path.strip("/") / "cpu.rt_runtime_us"
            return f"/{file}" if _read(Path(root) / file) == "0" else None
    return None


def check_scheduling(denied=None, root="/"):
    """Whether short jobs of pi_runtime may interrupt long ones, and whether the kernel keeps them in bounds."""
    name = "scheduling"
    if denied is None:
        denied = real_time_denied()
    share = _read(Path(root) / "proc/sys/kernel/sched_rt_runtime_us")
    period = _read(Path(root) / "proc/sys/kernel/sched_rt_period_us")
    if denied:
        autogroup = _read(Path(root) / "proc/sys/kernel/sched_autogroup_enabled") == "1"
        text = f"no real-time priorities ({denied}): long jobs are cut, not interrupted"
        group = _group_without_real_time(root)
        if group:
            return warn(name, f"{text}; the control group has no time for them",
                        f"as root: echo 500000 > {group}, in the groups above it first")
        return warn(name, text + (", and nice values count within a session only (autogroup)" if autogroup else ""),
                    f"as root: printf \"$USER - rtprio {WANTED_PRIORITY}\\n$USER - nice {WANTED_NICE}\\n\" > /etc/security/limits.d/pi_edge.conf, and log "
                    f"in anew; a systemd service needs LimitRTPRIO={WANTED_PRIORITY} and LimitNICE={WANTED_NICE}, a container --cap-add=sys_nice")
    if share == "-1":
        return warn(name, "a real-time program may take the computer for good",
                    "as root: sysctl kernel.sched_rt_runtime_us=950000")
    if share and period and share.isdigit() and period.isdigit() and int(share) < WANTED_SHARE * int(period):
        return warn(name, f"real-time programs get {100 * int(share) / int(period):.0f} % of the time at most",
                    "as root: sysctl kernel.sched_rt_runtime_us=950000")
    return ok(name, f"real-time priorities up to {WANTED_PRIORITY} are granted")


def clock_status():
    """Bits of adjtimex(), or None."""
    buffer = ctypes.create_string_buffer(512)  # struct timex, modes = 0: only asks
    state = ctypes.CDLL(None, use_errno=True).adjtimex(buffer)
    if state < 0:
        return None
    # modes (int, padded), offset, freq, maxerror, esterror (long), status (int)
    return ctypes.c_int.from_buffer(buffer, 5 * ctypes.sizeof(ctypes.c_long)).value


def check_clock(status=None, root="/"):
    name = "clock"
    status = clock_status() if status is None else status
    programs = [program for program in ("chronyd", "ntpd", "systemd-timesyncd", "ptp4l", "phc2sys")
                if any(_read(path) == program[:15] for path in Path(root).glob("proc/[0-9]*/comm"))]
    by = f" by {', '.join(programs)}" if programs else ""
    if status is None:
        return warn(name, "the kernel does not tell whether it is synchronised", "look at timedatectl")
    if status & UNSYNCHRONISED:
        return warn(name, "is not synchronised" + by,
                    "needed where nodes run on several computers: apt-get install chrony, and look at chronyc tracking")
    return ok(name, "is synchronised" + by)


def check_disk(folders=None):
    name = "disk"
    results = []
    for folder in folders or {os.environ.get("ROS_HOME", os.path.expanduser("~/.ros")), tempfile.gettempdir()}:
        place = Path(folder)
        while not place.exists() and place != place.parent:
            place = place.parent
        usage = shutil.disk_usage(place)
        text = f"{_gigabytes(usage.free)} free at {folder}"
        if not os.access(place, os.W_OK):
            results.append(fail(name, f"{folder} may not be written to", "logs and maps go there: set ROS_HOME to a "
                                "folder of yours"))
        elif usage.free < LEAST_DISK:
            results.append(warn(name, text, "make room: logs, bags and maps go there"))
        else:
            results.append(ok(name, text))
    return results


def check_power_sensors(root="/"):
    name = "power sensors"
    root = Path(root)
    readable, denied = [], []
    for path in sorted([*root.glob("sys/class/powercap/intel-rapl:*/energy_uj"),
                        *root.glob("sys/class/hwmon/hwmon*/power*_input"),
                        *root.glob("sys/class/hwmon/hwmon*/curr*_input"),
                        *root.glob("sys/bus/i2c/drivers/ina3221x/*/iio:device*/in_power*_input")]):
        sensor = _read(path.parent / "name") or path.parent.name
        try:
            path.read_text(encoding="ascii")
            readable.append(sensor)
        except PermissionError:
            denied.append((sensor, "/" + str(path.relative_to(root))))
        except (OSError, UnicodeDecodeError):
            pass  # without a value just now
    if denied:
        sensor, path = denied[0]
        return warn(name, f"{len(denied)} may not be read, as {sensor} at {path}",
                    "as root: chmod a+r on it, by a udev rule to keep it; watts are modelled else")
    if not readable:
        return warn(name, "there is neither INA3221 nor RAPL",
                    "watts come from the model: see model in config/power.yaml")
    return ok(name, f"{len(readable)} values of {', '.join(sorted(set(readable)))}")


def check_load(root="/", cores=None):
    name = "load"
    fields = (_read(Path(root) / "proc/loadavg") or "").split()
    cores = cores if cores is not None else len(os.sched_getaffinity(0))
    try:
        load = float(fields[0])
    except (IndexError, ValueError):
        return warn(name, "/proc/loadavg does not tell it", "mount /proc")
    text = f"{load:.1f} on {cores} core(s)"
    return warn(name, text, "end other programs before a drive; top shows them") if load > cores else ok(name, text)


def throttling_tool(limit_s=LIMIT_S):
    """Of a Raspberry Pi: what vcgencmd says, or None where it is not there."""
    ended = children.run(["vcgencmd", "get_throttled"], limit_s)
    return ended.last_line() if ended.good else None


def check_supply(answer=None):
    name = "supply"
    answer = throttling_tool() if answer is None else answer
    try:
        bits = int(answer.rpartition("=")[2], 16) if answer else 0
    except ValueError:
        bits = 0
    if bits & 0x50005:
        return warn(name, f"under-voltage or throttling: {answer}", "use a stronger power supply, cool the computer")
    return ok(name, "no under-voltage is told" if answer else "the computer does not tell under-voltage")
