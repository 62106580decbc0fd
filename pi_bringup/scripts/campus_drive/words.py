"""Sound files of the words that are said during a drive."""

import ctypes
import os
import subprocess
import sys
import wave
from pathlib import Path

if __name__ != "__main__":  # as a program it is alone
    from first_drive.errors import DemoError

# Clips of the recorded commands that the recogniser understands; of other words the first by name. Where a word ends is
# a matter of level: of this "stop" the end by energy and that of the recogniser are within 0.15 s.
CHOSEN = {"go": "0cb74144_nohash_1.flac", "stop": "18f8afd5_nohash_0.flac", "yes": "0cb74144_nohash_0.flac"}
LIBRARY = "libespeak-ng.so.1"
VOICE = b"en-us"
WORDS_PER_MINUTE = 140
SILENCE_S = 0.3  # before and behind a synthesised word
ESPEAK_SYNCHRONOUS, ESPEAK_UTF8, ESPEAK_RATE, ESPEAK_DONT_EXIT = 2, 1, 1, 0x8000


def sound_of(text, output):
    """@param text  what is said; a path of a sound file is taken as it is. @return path of a sound file"""
    if Path(text).is_file():
        return Path(text).resolve()
    if os.environ.get("PI_EDGE_DATA"):
        folder = Path(os.environ["PI_EDGE_DATA"]).resolve() / "speech" / "commands" / text
        if folder.is_dir():
            files = sorted(path for path in folder.iterdir() if path.suffix in (".flac", ".wav"))
            chosen = folder / CHOSEN.get(text, "")
            if files:
                return chosen if chosen in files else files[0]
    return synthesise(text, output / ("said_%s.wav" % "_".join(text.split())))


def synthesise(text, path):
    """Writes a WAV file by espeak-ng, which has one state per process: in one of its own. @return path of the file.
    @throws DemoError"""
    result = subprocess.run([sys.executable, __file__, text, str(path)], stdin=subprocess.DEVNULL,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    if result.returncode != 0:
        raise DemoError("\"%s\" cannot be said: %s; or set PI_EDGE_DATA for recorded words" %
                        (text, result.stderr.strip().splitlines()[-1] if result.stderr.strip() else "espeak-ng failed"))
    return path


def speak(text, path):
    """Ends the process with a message if it cannot."""
    try:
        library = ctypes.CDLL(LIBRARY)
    except OSError:
        sys.exit("%s cannot be loaded; run: apt-get install libespeak-ng1" % LIBRARY)
    rate = library.espeak_Initialize(ESPEAK_SYNCHRONOUS, 0, None, ESPEAK_DONT_EXIT)
    if rate <= 0:
        sys.exit("espeak-ng does not find its data; run: apt-get install espeak-ng-data")
    sound = bytearray()

    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.c_void_p)
    def collect(samples, count, _):
        if samples and count > 0:
            sound.extend(ctypes.string_at(samples, 2 * count))
        return 0

    library.espeak_SetSynthCallback(collect)
    library.espeak_SetVoiceByName(VOICE)
    library.espeak_SetParameter(ESPEAK_RATE, WORDS_PER_MINUTE, 0)
    said = text.encode("utf-8")
    library.espeak_Synth(said, ctypes.c_size_t(len(said) + 1), 0, 1, 0, ESPEAK_UTF8, None, None)
    if not sound:
        sys.exit("espeak-ng made no sound of it")
    silence = bytes(2 * int(SILENCE_S * rate))
    try:
        with wave.open(str(path), "wb") as file:
            file.setparams((1, 2, rate, 0, "NONE", "not compressed"))
            file.writeframes(silence + bytes(sound) + silence)
    except OSError as error:
        sys.exit("%s cannot be written: %s" % (path, error.strerror))


if __name__ == "__main__":
    speak(*sys.argv[1:])
