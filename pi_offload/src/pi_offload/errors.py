"""The error that a tool reports in one line."""


class ToolError(Exception):
    """What cannot be done and why: names object, value and way out."""
