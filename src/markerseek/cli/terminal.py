"""Output of all commands: standard output and error, JSON, and progress bars.

Programs read one JSON object on standard output (``--json``); progress, warnings and errors go to standard error.
"""

from __future__ import annotations

import json
import sys
import time
import unicodedata
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING, Any

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from markerseek.cli.in_options import in_options
from markerseek.core import ConfigError, MarkerseekError

if TYPE_CHECKING:
    from markerseek.records.journal import RunView

_CONTROL = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories of control characters: control, formatting, line and paragraph separators; and surrogates, which
stand for the bytes of a file's name that are no text."""


def printable(text: str) -> str:
    """Return a text with control characters as escapes, so that a file or device cannot control the terminal.

    Line feeds and tabs stay.
    """
    return _escaped(text, lambda char: char if char in "\n\t" else repr(char)[1:-1])


def _escaped(text: str, escape: Callable[[str], str]) -> str:
    if text.isprintable():
        return text
    return "".join(escape(char) if unicodedata.category(char) in _CONTROL else char for char in text)


def one_line(text: str) -> str:
    """Return a text escaped for one line of Rich markup: line feeds, control characters and brackets."""
    return escape(printable(text).replace("\n", "\\n"))


def local_time(begun: str) -> str:
    """Return a time in the zone of this computer."""
    try:
        return f"{datetime.fromisoformat(begun).astimezone():%Y-%m-%d %H:%M %Z}"
    # The file may come from somebody else and hold any text.
    except (ValueError, OverflowError, OSError):
        return begun


class SafeConsole(Console):
    """A console that prints control characters as escapes, also in tables."""

    def render_str(self, text: str, **options: Any) -> Text:
        """Return the text, escaped, with its markup applied."""
        return super().render_str(printable(text), **options)

    def on_broken_pipe(self) -> None:
        """Leave it to `markerseek.cli.main`; Rich would end the command without a word."""
        raise  # noqa: PLE0704  Rich calls this where it has caught the error


# soft_wrap: a long path stays in one piece, to be copied. No emoji: ":x:" may be a part of it.
stdout = SafeConsole(highlight=False, emoji=False, soft_wrap=True)
"""Standard output, for people."""

stderr = SafeConsole(stderr=True, highlight=False, emoji=False, soft_wrap=True)
"""Standard error: progress, warnings, errors."""


def print_json(value: object) -> None:
    """Write one JSON object to standard output; bytes of file names that are not Unicode become escapes."""
    plain = msgspec.to_builtins(value, builtin_types=(msgspec.Raw,))
    text = msgspec.json.encode(_readable(plain)).decode("utf-8")
    # msgspec escapes ASCII control characters only; terminals interpret others (C1, bidirectional marks) as well.
    sys.stdout.write(_escaped(text, lambda char: json.dumps(char)[1:-1]) + "\n")
    sys.stdout.flush()


def _readable(value: object) -> object:
    match value:
        case str():
            return value.encode("utf-8", "backslashreplace").decode()
        case dict():
            return {key: _readable(each) for key, each in value.items()}
        case list() | tuple():
            return [_readable(each) for each in value]
        case _:
            return value


def new_table(*headings: str, left: Collection[str] = (), no_wrap: bool = False) -> Table:
    """Return an empty table; the columns named in `left` are aligned left, all others right."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in headings:
        # Escaped, because Rich reads a unit in brackets as markup.
        table.add_column(escape(heading), justify="left" if heading in left else "right", no_wrap=no_wrap)
    return table


def scaled(option: str, value: float | None, unit: float, *, most: float) -> float | None:
    """Return the value of an option in SI units; None if it was not given.

    ``unit``: factor to SI units. ``most``: largest plausible value, in the unit of the option.
    """
    if value is None:
        return None
    if not 0 < value <= most:
        raise ConfigError(f"{option} is {value:g}, it must be positive and at most {most:g}; check the unit")
    return value * unit


def print_error(error: MarkerseekError, *, as_json: bool) -> None:
    """Print an error on standard error, and as a JSON object on standard output if asked."""
    message = in_options(str(error))
    stderr.print(f"[bold red]error:[/] {escape(message)}")
    if as_json:
        print_json({"error": message, "kind": type(error).__name__})


class ProgressLines:
    """Lines of a long task on standard error, where that is no terminal: what begins, and now and then what is left.

    The second line of a stage comes after some 2 seconds, each further one after twice the time, and after 30 seconds
    at the latest.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._stages: dict[str, tuple[float, int, float]] = {}

    def advance(self, stage: str, done: int, total: int) -> None:
        """``done`` of ``total`` steps of a stage are finished."""
        now_s = self._now_s()
        if stage not in self._stages:
            self._stages[stage] = (now_s, done, _FIRST_LINE_S)
            stderr.print(f"{escape(stage)}: {total - done} to do")
            return
        began_s, before, next_s = self._stages[stage]
        passed_s = now_s - began_s
        if passed_s >= next_s and before < done < total:
            left_s = passed_s * (total - done) / (done - before)
            stderr.print(f"{escape(stage)}: {done} of {total}, {time_left(left_s)} left")
            self._stages[stage] = (began_s, before, min(2 * passed_s, passed_s + _MOST_S))


