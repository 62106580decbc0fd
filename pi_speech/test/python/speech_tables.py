"""Made tables of recognised clips for the tests of the tools."""

COLUMNS = ("file", "text", "confidence", "accepted", "reason", "latency_ms", "word", "speaker")


def clip(number, word, text, confidence, accepted, reason="", latency=200.0, speaker="a"):
    """A row; accepted as True or False."""
    if not accepted and not reason:
        reason = "confidence too low"
    return (f"{number}.flac", text, confidence, "yes" if accepted else "no", reason, latency, word, speaker)


# Commands go, left and stop; 2 clips of other speech and 2 of background.
CLIPS = [
    clip(1, "stop", "stop", 0.9, True, latency=100.0, speaker="a"),
    clip(2, "stop", "stop", 0.8, True, latency=300.0, speaker="b"),
    clip(3, "stop", "go", 0.7, True, speaker="b"),
    clip(4, "stop", "stop", 0.4, False, speaker="c"),
    clip(5, "go", "go", 0.95, True, latency="nan", speaker="a"),
    clip(6, "go", "stop", 0.6, True, speaker="c"),
    clip(7, "left", "left", 0.85, True, latency=500.0, speaker="c"),
    clip(8, "left", "", 0.0, False, "no speech", "nan", speaker="a"),
    clip(9, "_unknown_", "go", 0.65, True, speaker="b"),
    clip(10, "_unknown_", "left", 0.99, False, "too long", speaker="c"),
    clip(11, "_silence_", "", 0.0, False, "no speech", "nan", speaker="noise"),
    clip(12, "_silence_", "stop", 0.3, False, speaker="noise"),
]


def as_text(rows, columns=COLUMNS):
    return "\n".join("\t".join(map(str, row)) for row in [columns, *rows]) + "\n"
