"""The Typer application with all commands, and the exit codes of expected errors."""

from __future__ import annotations

import io
import sys
import warnings
from functools import cache
from itertools import pairwise
from typing import Any

import typer

from markerseek._version import __version__
from markerseek.cli import (
    STOPPED_BY_USER,
    bank,
    calibrate,
    doctor,
    emulate,
    frame,
    igtl,
    journal,
    page,
    register,
    replay,
    reproduce,
    resume,
    ros2,
    search,
    study,
    tooltip,
)
from markerseek.cli.help import add_command, arranged
from markerseek.cli.signals import Stopped
from markerseek.cli.terminal import print_error, print_warning
from markerseek.core import ConfigError, MarkerseekError

app = typer.Typer(
    name="markerseek",
    help="Find a photoacoustic marker with a motorised transrectal ultrasound probe.",
    epilog="Try: markerseek search --seed 1 --plot\n\n"
    "A rig file can run code: open those that you trust.\n\n"
    "Exit codes: 0 found, or all is well; 3 any other answer; 1 a fault; 2 wrong usage, or a file that cannot be read; "
    "4 not armed; 70 a defect of this program; 74 the output cannot be written",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
_COMMANDS: dict[str, dict[str, Any]] = {
    "Search": {"search": search, "resume": resume, "page": page, "igtl": igtl, "ros2": ros2.app},
    "Recordings": {"replay": replay, "frame": frame, "tooltip": tooltip, "bank": bank.app, "journal": journal.app},
    "Rig and robot": {"doctor": doctor, "calibrate": calibrate, "register": register},
    "Simulation and studies": {"emulate": emulate, "reproduce": reproduce, "study": study},
}
for panel, commands in _COMMANDS.items():
    for name, command in commands.items():
        if isinstance(command, typer.Typer):
            app.add_typer(command, rich_help_panel=panel)
        else:
            add_command(app, name, command.command, command.EXAMPLES, panel=panel)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _top(
    version: bool = typer.Option(
        False, "--version", help="Print the version and end.", callback=_print_version, is_eager=True
    ),
) -> None:
    """Find a photoacoustic marker with a motorised transrectal ultrasound probe."""


@cache
def _built() -> Any:
    """All commands, built once: it takes 40 ms, and a test runs many of them in one process."""
    return arranged(typer.main.get_command(app))


_UsageError: Any = typer.BadParameter.__bases__[0]
"""Typer's error for wrong arguments, which has no public name."""


def run() -> None:
    """Run the command that the arguments name, and end the process with its exit code.

    Always raises `SystemExit`, except after Ctrl-C, at a closed pipe, or on an unexpected error.
    """
    # Warnings as one line: the default prints a line of source code that says nothing to a user.
    warnings.showwarning = print_warning
    for stream in (sys.stdout, sys.stderr):
        # A terminal without a degree sign in its encoding gets a question mark instead of an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    as_json = "--json" in sys.argv
    try:
        sys.exit(_built()(standalone_mode=False))
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
    """What is wrong with the arguments: option, value, limit, and where to read on."""
    text = problem.format_message().rstrip(".")
    option = getattr(getattr(problem, "param", None), "opts", [""])[-1]
    for begin in ("Input should be ", "is not "):
        _, wrong, limit = problem.message.partition(begin)
        if wrong and option.startswith("--"):
            for theirs, ours in _WORDS.items():
                limit = limit.replace(theirs, ours)
            text = f"{option} is {_given(option)}, it must be {limit.partition(', unable')[0].rstrip('.')}"
    path = problem.ctx.command_path if problem.ctx is not None else "markerseek"
    return f"{text[:1].lower()}{text[1:]}; see '{path} --help'"


def _given(option: str) -> str:
    """Value of an option on the command line; the last one if the option is repeated."""
    words = sys.argv[1:]
    values = [after for word, after in pairwise(words) if word == option]
    values += [word.partition("=")[2] for word in words if word.startswith(f"{option}=")]
    return repr(values[-1]) if values else "something else"
