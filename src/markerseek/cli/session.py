"""Runs a search for `search`, `replay` and `resume`: journal, progress bar, and the end by a signal or an error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

from rich.markup import escape

from markerseek.cli.report import file_line
from markerseek.cli.signals import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import print_warning, progress_bar, show_view, stderr
from markerseek.cli.watched import WatchOptions
from markerseek.core import ConfigError, Failed, MarkerseekError, RecordError
from markerseek.files import quoted
from markerseek.records.journal import Configuration, Journal, default_journal, make_folder
from markerseek.runs import Session

_UNWATCHED = WatchOptions()
"""No program follows the run."""


def run_session(
    session: Session, *, as_json: bool, rig_file: Path | None = None, watch: WatchOptions = _UNWATCHED
) -> None:
    """Run a search to its end with a progress bar; Ctrl-C, SIGTERM and SIGHUP stop the rig and end the command.

    ``as_json``: whether to print an interruption as JSON. ``rig_file``: rig file of the search; for a rig of devices,
    the command that resumes it names this file. ``watch``: whether another program must be there.
    """
    journal = session.journal if session.journal is not None and session.journal.kept else None
    # A journal describes a simulated rig in full: `resume` takes no rig file for it.
    rig_file = rig_file if session.configuration.facts.kind == "bench" else None
    with stopped_by_signals():
        try:
            with watch.stopping():
                _watch(session)
        except StoppedBySignal as stop:
            # Further signals are still ignored here, while the journal is written.
            try:
                session.interrupt(stop.by)
            except RecordError as problem:
                print_warning(str(problem))
            end_stopped(
                stop,
                as_json=as_json,
                kept=None if journal is None else journal.path,
                resume=None if journal is None else resume_command(journal.path, rig_file),
            )
        except MarkerseekError:
            _print_how_to_resume(journal, rig_file)
            raise


def run_new_session(
    session: Session,
    *,
    as_json: bool,
    journal: Path | None = None,
    keep: bool = True,
    rig_file: Path | None = None,
    watch: WatchOptions = _UNWATCHED,
) -> Session:
    """Run a new search to its end with a new journal; returns the session with that journal.

    If a named journal cannot be written, that is an error before anything moves. If the user's data folder cannot be
    written, a search without hardware continues with a warning; one with hardware is refused, because exposure of
    tissue without a record must be asked for (--no-journal).

    ``journal``: the user's file; None for one in the data folder.
    """
    require_journal_options(journal, keep=keep, watch=watch)
    session = replace(session, journal=_new_journal(journal, session.configuration) if keep else None)
    if session.journal is not None and not as_json:
        # Before the first move: whatever happens to this process, the user knows where the record is.
        stderr.print(file_line("journal", session.journal.path))
    if watch.events is not None:
        session = replace(session, journal=Journal.create(watch.events, session.configuration, kept=False))
    with closed_at_end(session.journal):
        run_session(session, as_json=as_json, rig_file=rig_file, watch=watch)
    return session


def require_journal_options(journal: Path | None, *, keep: bool, watch: WatchOptions = _UNWATCHED) -> None:
    """Refuse options of `run_new_session` that contradict each other, before devices are opened."""
    if journal is not None and not keep:
        raise ConfigError(f"--journal names {journal} and --no-journal wants none; leave one of them out")
    if keep and watch.events is not None:
        raise ConfigError(
            f"--events {watch.events} is for a run without a journal; follow its journal, or add --no-journal"
        )


def _watch(session: Session) -> None:
    # Closed whatever happens here, so that an interrupt also stops the stage and disarms the laser.
    with closing(session.events()) as events, progress_bar(session.most_acquisitions, what="searching") as progress:
        for _ in events:
            show_view(progress, session.view)


def resume_command(journal: Path, rig_file: Path | None) -> str:
    """The shell command that resumes a journal; only a rig of devices needs its rig file."""
    rig = "" if rig_file is None else f" --rig {quoted(rig_file)}"
    return f"markerseek resume {quoted(journal)}{rig}"


def _print_how_to_resume(journal: Journal | None, rig_file: Path | None) -> None:
    """Print the command that resumes a run that ended with an error; none if only a new search helps."""
    if journal is None or not journal.path.exists():
        return
    line = file_line("journal", journal.path)
    command = escape(resume_command(journal.path, rig_file))
    if isinstance(journal.last, Failed):
        line += f"; once the fault is repaired: {command} --reset-fault"
    else:
        line += f"; continue with: {command}"
    stderr.print(line)


def _new_journal(named: Path | None, configuration: Configuration) -> Journal | None:
    """Journal of a search that is about to begin; None if the data folder takes none and no hardware is involved."""
    if named is not None:
        return Journal.create(named, configuration)
    try:
        path = default_journal(method=configuration.plan.method)
        try:
            make_folder(path.parent)
            return Journal.create(path, configuration)
        except OSError as problem:
            raise RecordError(f"{path}: {problem.strerror}") from problem
    except RecordError as problem:
        if configuration.facts.kind == "bench":
            raise RecordError(
                f"no journal can be written: {problem}; name one with --journal FILE, or search without one by "
                "--no-journal"
            ) from problem
        print_warning(f"no journal is kept: {problem}; or name a file with --journal FILE")
        return None


@contextmanager
def closed_at_end(journal: Journal | None) -> Iterator[None]:
    """Close a journal at the end; a failure to close it is a warning only, so that the answer is still shown."""
    try:
        yield
    finally:
        try:
            if journal is not None:
                journal.close()
        except RecordError as problem:
            print_warning(str(problem))
