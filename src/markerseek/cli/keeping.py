"""Where a search keeps its journal: where the user says, in the user's data folder, or nowhere."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.markup import escape

from markerseek.cli.terminal import aside, print_warning
from markerseek.core import ConfigError, RecordError
from markerseek.records.journal import Configuration, Journal, default_journal, make_folder


def new_journal(named: Path | None, configuration: Configuration, *, wanted: bool) -> Journal | None:
    """Journal of a search that is about to begin; None where there is none.

    A journal that was named and cannot be written is an error, before anything moves. Where none was named and the
    user's data folder cannot be written, a search without hardware goes on with a warning, and one with hardware does
    not begin: going without a record there must be asked for.

    Parameters
    ----------
    named
        The user's file; None for one in the data folder.
    configuration
        What the search is begun with.
    wanted
        Whether to keep one at all.

    Raises
    ------
    RecordError
        If it cannot be written.
    ConfigError
        If one was named and none is wanted.
    """
    if not wanted:
        if named is not None:
            raise ConfigError(f"--journal names {named} and --no-journal wants none; leave one of them out")
        return None
    if named is not None:
        return Journal.create(named, configuration)
    path = default_journal(method=configuration.method)
    try:
        make_folder(path.parent)
        return Journal.create(path, configuration)
    except (OSError, RecordError) as problem:
        said = problem.strerror if isinstance(problem, OSError) else str(problem)
        if configuration.rig == "bench":
            raise RecordError(
                f"{path}: no journal can be kept there ({said}); name another place with --journal FILE, or go without "
                "a record by --no-journal"
            ) from problem
        print_warning(f"no journal is kept: {path}: {said}; name another place with --journal FILE")
        return None


@contextmanager
def held_open(journal: Journal | None) -> Iterator[Journal | None]:
    """A journal that is closed at the end; where it cannot be closed, that is a warning, and no answer is lost.

    Parameters
    ----------
    journal
        An open one, or None.
    """
    try:
        yield journal
    finally:
        try:
            if journal is not None:
                journal.close()
        except RecordError as problem:
            print_warning(str(problem))


def tell_where(journal: Journal | None) -> None:
    """Say where the journal lies, on standard error."""
    if journal is not None:
        aside.print(f"[dim]journal:[/] {escape(str(journal.path))}")
