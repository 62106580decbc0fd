"""Cepstra as PocketSphinx makes them when it recognises, and which pronunciation a clip has."""

import re
import shutil

import package_path  # noqa: F401: leads to pi_speech

from pi_speech.errors import ToolError
from requirements import ACOUSTIC_MODEL


def grammar_text(word):
    return f"#JSGF V1.0;\ngrammar word;\npublic <word> = {word};\n"


def compute(call, name, keys, sounds, features, dictionary):
    """KEY.mfc of each KEY.raw. pocketsphinx_batch learns the noise anew with each clip, as pi_speech does.
    @param dictionary  file; what is recognised does not matter here"""
    scratch = features.with_name(features.name + ".partial")
    for folder in (scratch, features):
        shutil.rmtree(folder, ignore_errors=True)
    scratch.mkdir(parents=True)
    control, grammar = scratch / "clips.ctl", scratch / "word.gram"
    control.write_text("".join(f"{key}\n" for key in keys))
    grammar.write_text(grammar_text(dictionary.read_text().split()[0]))
    call(name, ["pocketsphinx_batch", "-hmm", ACOUSTIC_MODEL, "-dict", dictionary, "-jsgf", grammar,
                "-remove_silence", "no", "-beam", "1e-5", "-wbeam", "1e-5", "-pbeam", "1e-5", "-adcin", "yes",
                "-cepdir", sounds, "-cepext", ".raw", "-ctl", control, "-hyp", scratch / "hyp", "-mfclogdir", scratch])
    files = sorted(scratch.glob("*.mfc"))  # numbered in the order of the clips
    if len(files) != len(keys):
        raise ToolError(f"pocketsphinx_batch has made cepstra of {len(files)} of {len(keys)} clips in {sounds}: is one "
                        "of them empty?")
    for key, file in zip(keys, files):
        file.rename(scratch / f"{key}.mfc")
    scratch.rename(features)


def variants_of(segments, words):
    """@param segments  lines of pocketsphinx_batch -hypseg: the name of the clip first
    @return name -> the first of the words in it, with the number of its variant: on(2)"""
    wanted = re.compile(r"(?:" + "|".join(map(re.escape, words)) + r")(?:\(\d+\))?")
    found = {}
    for line in segments.splitlines():
        key, *rest = line.split()
        variant = next((part for part in rest if wanted.fullmatch(part)), None)
        if variant:
            found[key] = variant
    return found


def choose_variants(call, word, keys, features, dictionary, folder):
    """Which pronunciation of the word each clip has, by a forced choice of the model en-us.
    @return key -> word with the number of its variant; a clip that does not fit keeps the word itself"""
    folder.mkdir(exist_ok=True)
    control, grammar, segments = (folder / f"{word}.{name}" for name in ("ctl", "gram", "segments"))
    control.write_text("".join(f"{key}\n" for key in keys))
    grammar.write_text(grammar_text(word))
    call(f"variants_{word}", ["pocketsphinx_batch", "-hmm", ACOUSTIC_MODEL, "-dict", dictionary, "-jsgf", grammar,
                              "-cepdir", features, "-cepext", ".mfc", "-ctl", control, "-hyp", folder / f"{word}.hyp",
                              "-hypseg", segments])
    found = variants_of(segments.read_text(), [word])
    return {key: found.get(key, word) for key in keys}
