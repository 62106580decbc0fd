"""How the commands are spoken: of the dictionary, and of what it lacks."""

import re

import package_path  # noqa: F401: leads to pi_speech

from pi_speech.errors import ToolError

# Heard in the recordings, not in the dictionary: off as in "father", common in American English.
EXTRA = {"off": ["AA F"]}
EXTRA_HEAD = "## Pronunciations that the dictionary lacks.\n"


def read_dictionary(path):
    """@return word -> pronunciations, each a text of phones. @throws ToolError"""
    words = {}
    try:
        with open(path, encoding="latin-1") as file:
            for line in file:
                parts = line.split()
                if parts:
                    words.setdefault(re.sub(r"\(\d+\)$", "", parts[0]), []).append(" ".join(parts[1:]))
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    return words


def of_words(words, dictionary, extra):
    """@return word -> pronunciations, those of extra last. @throws ToolError"""
    unknown = [word for word in words if word not in dictionary and word not in extra]
    if unknown:
        raise ToolError(f"{', '.join(unknown)}: not in the dictionary; give words that it has")
    return {word: list(dict.fromkeys(dictionary.get(word, []) + extra.get(word, []))) for word in words}


def dictionary_text(pronunciations):
    """As Sphinx reads it: on, on(2), ..."""
    return "".join(f"{word}{f'({number})' if number > 1 else ''} {phones}\n"
                   for word, all_phones in pronunciations.items() for number, phones in enumerate(all_phones, 1))


def extra_text(extra):
    """As pi_speech reads it."""
    return EXTRA_HEAD + "".join(f"{word}  {phones}\n" for word, all_phones in extra.items() for phones in all_phones)
