"""What a command has found, and the one place that prints it: for people, for programs, and as pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn, ParamSpec

import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from markerseek._version import __version__
from markerseek.cli.in_options import in_options
from markerseek.cli.notes import notes_said
from markerseek.cli.terminal import new_table, print_json, stderr, stdout
from markerseek.core import ConfigError
from markerseek.files import replace_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Given = ParamSpec("_Given")


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What a command has found."""

    values: object
    """The JSON object of ``--json``."""
    shown: Iterable[str | Table] = ()
    """Lines (Rich markup) and tables for people; a generator of them does not run where a program reads the output."""
    pictures: Mapping[str, Callable[[Path], object]] = field(default_factory=dict)
    """For ``--plot``: names of files, and functions that write them."""
    files: Mapping[Path, bytes] = field(default_factory=dict)
    """Files that are written whether or not pictures are asked for, and replace those that are there."""
    notes: tuple[str, ...] = ()
    """Lines for people behind the pictures, on standard error."""
    least_width: int = 0
    """Columns that the tables need: in a narrower terminal their lines are broken, and no cell is cut."""
    exit_code: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """How a report is shown."""

    as_json: bool
    """Whether a program reads standard output."""
    folder: Path | None = None
    """Folder for pictures; None if none are asked for."""
    file: Path | None = None
    """Where the first picture goes under a name of the user's; then neither its page nor others are written."""

    @classmethod
    def asked(cls, *, as_json: bool, plot: bool, out: Path | None) -> Output:
        """Return the output that a user asks for.

        The folder for pictures is made and tested before anything is measured.
        """
        if out is not None and not plot:
            raise ConfigError(
                f"--out {out}: only pictures go there, and none is asked for; add --plot, or leave it out"
            )
        if not plot:
            return cls(as_json=as_json)
        from markerseek.show import PICTURE_SUFFIXES

        if out is not None and out.suffix.lower() in PICTURE_SUFFIXES and not out.is_dir():
            make_picture_folder(out.parent)
            return cls(as_json=as_json, folder=out.parent, file=out)
        folder = out or Path("out")
        make_picture_folder(folder)
        return cls(as_json=as_json, folder=folder)

    def show(self, report: Report) -> NoReturn:
        """Print a report, write its pictures, and end the command with its exit code."""
        # The answer first: a failure to draw the picture must not hide it.
        if self.as_json:
            print_json(report.values)
        else:
            usual = stdout.width
            # Rich prints nothing wider than the console.
            stdout.width = max(usual, report.least_width)
            for part in report.shown:
                stdout.print(part)
            stdout.width = usual
        if self.folder is not None:
            for name, write in list(report.pictures.items())[: 1 if self.file is not None else None]:
                path = self.file or self.folder / name
                write(path)
                # Where a program reads standard output, messages for people go to standard error.
                (stderr if self.as_json else stdout).print(file_line("picture", path))
        for path, content in report.files.items():
            with replace_file(path) as new:
                new.write_bytes(content)
        if not self.as_json:
            for note in (*(file_line("written", path) for path in report.files), *report.notes):
                stderr.print(note)
        raise typer.Exit(report.exit_code)


def make_picture_folder(folder: Path) -> None:
    """Make a folder for pictures, and test that they can be written to it."""
    from markerseek.show import require_room_for_pictures

    require_room_for_pictures(folder)


def with_version(**values: object) -> dict[str, object]:
    """Return the values for programs; at their end what the command has said, and the version of this program."""
    return values | {"notes": notes_said(), "version": __version__}


def matrix_lines(rows: Iterable[Iterable[float]]) -> Iterator[str]:
    """Return a matrix as lines, one for each row."""
    return ("  ".join(f"{value:+.6f}" for value in row) for row in rows)


def facts(rows: Iterable[tuple[str, str | Text | None]]) -> Table:
    """Return the names and values in two columns; rows whose value is None are left out."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in rows:
        if value is not None:
            table.add_row(f"[dim]{escape(name)}[/]", value if isinstance(value, Text) else escape(in_options(value)))
    return table


def table(
    rows: Iterable[Mapping[str, str | Text]], *, left: tuple[str, ...] = (), no_wrap: bool = False, gap: int = 2
) -> Table:
    """Return a table of rows with the same headings; the columns named in ``left`` are aligned left, all others right.

    ``gap``: spaces between columns.
    """
    held = list(rows)
    made = new_table(*(held[0] if held else ()), left=left, no_wrap=no_wrap)
    made.padding = (0, gap, 0, 0)
    for row in held:
        made.add_row(*(cell if isinstance(cell, Text) else escape(cell) for cell in row.values()))
    return made


def file_line(what: str, path: Path) -> str:
    """Return where a file is."""
    return f"[dim]{what}:[/] {escape(str(path))}"


def drawn(make: Callable[_Given, Figure], *values: _Given.args, **named: _Given.kwargs) -> Callable[[Path], None]:
    """Return a function that draws a figure from these values, and writes it as the ending of a path says."""

    def write(path: Path) -> None:
        from markerseek.show import save_figure

        save_figure(make(*values, **named), path)

    return write
