"""pi_speech's part of the demo: recorded speech, played to the recogniser in real time."""

import json
import math
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

from . import measuring
from .errors import DemoError
from .processes import log_excerpt
from .report import number, table

NAMESPACE = "/speech"
GAP_S = 1.0  # of silence after each clip
MESSAGE_S = 0.02  # of sound in a message
TEST_DATA = Path("/usr/share/pocketsphinx/test/data")  # of Debian's package pocketsphinx-testdata
TEST_SENTENCES = (("goforward.raw", "go forward ten meters"), ("something.raw", "go somewhere and do something"),
                  ("cards/001.wav", "ten of clubs"), ("cards/002.wav", "four queen of clubs"),
                  ("cards/003.wav", "seven of clubs"), ("cards/004.wav", "five five"),
                  ("cards/005.wav", "eight of spades four of clubs seven of hearts"))
TEST_COMMANDS = """# What drive_demo lets the recogniser listen for in the sentences of pocketsphinx-testdata.
commands:
  - {text: stop, fast: true}
  - go forward ten meters
  - go back
  - turn left
  - turn right
"""


@dataclass
class Utterance:
    """What the recogniser made of a piece of speech, as a subscriber got it."""

    text: str
    accepted: bool
    confidence: float
    middle_s: float         # of the speech, by the system's clock
    own_latency_s: float    # from the end of the speech, as the recogniser says
    latency_s: float        # from the end of the speech to the subscriber


@dataclass
class Clip:
    path: Path
    said: str  # "": nothing, only background
    heard: list = field(default_factory=list)

    def right(self):
        """The utterance that was accepted as what was said; None if there is none."""
        return next((one for one in self.heard if one.accepted and one.text == self.said), None)


# --------------------------------------------------------------------------------------------------------------- sound

def sound_files(folder):
    try:
        files = sorted(path for path in folder.iterdir() if path.suffix in (".flac", ".wav"))
    except OSError as error:
        raise DemoError("%s cannot be read: %s; unset PI_EDGE_DATA to play the sentences of pocketsphinx-testdata" %
                        (folder, error.strerror)) from error
    if not files:
        raise DemoError("%s holds no .flac or .wav; unset PI_EDGE_DATA to play the sentences of pocketsphinx-testdata" %
                        folder)
    return files


def clips_of_words(folder):
    """By name, so that nobody chooses: the first clip of the background, of each word, and of the first two of the
    other words, which are in one folder with the word at the begin of each name."""
    clips = [Clip(sound_files(folder / "_silence_")[0], "")]
    for words in sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("_")):
        clips.append(Clip(sound_files(words)[0], words.name))
    others = {}
    for path in sound_files(folder / "_unknown_"):
        others.setdefault(path.name.split("_")[0], path)
    return clips + [Clip(others[word], word) for word in sorted(others)[:2]]


def choose_clips(output):
    """@return (clips, what they are, commands table, "" being that of pi_speech)"""
    if os.environ.get("PI_EDGE_DATA"):
        folder = Path(os.environ["PI_EDGE_DATA"]).resolve() / "speech" / "commands"
        if folder.is_dir():
            return clips_of_words(folder), "single words", ""
    missing = [name for name, _ in TEST_SENTENCES if not (TEST_DATA / name).is_file()]
    if missing:
        raise DemoError("%s is missing; run: apt-get install pocketsphinx-testdata" % (TEST_DATA / missing[0]))
    path = output / "speech_commands.yaml"
    write(path, TEST_COMMANDS)
    return [Clip(TEST_DATA / name, said) for name, said in TEST_SENTENCES], "sentences of pocketsphinx-testdata", path


def write(path, text):
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DemoError("%s cannot be written: %s; make room there or choose another folder with --output" %
                        (path, error.strerror)) from error


# -------------------------------------------------------------------------------------------------------------- events

def utterance_event(message, accepted):
    now = time.time()
    begin, end = message.speech_start.to_sec(), message.speech_end.to_sec()
    return "utterance", Utterance(message.text, accepted, message.confidence, (begin + end) / 2,
                                  message.latency.to_sec(), now - end)


def recognizer_event(message):
    """What the recogniser says of itself, once a second. None if the message is of another node."""
    parts = {status.name.split(": ")[-1]: status for status in message.status
             if status.name.startswith(NAMESPACE.strip("/") + "/recognizer: ")}
    if not {"recognition", "sound"} <= set(parts):
        return None
    values = {pair.key: pair.value for part in parts.values() for pair in part.values}
    return "recognizer", {
        "state": values["state"], "problem": parts["recognition"].message,
        "commands": values["commands"].split(", "),
        "heard": int(values["heard"]), "in_speech": values["speech"] == "yes",
        "messages": int(values["messages that came"]), "waiting_s": float(values["sound that waits [s]"]),
        "gaps": int(values["gaps"]),
        "dropped": int(values["messages dropped, as others waited"]) + int(values["messages that could not be used"])}


