"""All steps of train_models, in order."""

import argparse
import hashlib
import json
import os
import re
import shutil
import signal
import sys
from collections import Counter
from pathlib import Path

import package_path  # noqa: F401: leads to pi_speech
import numpy as np
import yaml

import adapt
import features
import folds
import noise
import pronunciations
import requirements
from clips import read_clips, read_flac, write_list
from pi_speech.errors import ToolError
from steps import Steps

OTHER, BACKGROUND = "_unknown_", "_silence_"  # words in the list of clips that are no command
TAIL_S = "0.5"  # of its own background behind each clip
PACKAGE = Path(__file__).resolve().parents[1]


def number_from(least):
    """A type for argparse: an integer that is at least that."""
    def convert(text):
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError(f"{text}, must be at least {least}")
        return value
    convert.__name__ = "integer"
    return convert


def share(text):
    """A type for argparse: a number between 0 and 1."""
    value = float(text)
    if not 0.0 < value < 1.0:
        raise argparse.ArgumentTypeError(f"{text}, must be between 0 and 1")
    return value


def parse(arguments):
    parser = argparse.ArgumentParser(prog="train_models", formatter_class=argparse.RawDescriptionHelpFormatter,
                                     description="Trains the models of pi_speech for its commands. See README.md.")
    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="holds commands.tsv and the clips")
    parser.add_argument("--noise", type=Path, nargs="+", default=[], metavar="WAV",
                        help="noises of the noisy copies, mono, 16 kHz, 16 bits; white and pink are always among them")
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="what is made on the way")
    parser.add_argument("--output", type=Path, required=True, metavar="DIR",
                        help="where adaptation/, confidence.yaml and training.json go")
    parser.add_argument("--commands", type=Path, default=PACKAGE / "config/commands.yaml", metavar="YAML",
                        help="table of the commands, of one word each; default: that of pi_speech")
    parser.add_argument("--every", type=number_from(1), default=1, metavar="N",
                        help="take each Nth clip of a word only, for a trial; default: %(default)s")
    parser.add_argument("--seed", type=number_from(0), default=1, help="default: %(default)s")
    parser.add_argument("--max-false-other", type=share, default=0.06,
                        help="share of clips of other speech that may be accepted; default: %(default)s")
    parser.add_argument("--max-false-background", type=share, default=0.03,
                        help="the same of background; default: %(default)s")
    parser.add_argument("--tools", type=Path, metavar="DIR",
                        help="of recognize_files; default: by CMAKE_PREFIX_PATH")
    return parser.parse_args(arguments)


def sha256(path):
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error


def read_commands(path):
    """@return texts of a table of commands, in order. @throws ToolError"""
    try:
        entries = yaml.safe_load(Path(path).read_text())["commands"]
        if not isinstance(entries, list):
            raise TypeError("commands is no list")
        texts = [entry["text"] if isinstance(entry, dict) else entry for entry in entries]
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise ToolError(f"{path}: is no table of commands, as config/commands.yaml is one: {error}") from error
    bad = [text for text in texts if not isinstance(text, str) or len(text.split()) != 1]
    if bad or not texts:
        raise ToolError(f"{path}: {bad[0] if bad else 'no command'}, must be texts of one word, as the clips are; "
                        "quote yes, no, on and off")
    return texts


def package_version():
    found = re.search(r"<version>([^<]*)</version>", (PACKAGE / "package.xml").read_text())
    return found.group(1) if found else ""


def join_tables(paths, output):
    """Tables with the same first line as one."""
    texts = [path.read_text() for path in paths]
    output.write_text(texts[0] + "".join(text.partition("\n")[2] for text in texts[1:]))


