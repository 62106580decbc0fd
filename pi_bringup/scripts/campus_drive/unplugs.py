"""Unplugs sensors and the chassis during a drive, plugs them in again, and judges what the vehicle made of it."""

import math
import random
import re
from dataclasses import dataclass

UNPLUGGED_S = 4.5      # a vehicle at 3 m/s comes to rest in it, and the services say that an input is silent
FIRST_S = 2.0          # after the begin of the drive
PAUSE_S = 1.0          # between one that is back and the next
LEAST_SPEED = 1.0      # [m/s] the vehicle drives when something is unplugged
NEAR_GOAL_M = 9.0      # no more is unplugged there
AFTER_WORD_S = 3.0     # what is said has been heard, or missed, by then
SAY_AFTER_S = 0.5      # a word, after the microphone is plugged in
SAY_AGAIN_S = 3.0
LOST_S = 20.0          # not back for so long
SETTLED_S = 3.0        # after the plugging in: localisation has come to terms with what happened
ERROR_LIMIT_M = 0.5    # that localisation may be farther off than before
HELD_AFTER_S = 3.0     # from the plugging in: a vehicle that an obstacle holds then is not awaited
DRIVES = 0.2           # [m/s]
STANDS = 0.05          # [m/s]
REPORT_LIMIT_S = 4.0   # from the unplugging until the diagnostics name the device
BACK_LIMIT_S = 5.0     # from the plugging in until the services work
DRIVE_LIMIT_S = 10.0   # until the vehicle drives again, unless something else holds it
CHASSIS_READY = (0, 1)  # READY, DRIVING of VehicleState
CHASSIS, SIMULATOR, MICROPHONE = "chassis", "/vehicle_simulator/command", "/microphone/command"
WORD = "go"            # without a stop it changes nothing
FOR_AN_OBSTACLE = re.compile(r"obstacle \d|until the way has been clear")  # reasons of the governor
NOT_THE_VEHICLE = ("vehicle_simulator",)  # what it reports does not count


@dataclass(frozen=True)
class Device:
    """What docs/design/vehicle_simulator.md defines in its table; a test keeps both equal."""

    name: str
    service: str     # that takes the commands
    unplug: str
    plug: str
    stops: bool      # else the vehicle goes on
    named_by: tuple  # texts that the diagnostics must say, each of them
    needs: tuple     # what must work again


EYES = ("obstacles", "detections", "localisation")
DEVICES = (
    Device("left camera", SIMULATOR, "camera left off", "camera left on", True, ("/left/image_raw",), EYES),
    Device("right camera", SIMULATOR, "camera right off", "camera right on", True, ("/right/image_raw",),
           ("obstacles", "localisation")),
    Device("both cameras", SIMULATOR, "camera both off", "camera both on", True,
           ("/left/image_raw", "/right/image_raw"), EYES),
    Device("left camera dark", SIMULATOR, "camera left dark", "camera left on", True, ("left picture is without",),
           ("obstacles", "localisation")),
    Device("both cameras dark", SIMULATOR, "camera both dark", "camera both on", True,
           ("both pictures are without",), ("obstacles", "localisation")),
    Device("IMU", SIMULATOR, "imu off", "imu on", True, ("/imu/data",), ("localisation",)),
    Device("microphone", MICROPHONE, "unplug", "plug", False, ("/audio_stamped",), ("hearing",)),
    Device("chassis", SIMULATOR, "unplug", "plug", True, ("is the chassis unplugged",), ("chassis",)),
)


def devices_of(text):
    """@param text  names with commas between them, or "all". @throws ValueError naming those that there are."""
    wanted = [part.strip() for part in text.split(",")]
    known = [device.name for device in DEVICES]
    unknown = [name for name in wanted if name != "all" and name not in known]
    if unknown:
        raise ValueError("there is no device \"%s\"; must be all, or some of: %s" % (unknown[0], ", ".join(known)))
    return [device for device in DEVICES if "all" in wanted or device.name in wanted]


def sequence(devices, seed):
    """@return the devices in an order that the seed decides."""
    devices = list(devices)
    random.Random(seed).shuffle(devices)
    return devices


