"""The Typer application: all commands, their help, and the exit codes of expected errors.

A command is imported when it is run, and all are for the help that lists them. The help of a command has its examples
before its options, the most used options first, and the others in panels.
"""

from __future__ import annotations

import importlib
import inspect
import io
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import typer

from markerseek._version import __version__
from markerseek.cli import STOPPED_BY_USER
from markerseek.cli.notes import notes_printed
from markerseek.cli.signals import Stopped
from markerseek.cli.terminal import print_error, print_warning
from markerseek.core import ConfigError, MarkerseekError, SearchPlan, SimulationOptions, options_of


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    """A command that has commands below it."""

    help: str
    below: Mapping[str, str]
    """Where each command below it is: file of this package, and function in it."""
    kind: str | None = None
    """Where its class is, if it has one of its own."""


_BANK = _Group(
    help="Make, look at and convert banks: scans of many angles.",
    below={
        "scan": "bank_scan:command",
        "info": "bank_info:command",
        "import": "bank_import:command",
        "export": "bank_export:command",
    },
)
_JOURNAL = _Group(
    help="List, print, follow, check and compute again the journals of runs.",
    below={
        "list": "journal:list_journals",
        "show": "journal:show",
        "follow": "journal:follow",
        "verify": "journal:verify",
        "replay": "journal:replay",
    },
)
_ROS2 = _Group(
    help="Run a search, a run that follows, a stage, an acquisition or a simulated rig as ROS 2 nodes. What follows "
    "`--ros-args` is for the node: `--ros-args -r __ns:=/left`.",
    below={
        "search": "ros2:search",
        "follow": "ros2:follow",
        "stage": "ros2:stage",
        "acquire": "ros2:acquire",
        "sim": "ros2:sim",
    },
    kind="ros2:RosGroup",
)

_COMMANDS: dict[str, dict[str, str | _Group]] = {
    "Search": {
        "search": "search:command",
        "resume": "resume:command",
        "page": "page:command",
        "igtl": "igtl:command",
        "ros2": _ROS2,
    },
    "Recordings": {
        "replay": "replay:command",
        "frame": "frame:command",
        "tooltip": "tooltip:command",
        "bank": _BANK,
        "journal": _JOURNAL,
    },
    "Rig and robot": {
        "doctor": "doctor:command",
        "calibrate": "calibrate:command",
        "register": "register:command",
        "follow": "follow:command",
    },
    "Simulation and studies": {
        "emulate": "emulate:command",
        "reproduce": "reproduce:command",
        "study": "study:command",
    },
}
"""Where each command is, in the panels of the help."""


