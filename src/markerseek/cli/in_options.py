"""Messages of the packages in the words of the command line: options of arguments, commands of functions and cures."""

from __future__ import annotations

import re

from markerseek.core import reworded

_OPTIONS = {
    "first_and_step_deg": "--first-deg, --step-deg",
    "allowed": "--allow",
    "angles_deg": "--angles",
    "without_channels": "--without-channel",
    "searches": "--journal",
    "stereo": "--cameras",
    "target_trus_m": "--target-mm",
}
"""Options whose name is not that of the argument with hyphens."""

_COMMANDS = {
    "answer_again": "journal replay",
    "calibrate": "calibrate",
    "find_marker": "search",
    "journal_bank": "bank import",
    "journals_in": "journal list",
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

_CURES = {
    "continue that session": "'markerseek register --continue FOLDER'",
    "leave the wrong one out": "--without",
    "leave it out of the registration": "--without",
    "measure the delay": "'markerseek calibrate --delay'",
    "name the rectangle around the tip": "--roi",
    "register points": "'markerseek register points.csv'",
    "scan a point with this rig": "'markerseek bank scan point.hdf5 --rig RIG.toml'",
    "serve them as nodes of one simulated rig": "'markerseek ros2 sim'",
    "start the acquisition node": "'markerseek ros2 acquire'",
    "what the search printed as JSON": "'markerseek search --json > result.json'",
}
"""What a message tells a person to do that no single argument or function does, and the option or command for it."""

_CURE = re.compile(rf"\b({'|'.join(_CURES)})\b(?! \(|[./\\]\w)")
"""A cure whose command does not stand behind it yet, as in the error of a child, and which is no part of a path."""

_PAIR = re.compile(r"`first_and_step_deg=\((\S+), (\S+)\)`")
_COMMA = re.compile(r", (?=(?:[^']*'[^']*')*[^']*$)")
"""A comma between two arguments, and none in the quotes of a path."""
_FLAG = re.compile(r"([a-z_]+)=True")


def in_options(message: str) -> str:
    """Return a message with the options of its arguments, and the commands of its functions and cures."""
    message = _PAIR.sub(r"--first-deg \1 --step-deg \2", message)
    message = reworded(message, call=_command, argument=_option)
    return _CURE.sub(lambda found: f"{found[0]} ({_CURES[found[0]]})", message)


def _command(function: str, arguments: str) -> str:
    """Return a command in quotes: double ones if a path stands in single ones."""
    if function not in _COMMANDS:
        return f"{function}({arguments})"
    given = (_FLAG.sub(lambda found: _option(found[1], None), each) for each in _COMMA.split(arguments))
    command = " ".join(["markerseek", _COMMANDS[function], *filter(None, given)])
    return f'"{command}"' if "'" in command else f"'{command}'"


def _option(argument: str, value: str | None) -> str:
    option = _OPTIONS.get(argument) or f"--{argument.replace('_', '-')}"
    return option if value is None else f"{option} {value}"