class Unplugger:
    """Called by the one who drives; `command(service, line)` executes a line or throws."""

    def __init__(self, devices, observer, command):
        self._left = list(devices)
        self._observer = observer
        self._command = command
        self._due = math.inf
        self._quiet_until = 0.0
        self._said = None     # when the word was said for the last time
        self._open = None     # (device, entry)
        self.unplugs = []

    @property
    def busy(self):
        """Something is unplugged, or not back yet: nothing is said then but the word that proves the microphone."""
        return self._open is not None

    @property
    def left(self):
        return [device.name for device in self._left]

    def begin(self, now):
        self._due = now + FIRST_S

    def word_said(self, now):
        self._quiet_until = now + AFTER_WORD_S

    def tick(self, now, speed, to_goal, words_wait):
        """@param words_wait  somebody is about to speak. @return True: the word that proves the microphone is to be
        said."""
        if self._open is None:
            if (self._left and now >= max(self._due, self._quiet_until) and speed >= LEAST_SPEED and not words_wait
                    and to_goal >= NEAR_GOAL_M and not self._stopped_by_word()):
                self._unplug(now, speed)
            return False
        device, entry = self._open
        if entry["plugged"] is None:
            if now - entry["time"] >= UNPLUGGED_S:
                self._command(device.service, device.plug)
                entry["plugged"] = now
            return False
        after = now - entry["plugged"]
        for need in device.needs:
            if need not in entry["back"] and self._works(need, entry["plugged"]):
                entry["back"][need] = after
        if entry["driving_s"] is None and speed > DRIVES:
            entry["driving_s"] = after
        held = self._held() if entry["driving_s"] is None and after >= HELD_AFTER_S else ""
        if len(entry["back"]) == len(device.needs) and (entry["driving_s"] is not None or held):
            entry["held_by"] = held
            self._close(now)
        elif after > LOST_S:
            self._close(now)
        elif "hearing" in device.needs and after >= SAY_AFTER_S and (self._said is None or
                                                                     now - self._said >= SAY_AGAIN_S):
            self._said = now
            return True
        return False

    def _unplug(self, now, speed):
        # One that is still reported would be taken for reported anew.
        device = next((one for one in self._left if not self._named(one)), None)
        if device is None:
            return
        self._left.remove(device)
        self._said = None
        entry = {"device": device.name, "stops": device.stops, "time": now, "speed": speed, "plugged": None,
                 "back": {}, "driving_s": None, "held_by": ""}
        self._open = (device, entry)
        self.unplugs.append(entry)
        self._command(device.service, device.unplug)

    def _close(self, now):
        self._open = None
        self._due = now + PAUSE_S

    def _named(self, device):
        return any(level > 0 and of_the_vehicle(name) and
                   any(part in text_of(message, values) for part in device.named_by)
                   for name, (level, message, values) in list(self._observer.records.statuses.items()))

    def _stopped_by_word(self):
        states = self._observer.records.command_states
        return bool(states) and states[-1]["stopped"]

    def _held(self):
        """What else holds the vehicle: an obstacle, or a rule; empty: nothing."""
        feedback = self._observer.records.feedback
        return feedback[-1][3] if feedback and feedback[-1][2] == "held up" else ""

    def _works(self, need, since):
        records = self._observer.records
        if need == "localisation":
            return (records.arrivals.get("/odometry", 0.0) > since and bool(records.validity) and
                    records.validity[-1][1])
        if need == "chassis":
            return bool(records.states) and records.states[-1][0] > since and records.states[-1][2] in CHASSIS_READY
        if need == "hearing":
            return bool(records.commands) and records.commands[-1]["arrival"] > since
        return records.arrivals.get("/" + need, 0.0) > since


def of_the_vehicle(name):
    """Whether a status is one that counts."""
    return name.split(":")[0] not in NOT_THE_VEHICLE


def text_of(message, values):
    """All that a status says in words."""
    return "; ".join([message] + [value for key, value in values.items() if key.startswith("warning")])


# ------------------------------------------------------------------------------------------------------------- verdict

def finish(unplugs, states, records, error_at):
    """Adds what the vehicle did, and what was reported. @param states  of the simulator.
    @param error_at  of localisation in (begin, end) while its pose is said to be valid [m]; None: not known."""
    by_name = {device.name: device for device in DEVICES}
    for entry in unplugs:
        device = by_name[entry["device"]]
        begin, end = entry["time"], entry["plugged"] or math.inf
        before = [one for one in states if begin <= one["stamp"] <= end]
        entry["least_speed"] = min((abs(one["speed"]) for one in before), default=None)
        entry["stands_s"] = next((one["stamp"] - begin for one in before if abs(one["speed"]) <= STANDS), None)
        judged_at = end if entry["stands_s"] is None else begin + entry["stands_s"]
        entry["why"] = next(("%s: %s" % (limited or driver, reason) for stamp, driver, limited, reason in
                             reversed(records.arbiter) if stamp <= judged_at), "")
        entry["error_before_m"] = error_at(begin - 1.0, begin)
        entry["error_after_m"] = error_at(end + SETTLED_S, end + SETTLED_S + 1.0)
        entry["reported"] = reported(device, begin, records.reports)
        entry["reported_s"] = max((one["after_s"] for one in entry["reported"]), default=None) \
            if len(entry["reported"]) == len(device.named_by) else None
        entry["back_s"] = max(entry["back"].values()) if len(entry["back"]) == len(device.needs) else None
    return unplugs


