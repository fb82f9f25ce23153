"""Messages of the packages in the words of the command line: options in place of arguments, commands of functions.

Below `cli` a message names an argument or a function in backquotes, as Python has it: ```first_frame=3```.
"""

from __future__ import annotations

import re

_OPTIONS = {
    "first_and_step_deg": "--first-deg, --step-deg",
    "allowed": "--allow",
    "angles_deg": "--angles",
    "without_channels": "--without-channel",
    "searches": "--journal",
    "stereo": "--cameras",
}
"""Options of arguments that have another name; of the others it is the argument's, with hyphens."""

_COMMANDS = {
    "answer_again": "journal replay",
    "calibrate": "calibrate",
    "find_marker": "search",
    "journal_bank": "bank import",
    "load_frame": "frame",
    "read_bank": "bank info",
    "read_journal": "journal show",
    "replayed": "replay",
    "resumed_run": "resume",
    "run_study": "study",
    "scan_bank": "bank scan --continue",
    "sensitive_range": "tooltip",
    "write_bank": "bank export",
}
"""Commands that do what a function does."""

_PAIR = re.compile(r"`first_and_step_deg=\((\S+), (\S+)\)`")
_CALL = re.compile(r"`([a-z_]+)\(([^`]*)\)`")
_COMMA = re.compile(r", (?=(?:[^']*'[^']*')*[^']*$)")
"""A comma between two arguments, and none in the quotes of a path."""
_ARGUMENT = re.compile(r"`([a-z][a-z0-9_]*)(?:=([^`]*))?`")


def in_options(message: str) -> str:
    """Return a message with the options of its arguments, and the commands of its functions."""
    message = _PAIR.sub(r"--first-deg \1 --step-deg \2", message)
    message = _CALL.sub(lambda found: _command(found[1], found[2]), message)
    return _ARGUMENT.sub(lambda found: _option(found[1], found[2]), message)


def _command(function: str, arguments: str) -> str:
    words = ["markerseek", _COMMANDS[function], *filter(None, _COMMA.split(arguments))]
    return f"'{' '.join(words)}'"


def _option(argument: str, value: str | None) -> str:
    option = _OPTIONS.get(argument) or f"--{argument.replace('_', '-')}"
    return option if value is None else f"{option} {value}"