class Listener:
    """Subscribes, by `events`, to recogniser and player."""

    def __init__(self, events):
        # Here, not above: they import rospy, and are there once pi_speech is installed.
        from diagnostic_msgs.msg import DiagnosticArray
        from std_msgs.msg import Empty, String
        try:
            from pi_speech.msg import VoiceCommand
        except ImportError as error:
            raise DemoError("no messages of pi_speech (%s); build and install pi_speech" % error) from error
        self.events = events
        events.subscribe(NAMESPACE + "/playing", String, lambda message: ("clip", (Path(message.data), time.time())))
        events.subscribe(NAMESPACE + "/finished", Empty, lambda _: ("finished", None))
        self._of_recognizer = [
            events.subscribe("/diagnostics", DiagnosticArray, recognizer_event),
            events.subscribe(NAMESPACE + "/command", VoiceCommand, lambda message: utterance_event(message, True)),
            events.subscribe(NAMESPACE + "/recognizer/rejected", VoiceCommand,
                             lambda message: utterance_event(message, False))]

    def await_recognizer(self):
        """Waits until it understands and all it says comes here. @return the commands that it understands."""
        def is_ready(kind, event):
            return kind == "recognizer" and (event["state"] == "error" or event["state"] != "loading" and
                                             all(one.get_num_connections() for one in self._of_recognizer))

        _, ready = self.events.next(is_ready, "the recogniser to load its models")
        if ready["state"] == "error":
            raise DemoError("the recogniser cannot work: %s" % ready["problem"])
        return ready["commands"]

    def hear_all(self):
        """Waits until all was played and heard. @return ({clip: when it began}, utterances, what the recogniser says of
        itself at the end)"""
        begins, utterances, own, finished = {}, [], None, False
        while True:
            kind, event = self.events.next(lambda *_: True, "the recogniser to hear what is played")
            if kind == "clip":
                begins[event[0]] = event[1]
            elif kind == "utterance":
                utterances.append(event)
            elif kind == "finished":
                finished = True
            elif kind == "recognizer":
                previous, own = own, event
                # What is still under way when the player has finished has come once nothing new does.
                if (finished and previous and own["messages"] == previous["messages"] and not own["in_speech"]
                        and own["waiting_s"] == 0.0 and own["heard"] == len(utterances)):
                    return begins, utterances, own


# ------------------------------------------------------------------------------------------------------------- playing

def start_node(started, prefix, preload, name, parameters, log_path):
    node = prefix / "lib" / "pi_speech" / (name + "_node")
    if not node.is_file():
        raise DemoError("%s is missing; build and install pi_speech" % node)
    command = [node, "__ns:=" + NAMESPACE, "__name:=" + name] + ["_%s:=%s" % pair for pair in parameters.items()]
    return started.start((["env", "LD_PRELOAD=%s" % preload] if preload else []) + command, log_path)


def play(started, events, prefix, preload, clips, commands_file, output):
    """Plays the clips to the recogniser and sorts what it hears to them. @return figures"""
    log_path = output / "log" / "speech.log"
    log_path.unlink(missing_ok=True)
    clip_list = output / "speech_clips.txt"
    write(clip_list, "".join("%s\n" % clip.path for clip in clips))
    nodes = []
    print("  loading the models")
    try:
        begin = time.monotonic()
        recognizer = start_node(started, prefix, preload, "recognizer",
                                {"commands": commands_file} if commands_file else {}, log_path)
        nodes.append(recognizer)
        events.follow(recognizer, "the recogniser")
        listener = Listener(events)
        commands = listener.await_recognizer()
        load_s = time.monotonic() - begin

        print("  playing %d clips" % len(clips))
        cpu_at_start = measuring.cpu_seconds(recognizer.pid)
        nodes.append(start_node(started, prefix, preload, "player",
                                {"files": clip_list, "gap_s": GAP_S, "period_s": MESSAGE_S}, log_path))
        events.watch(nodes[-1], "the player of the clips")
        begins, utterances, own = listener.hear_all()
        cpu_at_end = measuring.cpu_seconds(recognizer.pid)
        memory = measuring.memory_mb(recognizer.pid)
        links = measuring.all_links(started.environment["ROS_MASTER_URI"])
    finally:
        for node in reversed(nodes):
            started.stop(node)
    left_out = [clip.path for clip in clips if clip.path not in begins]
    if left_out or cpu_at_start is None or cpu_at_end is None or memory is None:
        raise DemoError("%s; from the log:\n%s" % ("%s was not played" % left_out[0] if left_out
                                                   else "the recogniser ended", log_excerpt(log_path)))
    for one in utterances:
        # A clip lasts until the next begins; what comes before the first is the first's.
        before = [clip for clip in clips if begins[clip.path] <= one.middle_s]
        (before[-1] if before else clips[0]).heard.append(one)
    return {"commands": commands, "load_s": load_s, "sound_s": own["messages"] * MESSAGE_S,
            "cpu_s": cpu_at_end - cpu_at_start, "memory_mb": memory, "gaps": own["gaps"], "dropped": own["dropped"],
            "transports": [link[3] for link in links
                           if link[0] == NAMESPACE + "/audio_stamped" and link[2] == NAMESPACE + "/recognizer"]}