def reported(device, begin, reports):
    """The first report of each text that must be said: who, level, text, seconds after the unplugging."""
    found = []
    for part in device.named_by:
        one = next((one for one in reports if one["arrival"] > begin and one["level"] > 0 and part in one["text"] and
                    of_the_vehicle(one["name"])), None)
        if one is not None:
            found.append({"by": one["name"], "level": one["level"], "text": one["text"],
                          "after_s": one["arrival"] - begin})
    return found


def stopped_otherwise(entry):
    """Whether the vehicle stood for something that is not the device: an obstacle, or a word."""
    return bool(FOR_AN_OBSTACLE.search(entry["why"])) or entry["why"].startswith("command:")


def failures(unplugs, left):
    """What is not as the table says, as texts. @param left  names of devices that were not unplugged."""
    texts = []
    for entry in unplugs:
        name = entry["device"]
        if entry["plugged"] is None:
            texts.append("%s: the drive ended before it was plugged in again" % name)
            continue
        if entry["stops"] and entry["stands_s"] is None:
            texts.append("%s unplugged: the vehicle went on at %.2f m/s and more; defined is that it stops" %
                         (name, entry["least_speed"] if entry["least_speed"] is not None else math.nan))
        if not entry["stops"] and entry["stands_s"] is not None and not stopped_otherwise(entry):
            texts.append("%s unplugged: the vehicle stopped (%s); defined is that it goes on" % (name, entry["why"]))
        if entry["reported_s"] is None or entry["reported_s"] > REPORT_LIMIT_S:
            texts.append("%s unplugged: reported after %s, must be within %.1f s" % (
                name, "never" if entry["reported_s"] is None else "%.1f s" % entry["reported_s"], REPORT_LIMIT_S))
        if entry["back_s"] is None or entry["back_s"] > BACK_LIMIT_S:
            texts.append("%s plugged in: back after %s, must be within %.1f s" % (
                name, "never" if entry["back_s"] is None else "%.1f s" % entry["back_s"], BACK_LIMIT_S))
        if not entry["held_by"] and (entry["driving_s"] is None or entry["driving_s"] > DRIVE_LIMIT_S):
            texts.append("%s plugged in: the vehicle drives after %s, must within %.1f s" % (
                name, "never" if entry["driving_s"] is None else "%.1f s" % entry["driving_s"], DRIVE_LIMIT_S))
        before, after = entry["error_before_m"], entry["error_after_m"]
        if before is not None and after is not None and after - before > ERROR_LIMIT_M:
            texts.append("%s plugged in: localisation says that it is valid and is %.2f m off, %.2f m before" %
                         (name, after, before))
    if left:
        texts.append("not unplugged, as the drive ended before: %s" % ", ".join(left))
    return texts


def lines(unplugs):
    """One per device, for the report."""
    for entry in unplugs:
        yield "%s at %.1f m/s: %s, defined: %s; reported %s; plugged in: %s, %s; localisation %s m off, %s m before" % (
            entry["device"], entry["speed"],
            "stood after %.1f s" % entry["stands_s"] if entry["stands_s"] is not None
            else "went on, least %.1f m/s" % (entry["least_speed"] or 0.0),
            "stops" if entry["stops"] else "goes on",
            "after %.1f s by %s" % (entry["reported_s"], ", ".join(sorted({one["by"] for one in entry["reported"]})))
            if entry["reported_s"] is not None else "never",
            ", ".join("%s after %.1f s" % pair for pair in sorted(entry["back"].items(), key=lambda pair: pair[1]))
            or "nothing came back",
            "driving after %.1f s" % entry["driving_s"] if entry["driving_s"] is not None
            else "held up: %s" % entry["held_by"] if entry["held_by"] else "never drove again",
            *("?" if error is None else "%.2f" % error for error in (entry["error_after_m"], entry["error_before_m"])))