class Run:
    def __init__(self, arguments):
        """@throws ToolError if something that is needed is not there"""
        requirements.check_packages()
        self.arguments, self.work = arguments, arguments.work.resolve()
        self.tools = requirements.find_tools(arguments.tools)
        self.words = tuple(read_commands(arguments.commands))
        self.clips = read_clips(arguments.data.resolve(), arguments.every)
        folds.check(self.clips, self.words)
        lacking = [label for label in (OTHER, BACKGROUND) if not any(clip.word == label for clip in self.clips)]
        if lacking:
            raise ToolError(f"{arguments.data / 'commands.tsv'}: no clip of {', '.join(lacking)}: the confidence needs "
                            "other speech and background, too")
        self.commands = [clip for clip in self.clips if clip.word in self.words]
        self.noises = {path.stem: noise.read_noise(path) for path in arguments.noise}
        if len(self.noises) != len(arguments.noise):
            raise ToolError("--noise: two files have the same name; rename one")
        self.pronunciations = pronunciations.of_words(
            self.words, pronunciations.read_dictionary(requirements.DICTIONARY), self._extra())
        self.base = adapt.BaseModel(self.work / "base")
        self.settings = {
            "commands": list(self.words), "every": arguments.every, "seed": arguments.seed,
            "data": {"commands.tsv": sha256(arguments.data / "commands.tsv")},
            "noise": {path.name: sha256(path) for path in arguments.noise},
            "adaptation": {"tau_means": adapt.TAU_MEANS, "tau_weights": adapt.TAU_WEIGHTS,
                           "snr_db": [noise.LEAST_SNR_DB, noise.MOST_SNR_DB]},
            "versions": {"pi_speech": package_version(), **requirements.versions()}}
        models = [*range(folds.FOLDS), folds.ALL]
        steps = 8 + 2 * folds.FOLDS + len(models) + folds.FOLDS
        self.steps = Steps(self.work, self.settings, steps, lambda line: print(line, file=sys.stderr, flush=True))
        self.models = models

    def _extra(self):
        return {word: phones for word, phones in pronunciations.EXTRA.items() if word in self.words}

    def all(self):
        """Every step. @return the summary, as in training.json"""
        run, keys = self.steps.run, [clip.key for clip in self.commands]
        run("lists", self.write_lists)
        run("samples", self.write_samples)
        copies = run("noisy_copies", self.write_noisy_copies)
        run("base_model", self.base.write, self.steps.call, pronunciations.dictionary_text(self.pronunciations))
        for copy in ("clean", "noisy"):
            run(f"features_{copy}", features.compute, self.steps.call, f"features_{copy}", keys,
                self.work / f"samples_{copy}", self.work / f"features_{copy}", self.base.dictionary)
        variants = run("pronunciations", self.choose_variants)
        for part, clips in enumerate(folds.split(self.commands)):
            transcripts = {clip.key: variants.get(clip.key, clip.word) for clip in clips}
            for copy in ("clean", "noisy"):
                name = f"counts_{copy}_{part}"
                run(name, adapt.count, self.steps.call, self.base, name, transcripts, self.work / f"features_{copy}",
                    self.work / name)
        frames = {model: run(f"adaptation_{model}", self.adapt, model) for model in self.models}
        for fold in range(folds.FOLDS):
            run(f"evidence_{fold}", self.gather_evidence, fold)
        figures = run("confidence", self.calibrate, again=True)
        return self.deliver(copies, variants, frames, figures)

    def write_lists(self):
        write_list(self.work / "clips.tsv", self.clips)
        for fold, part in enumerate(folds.split(self.clips)):
            write_list(self.work / f"clips_{fold}.tsv", part)

    def _samples(self, copy, clip):
        return self.work / f"samples_{copy}" / f"{clip.key}.raw"

    def write_samples(self):
        (self.work / "samples_clean").mkdir(exist_ok=True)
        for clip in self.commands:
            self._samples("clean", clip).write_bytes(read_flac(clip.path).tobytes())

    def write_noisy_copies(self):
        """@return key -> noise and SNR"""
        (self.work / "samples_noisy").mkdir(exist_ok=True)
        made = {}
        for clip in self.commands:
            samples = np.fromfile(self._samples("clean", clip), "<i2")
            mixed, kind, snr_db = noise.noisy_copy(samples, clip.key, self.noises, self.arguments.seed)
            self._samples("noisy", clip).write_bytes(mixed.tobytes())
            made[clip.key] = {"noise": kind, "snr_db": round(snr_db, 1)}
        return made

    def choose_variants(self):
        """@return key -> variant, of the words with several pronunciations"""
        variants = {}
        for word, spoken in self.pronunciations.items():
            if len(spoken) > 1:
                keys = [clip.key for clip in self.commands if clip.word == word]
                variants.update(features.choose_variants(self.steps.call, word, keys, self.work / "features_clean",
                                                         self.base.dictionary, self.work / "variants"))
        return variants

    def adapt(self, model):
        counts = [self.work / f"counts_{copy}_{part}" for copy in ("clean", "noisy")
                  for part in folds.training_parts(model)]
        return adapt.adapt(self.base, counts, self.work / f"adaptation_{model}",
                           pronunciations.extra_text(self._extra()))

    def gather_evidence(self, fold):
        """Of the fold's speakers by models that have not heard them."""
        folder = self.work / "evidence"
        folder.mkdir(exist_ok=True)
        self.steps.call(f"evidence_{fold}", [
            self.tools["recognize_files"], self.work / f"clips_{fold}.tsv", "--quiet", "--tail", TAIL_S,
            "--commands", self.arguments.commands, "--adaptation", self.work / f"adaptation_{fold}",
            "--word-network", "none",
            "--output", folder / f"results_{fold}.tsv", "--evidence", folder / f"evidence_{fold}.tsv"])

    def calibrate(self):
        """@return what calibrate_confidence says about clips that were held out"""
        folder = self.work / "evidence"
        other = {clip.word for clip in self.clips} - {*self.words, BACKGROUND}
        join_tables([folder / f"evidence_{fold}.tsv" for fold in range(folds.FOLDS)], folder / "evidence.tsv")
        said = self.steps.call("calibrate_confidence", [
            sys.executable, PACKAGE / "scripts/calibrate_confidence",
            "--evidence", folder / "evidence.tsv", "--output", self.work / "confidence.yaml", "--plot", self.work / "confidence.png",
            "--max-false-other", self.arguments.max_false_other,
            "--max-false-background", self.arguments.max_false_background,
            "--other", ",".join(sorted(other)), "--background", BACKGROUND],
            env={**os.environ, "PYTHONPATH": str(PACKAGE / "src")})
        return dict(line.split(": ", 1) for line in said.splitlines() if ": " in line)

    def deliver(self, copies, variants, frames, figures):
        """Copies the models and writes training.json. @return its content"""
        output = self.arguments.output
        files = {f"adaptation/{name}": self.work / "adaptation_all" / name
                 for name in ("means", "sendump", "pronunciations.dict")}
        files.update({"confidence.yaml": self.work / "confidence.yaml",
                      "confidence.png": self.work / "confidence.png"})
        summary = {
            **self.settings,
            "clips": dict(sorted(Counter(clip.word for clip in self.clips).items())),
            "speakers": len({clip.speaker for clip in self.commands}),
            "clips_of_parts": [len(part) for part in folds.split(self.clips)],
            "noisy_copies": dict(sorted(Counter(copy["noise"] for copy in copies.values()).items())),
            "pronunciations": dict(sorted(Counter(variants.values()).items())),
            "frames_of_adaptation": frames[folds.ALL],
            "limits": {"max_false_other": self.arguments.max_false_other,
                       "max_false_background": self.arguments.max_false_background},
            "held_out": figures,
            "sha256": {name: sha256(path) for name, path in files.items()}}
        try:
            (output / "adaptation").mkdir(parents=True, exist_ok=True)
            for name, path in files.items():
                shutil.copyfile(path, output / f"{name}.partial")
                (output / f"{name}.partial").replace(output / name)
            (output / "training.json").write_text(json.dumps(summary, indent=2) + "\n")
        except OSError as error:
            raise ToolError(f"{output}: cannot be written: {error.strerror or error}") from error
        return summary


def main(arguments=None):
    """@return the exit status"""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # programs that it has started end with it
    try:
        run = Run(parse(arguments))
        summary = run.all()
        run.steps.close()
        for name, said in summary["held_out"].items():
            print(f"{name}: {said}")
        print(f"models: {run.arguments.output}")
    except ToolError as error:
        print(f"train_models: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("train_models: stopped; the same command goes on from here", file=sys.stderr)
        return 130
    return 0