class _LazyCommands(Mapping[str, Any]):
    """The commands of a group; the file of each is imported when the command is first asked for."""

    def __init__(self, places: Mapping[str, str | _Group], panels: Mapping[str, str]) -> None:
        self._places = places
        self._panels = panels
        self._built: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._built:
            place = self._places[name]
            panel = self._panels.get(name)
            built = _group(name, place, panel) if isinstance(place, _Group) else _command(name, place, panel)
            self._built[name] = _arranged(built)
        return self._built[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _at(place: str) -> Any:
    """Return what stands at ``file:name``."""
    file, _, name = place.partition(":")
    return getattr(importlib.import_module(f"markerseek.cli.{file}"), name)


def _command(name: str, place: str, panel: str | None) -> Any:
    """Return a command; its help is its docstring, with the section of examples as command lines."""
    function: Callable[..., None] = _at(place)
    text, _, examples = inspect.cleandoc(function.__doc__ or "").partition("\n\nExamples\n--------\n")
    # Two spaces at the end break a line in Markdown.
    lines = "  \n".join([f"{text}\n\nExamples:", *examples.splitlines()])
    app = typer.Typer(rich_markup_mode="markdown")
    app.command(name=name, help=lines, rich_help_panel=panel)(function)
    return typer.main.get_group(app).commands[name]


def _group(name: str, group: _Group, panel: str | None) -> Any:
    """Return a command with those below it."""
    app = typer.Typer(
        name=name,
        help=group.help,
        cls=None if group.kind is None else _at(group.kind),
        no_args_is_help=True,
        rich_markup_mode="markdown",
    )
    built: Any = typer.main.get_group(app)
    built.rich_help_panel = panel
    built.commands = _LazyCommands(group.below, panels={})
    return built


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(__version__)
        raise typer.Exit


def _top(
    version: bool = typer.Option(
        False, "--version", help="Print the version and end.", callback=_print_version, is_eager=True
    ),
) -> None:
    """Find a photoacoustic marker with a motorised transrectal ultrasound probe."""


@cache
def all_commands() -> Any:
    """Return the command that all others are below."""
    app = typer.Typer(
        name="markerseek",
        help="Find a photoacoustic marker with a motorised transrectal ultrasound probe.",
        epilog="Try: markerseek search --seed 1 --plot\n\n"
        "A rig file can run code: open those that you trust.\n\n"
        "Exit codes: 0 found, or all is well; 3 any other answer; 1 a fault; 2 wrong usage, or a file that cannot be "
        "read; 4 not armed; 70 a defect of this program; 74 the output cannot be written",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="markdown",
    )
    app.callback()(_top)
    built: Any = typer.main.get_command(app)
    built.commands = _LazyCommands(
        {name: place for below in _COMMANDS.values() for name, place in below.items()},
        panels={name: panel for panel, below in _COMMANDS.items() for name in below},
    )
    return _arranged(built)


FIRST = (
    *("--method", "--rig", "--arm", "--sweep", "--single", "--tolerance-mm", "--seed"),
    # Of other commands than search.
    *("--probe", "--number", "--angles", "--first-deg", "--step-deg", "--reference-deg"),
    *("--simulate", "--continue", "--once"),
    *("--journal", "--plot", "--json"),
)
"""Options that most people need; they stand in the first panel of a command with many options, in this order."""

PANELS = {
    "Search": (*(each.flag for each in options_of(SearchPlan)), "--prior", "--compare", "--registration"),
    "Rig": ("--wavelength-nm", "--pulse-energy-mj"),
    "Endoscope": ("--cameras", "--calibration-sigma-px", "--images", "--frames", "--endoscope-held"),
    "Session": (
        *("--tre-mm", "--markers", "--again", "--check", "--record", "--no-frames"),
        *("--wait-s", "--idle-s", "--light-while-waiting", "--hold", "--gate"),
    ),
    "Sessions that are kept": ("--list", "--report"),
    "Target": (
        "--tip",
        "--tool-offset-mm",
        "--tip-sigma-mm",
        "--spot",
        "--pulses",
        "--looks-per-second",
        "--point",
        "--pixel",
    ),
    "Following": ("--within-deg", "--speed-deg-s", "--rest-s", "--minutes", "--still-valid", "--igtl-port"),
    "Points": ("--target-mm", "--without", "--spot-depth-mm"),
    "Arrays and sequences": (
        *("--axes", "--first-frame", "--without-channel", "--angle-field", "--sampling-mhz"),
        "--face-radius-mm",
    ),
    "Images": ("--roi", "--pixel-mm"),
    "Tables": ("--columns", "--unit", "--deg-per-unit", "--offset-deg", "--db", "--skip-invalid"),
    "Simulation": (
        *(each.flag for each in options_of(SimulationOptions)),
        *("--textured", "--endoscope-moves", "--moves", "--speed-mm-s", "--error-mm", "--seconds"),
    ),
    "Output": ("--out", "--force", "--no-journal", "--events", "--trace"),
}
"""Panels of the other options; "More" has those that no panel names."""

MANY = 10
"""Number of options from which on a command has panels."""


def _arranged(command: Any) -> Any:
    """Return the command, with its options in their panels."""
    options = [each for each in command.params if each.param_type_name == "option"]
    for each in [*options, command.get_help_option(typer.Context(command))]:
        if getattr(each, "is_flag", False):
            # Not "<bool>": a flag takes no value.
            each.metavar = ""
    for each in command.params:
        if each not in options:
            each.metavar = each.metavar or each.name.upper()
    if len(options) > MANY:
        for each in options:
            option = each.opts[-1]
            each.rich_help_panel = None if option in FIRST else _PANEL_OF.get(option, "More")
        command.params.sort(key=lambda each: _rank(each.opts[-1]))
    return command


_PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names}


