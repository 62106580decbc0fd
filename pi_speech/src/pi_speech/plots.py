"""Draws to files, without a display."""

from pi_speech.errors import ToolError


def pyplot():
    """@throws ToolError if matplotlib is not installed"""
    try:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot as module
    except ImportError as error:
        raise ToolError("matplotlib is not installed (Debian: python3-matplotlib)") from error
    return module


def save(figure, path):
    """@throws ToolError"""
    try:
        figure.savefig(path, dpi=110, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise ToolError(f"{path}: {error}") from error
    finally:
        pyplot().close(figure)
