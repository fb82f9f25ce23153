"""Rewords messages for people who write no Python.

A message of the packages names an argument or a function in backquotes, as in Python: ``first_frame=3`` or
``read_bank(scan.hdf5)``. The command line names its options and commands instead, the page its labels; other programs
get the message without backquotes (`plain`).
"""

from __future__ import annotations

import re
from collections.abc import Callable

_CALL = re.compile(r"`([a-z_]+)\(([^`]*)\)`")
_ARGUMENT = re.compile(r"`([a-z][a-z0-9_]*)(?:=([^`]*))?`")


def reworded(message: str, *, call: Callable[[str, str], str], argument: Callable[[str, str | None], str]) -> str:
    """Return a message with other words for its functions and arguments.

    ``call``: takes the name of a function and its arguments, and returns the words. ``argument``: takes the name of an
    argument and its value, None if the message has the name alone, and returns the words.
    """
    message = _CALL.sub(lambda found: call(found[1], found[2]), message)
    return _ARGUMENT.sub(lambda found: argument(found[1], found[2]), message)


def plain(message: str, *, label: Callable[[str], str] = lambda name: name.replace("_", " ")) -> str:
    """Return a message without backquotes; ``label``: what an argument is called."""
    return reworded(
        message,
        call=lambda function, arguments: f"{function}({arguments})",
        argument=lambda name, value: label(name) if value is None else f"{label(name)} {value}",
    )
