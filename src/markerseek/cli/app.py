"""The Typer application with all commands, and the exit codes of expected errors."""

from __future__ import annotations

import io
import sys
import warnings
from collections.abc import Callable
from functools import cache

import typer

from markerseek._version import __version__
from markerseek.cli import (
    STOPPED_BY_USER,
    bank,
    benchmark,
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
    track,
)
from markerseek.cli.signals import Stopped
from markerseek.cli.terminal import print_error, print_json, print_warning
from markerseek.core import MarkerseekError

WRONG_USAGE = 2
"""Exit code after arguments that the command does not take."""

app = typer.Typer(
    name="markerseek",
    help="Find a photoacoustic marker with a motorised transrectal ultrasound probe.",
    epilog="Try: markerseek search --seed 1 --plot\n\n"
    "Exit codes: 0 found, or all is well; 3 any other answer; 1 a fault; 2 wrong usage, or a file that cannot be read; "
    "4 not armed, or a driver not trusted; 70 a defect of this program; 74 the output cannot be written",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
_COMMANDS = {
    "search": search,
    "page": page,
    "igtl": igtl,
    "replay": replay,
    "resume": resume,
    "frame": frame,
    "calibrate": calibrate,
    "register": register,
    "tooltip": tooltip,
    "track": track,
    "reproduce": reproduce,
    "study": study,
    "benchmark": benchmark,
    "emulate": emulate,
    "doctor": doctor,
}
for name, module in _COMMANDS.items():
    app.command(name=name, epilog=module.EXAMPLES)(module.command)
app.add_typer(bank.app)
app.add_typer(ros2.app)
app.add_typer(journal.app)


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
def _built() -> Callable[[], object]:
    """All commands, built once: it takes 40 ms, and a test runs many of them in its process."""
    return typer.main.get_command(app)


def run() -> None:
    """Run the command that the arguments name, and end the process with its exit code.

    Raises `SystemExit` always, unless something happens that was not foreseen.
    """
    # Warnings as one line: the default prints a line of source code that says nothing to a user.
    warnings.showwarning = print_warning
    for stream in (sys.stdout, sys.stderr):
        # A terminal without a degree sign in its encoding gets a question mark instead of an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    as_json = "--json" in sys.argv
    try:
        _built()()
    except Stopped:
        raise
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):
            # Click ends with exit code 1 and without a word.
            raise ended.__context__ from None
        if ended.code == STOPPED_BY_USER:
            print_error(MarkerseekError("stopped by the user"), as_json=as_json)
        elif ended.code == WRONG_USAGE and as_json:
            print_json({"error": "wrong usage; standard error says what is wrong", "kind": "UsageError"})
        raise
    except MarkerseekError as error:
        print_error(error, as_json=as_json)
        sys.exit(error.exit_code)