# -------------------------------------------------------------------------------------------------------------- report

def quantile(values, share):
    """The least of the values that `share` of them do not exceed; None if there are none."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)] if values else None


def milliseconds(seconds):
    return number(None if seconds is None else 1000 * seconds, 0)


def clip_rows(clip):
    rows = []
    for one in clip.heard or [None]:
        if one is None:
            row = ["-", "", "", ""]
        else:
            verdict = "rejected" if not one.accepted else "accepted" if one is clip.right() else "false command"
            row = [one.text or "-", verdict, number(one.confidence, 2),
                   milliseconds(one.latency_s if one.accepted else None)]
        rows.append([(clip.said or "(background)") if not rows else ""] + row)
    return rows


def judge(clips, figures):
    """Adds to the figures how well was heard."""
    asked = [clip for clip in clips if clip.said in figures["commands"]]
    accepted = [one for clip in clips for one in clip.heard if one.accepted]
    right = [clip for clip in asked if clip.right()]
    figures.update({
        "clips": [{"file": str(clip.path), "said": clip.said, "heard": [vars(one) for one in clip.heard]}
                  for clip in clips],
        "said": len(asked), "right": len(right), "others": len(clips) - len(asked),
        "false": len(accepted) - len(right),
        "accepted": len(accepted),
        "latency_ms": {key: None if value is None else 1000 * value for key, value in (
            ("median", quantile([one.latency_s for one in accepted], 0.5)),
            ("p95", quantile([one.latency_s for one in accepted], 0.95)),
            ("own_median", quantile([one.own_latency_s for one in accepted], 0.5)))},
        "real_time_factor": figures["cpu_s"] / figures["sound_s"] if figures["sound_s"] else None})


def describe(clips, figures):
    rows = [["said", "heard", "", "confidence", "latency/ms"]]
    for clip in clips:
        rows += clip_rows(clip)
    latency, memory = figures["latency_ms"], figures["memory_mb"]
    return [line[2:] for line in table(rows, "<<<>>").splitlines()] + [
        "%d of %d commands recognised; false commands: %d, with %d clips of other speech or background among %d" %
        (figures["right"], figures["said"], figures["false"], figures["others"], len(clips)),
        "end of speech to command: at a subscriber median %s ms, p95 %s ms of %d; by the recogniser median %s ms" %
        (number(latency["median"], 0), number(latency["p95"], 0), figures["accepted"],
         number(latency["own_median"], 0)),
        "recogniser: ready after %.1f s, %.2f s of CPU time for %.1f s of sound (real-time factor %s), "
        "%.1f MB private, %.1f MB PSS" % (figures["load_s"], figures["cpu_s"], figures["sound_s"],
                                          number(figures["real_time_factor"], 3), memory["private"], memory["pss"]),
        "sound: %s, %d gaps, %d messages dropped" % (", ".join(figures["transports"]) or "no link", figures["gaps"],
                                                     figures["dropped"])]


def failures(figures, preload):
    """What must not happen, as texts. How well is heard is no matter of right or wrong here."""
    texts = []
    if figures["gaps"] or figures["dropped"]:
        texts.append("sound did not reach the recogniser: %d gaps, %d messages dropped" %
                     (figures["gaps"], figures["dropped"]))
    if preload and "SHMROS" not in figures["transports"]:
        texts.append("the sound did not go through shared memory although %s was preloaded" % preload)
    return texts


def recognise(started, events, prefix, preload, output):
    """Plays and listens. @param preload  library of π-OS or None
    @return (title, lines for the report, what failed)"""
    clips, description, commands_file = choose_clips(output)
    figures = play(started, events, prefix, preload, clips, commands_file, output)
    judge(clips, figures)
    write(output / "speech.json",
          json.dumps(dict(figures, preload=str(preload or "")), indent=2, ensure_ascii=False) + "\n")
    return description, describe(clips, figures), failures(figures, preload)
