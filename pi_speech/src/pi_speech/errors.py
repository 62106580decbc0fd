"""The error that a tool reports in one line."""


class ToolError(Exception):
    """What cannot be done and why: names object, value and way out."""


def name_some(names, most=5):
    """The first few of a list, for an error."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
