#!/usr/bin/python3
"""Makes the list of garbage words, which stand for all speech that is no command.

  garbage_words.py [--output ../config/garbage_words.txt]

They are the most frequent words of PocketSphinx's language model en-us: of lower-case letters only, in the dictionary
with three or more sounds, and pronounced like no command. The numbers up to twelve, which are said alone more often than
other words, follow, however short.
"""

import argparse
import re
import sys
from pathlib import Path

import package_path  # noqa: F401: leads to pi_speech
import numpy as np

from pi_speech.errors import ToolError
from pronunciations import read_dictionary
from requirements import DICTIONARY, LANGUAGE_MODEL
from sphinx_files import Bytes
from training_run import PACKAGE, read_commands

COUNT = 300
LEAST_SOUNDS = 3
NUMBERS = "zero one two three four five six seven eight nine ten eleven twelve".split()
HEAD = """\
# Words that stand for all speech that is no command: the 300 most frequent words of the language model en-us of
# PocketSphinx with three or more sounds, less the ten commands of commands.yaml, the most frequent first; then numbers.
# One per line. Those that a command has are left out when they are used. Fewer words reject less of other speech; more
# cost commands and time.
"""
MAGIC = b"Trie Language Model"
QUANTISED_VALUES = 1 << 16  # of each table of probabilities
MOST_WORD_BYTES = 64        # in the mean of all words


def words_by_frequency(path):
    """Words of a binary language model of PocketSphinx (a quantised trie), the most frequent first.
    @throws ToolError"""
    file = Bytes(path)
    if not file.content.startswith(MAGIC):
        raise ToolError(f"{path}: is no binary language model of PocketSphinx; take {LANGUAGE_MODEL.name}")
    file.at = len(MAGIC)
    order = file.take(1)[0]
    if not 2 <= order <= 5:
        raise file.damaged(f"order {order}")
    count = np.frombuffer(file.take(4 * order), "<u4")[0]
    file.integers(1)  # kind of the quantisation
    # Probabilities of all orders above one, and weights of backing off of all but the highest.
    file.take(4 * QUANTISED_VALUES * (2 * (order - 2) + 1))
    unigrams = np.frombuffer(file.take(12 * (int(count) + 1)), [("log", "<f4"), ("back_off", "<f4"), ("next", "<u4")])
    words = _last_words(file, int(count))
    return [words[i].decode("latin-1") for i in np.argsort(-unigrams["log"][:count], kind="stable")]


def _last_words(file, count):
    """The texts at the end: their size in bytes, then each with a zero behind it."""
    content = file.content
    for at in range(max(file.at, len(content) - MOST_WORD_BYTES * count - 4), len(content) - 4):
        if int.from_bytes(content[at:at + 4], "little") == len(content) - at - 4:
            words = content[at + 4:].split(b"\0")
            if len(words) == count + 1 and not words[-1]:
                return words[:-1]
    raise file.damaged(f"no list of {count} words")


def choose(frequent, commands, dictionary, count=COUNT):
    """@param frequent  words, in order
    @param dictionary  word -> pronunciations, texts of phones
    @throws ToolError if there are too few"""
    spoken = {phones for command in commands for phones in dictionary.get(command, [])}
    chosen = [word for word in frequent if re.fullmatch("[a-z]{2,}", word) and word not in commands
              and word in dictionary and not spoken & set(dictionary[word])
              and len(dictionary[word][0].split()) >= LEAST_SOUNDS]
    if len(chosen) < count:
        raise ToolError(f"{len(chosen)} words of {LEAST_SOUNDS} or more sounds in the language model, must be {count}")
    chosen = chosen[:count]
    return chosen + [word for word in NUMBERS if word in dictionary and word not in chosen and word not in commands]


def text():
    """The list for the commands of pi_speech, as it is in config. @throws ToolError"""
    words = choose(words_by_frequency(LANGUAGE_MODEL), read_commands(PACKAGE / "config/commands.yaml"),
                   read_dictionary(DICTIONARY))
    return HEAD + "".join(f"{word}\n" for word in words)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, metavar="TXT", help="file to write; default: standard output")
    output = parser.parse_args().output
    try:
        words = text()
        if output:
            output.write_text(words)
        else:
            sys.stdout.write(words)
    except (OSError, ToolError) as error:
        print(f"garbage_words.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