_FIRST_LINE_S = 2.0
_MOST_S = 30.0


def time_left(seconds: float) -> str:
    """Return a duration in words, in the unit that suits it."""
    if seconds < 90:
        return f"some {max(seconds, 1):.0f} s"
    return f"some {seconds / 60:.0f} min" if seconds < 5400 else f"some {seconds / 3600:.1f} h"


@contextmanager
def progress_bar(total: int | None, *, what: str, seconds: bool = False) -> Iterator[Progress]:
    """Yield a progress bar on standard error; hidden if that is not a terminal.

    ``seconds``: whether it counts the time since it appeared.
    """
    columns: tuple[ProgressColumn, ...] = (TextColumn("{task.description}"), BarColumn(24), MofNCompleteColumn())
    if seconds:
        columns = (*columns, TimeElapsedColumn())
    # In a log file, Rich would write one line for each update.
    with Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal) as progress:
        progress.add_task(what, total=total)
        yield progress


def show_view(progress: Progress, view: RunView, *, done: int | None = None) -> None:
    """Show the newest event of a run in its progress bar; what a person must know is printed as a line of its own.

    ``done``: acquisitions that the bar counts; None for those of the view.
    """
    from markerseek.show import event_line

    # Where the angle is typed in, the bar makes room for the line of input.
    if view.phase == "turning" and view.seen_deg is None:
        progress.stop()
        return
    if not progress.live.is_started:
        progress.start()
    if view.phase in {"refused", "checking"}:
        progress.console.print(f"[yellow]{escape(event_line(view))}[/]")
    elif not view.over:
        line = escape(event_line(view))
        if view.phase == "moving" and view.points and view.plan.sweep_speed_deg_s is None:
            # A measurement is followed by the next move at once, and would hardly be seen.
            last = view.points[-1]
            line = f"intensity {last.intensity:.4g} at {last.angle_deg:.2f}°, next {view.target_deg:.2f}°"
        shown = f"[bold]{line}[/]" if view.phase == "turning" else line
        progress.update(progress.task_ids[0], completed=view.acquisitions if done is None else done, description=shown)


def print_warning(message: Warning | str, *_where: object, **_more: object) -> None:
    """Print a warning on standard error, without the line of code that Python adds."""
    stderr.print(f"[yellow]warning:[/] {escape(in_options(str(message)))}")


@cache
def announce_compilation() -> None:
    """Announce that kernels are compiled, once the first one is; nothing is printed where all are on the disk."""
    from markerseek._compiled import on_compiling

    on_compiling(_say_compiling)


def _say_compiling(*, kept: bool) -> None:
    """Print that kernels are compiled; ``kept``: whether the machine code stays on the disk."""
    later = "later ones like it do not" if kept else "as each start does: no folder for compiled code can be written"
    stderr.print(f"[dim]compiling the kernels of this command: it takes some 15 seconds more, {later}[/]")


_LEFT = TimeRemainingColumn(elapsed_when_finished=True)


@contextmanager
def stages_bar() -> Iterator[Callable[[str, int, int], None]]:
    """Yield a progress bar on standard error for each stage of a long task; lines if that is not a terminal.

    Yields a function of the name of a stage, the number of finished steps, and the number of all steps.
    """
    if not stderr.is_terminal:
        yield ProgressLines().advance
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), _LEFT)
    with Progress(*columns, console=stderr) as progress:
        tasks: dict[str, TaskID] = {}

        def advance(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done, total=total)

        yield advance
