"""The program `skin`, which is inside the extension module."""

import signal
import sys

from . import _skin


def main() -> None:
    """Runs the program with this process's arguments, and ends with its exit code."""
    # Python would only note Ctrl-C, and look at it when the program has ended.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_skin.program(["skin", *sys.argv[1:]]))