def _rank(option: str) -> int:
    """Return the place of an option in the help; arguments, and options of the later panels, keep their order."""
    order = [*FIRST, *_PANEL_OF]
    return order.index(option) if option in order else len(order) if option.startswith("--") else -1


_UsageError: Any = typer.BadParameter.__bases__[0]
"""Typer's error for wrong arguments, which has no public name."""


def run_command() -> None:
    """Run the command that the arguments name, and end the process with its exit code.

    Always raises `SystemExit`, except after Ctrl-C, at a closed pipe, or on an unexpected error.
    """
    # Of libraries: Python would print a line of their source code, which says nothing to a user.
    warnings.showwarning = print_warning
    for stream in (sys.stdout, sys.stderr):
        # A terminal without a degree sign in its encoding gets a question mark instead of an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    as_json = "--json" in sys.argv
    try:
        with notes_printed():
            sys.exit(all_commands()(standalone_mode=False))
    except SystemExit as ended:
        if isinstance(ended, Stopped):
            raise
        if isinstance(ended.__context__, BrokenPipeError):
            # Click would end with exit code 1 and without a message.
            raise ended.__context__ from None
        if ended.code == STOPPED_BY_USER:
            print_error(MarkerseekError("stopped by the user"), as_json=as_json)
        raise
    except typer.Abort:
        # Click raises Abort after Ctrl-C, and so do versions of Typer that use it.
        raise KeyboardInterrupt from None
    except (_UsageError, MarkerseekError) as problem:
        error = problem if isinstance(problem, MarkerseekError) else ConfigError(_in_words(problem))
        # If a group is called without a command, Typer has printed its help already.
        if type(problem).__name__ != "NoArgsIsHelpError":
            print_error(error, as_json=as_json)
        sys.exit(error.exit_code)


_WORDS = {
    "greater than or equal to": "at least",
    "less than or equal to": "at most",
    "valid integer": "whole number",
    "valid number": "number",
}
"""Words in Typer's messages, and the words that are printed instead."""


def _in_words(problem: Any) -> str:
    """Return what is wrong with the arguments: option, value, limit, and where to read on."""
    text = _without_hidden(problem).rstrip(".")
    option = getattr(getattr(problem, "param", None), "opts", [""])[-1]
    for begin in ("Input should be ", "is not "):
        _, wrong, limit = problem.message.partition(begin)
        if wrong and option.startswith("--"):
            for theirs, ours in _WORDS.items():
                limit = limit.replace(theirs, ours)
            text = f"{option} is {_given(option)}, it must be {limit.partition(', unable')[0].rstrip('.')}"
    path = problem.ctx.command_path if problem.ctx is not None else "markerseek"
    return f"{text[:1].lower()}{text[1:]}; see '{path} --help'"


def _without_hidden(problem: Any) -> str:
    """Return the message of the problem, in which no option is proposed that the help does not show."""
    if getattr(problem, "possibilities", None) and problem.ctx is not None:
        hidden = {name for each in problem.ctx.command.params if getattr(each, "hidden", False) for name in each.opts}
        problem.possibilities = [name for name in problem.possibilities if name not in hidden]
    text: str = problem.format_message()
    return text


def _given(option: str) -> str:
    """Return the value of an option on the command line; the last one if the option is repeated."""
    words = sys.argv[1:]
    values = [after for word, after in pairwise(words) if word == option]
    values += [word.partition("=")[2] for word in words if word.startswith(f"{option}=")]
    return repr(values[-1]) if values else "something else"
