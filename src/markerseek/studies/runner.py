"""Runs a study into a folder, restartably: what is finished is on disk, what is not is computed again the same.

The folder holds ``study.json``, the study that it belongs to; ``parts/``, the lines of each finished chunk; and in the
end, instead of the parts, ``rows.csv`` and ``summary.json``. All of them are committed whole. A study that was killed
is continued by the same command, and its files do not differ from those of one that was not.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from markerseek._version import __version__
from markerseek.core import ConfigError, RecordError
from markerseek.files import MIB, read_input
from markerseek.studies.chunks import Chunk, chunk, chunk_count, chunk_rows, run_chunk
from markerseek.studies.cluster import on_cluster
from markerseek.studies.study import Study
from markerseek.studies.summary import Summary, summarise
from markerseek.studies.table import as_csv, columns, commit, committed, read_rows
from markerseek.studies.workers import default_workers, on_processes

ROWS, SUMMARY, STUDY, PARTS = "rows.csv", "summary.json", "study.json", "parts"
"""Names in a study's folder."""

_MOST_BYTES = 256 * MIB
"""Largest file beside the table that is read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finish:
    """A study that has been run.

    Attributes
    ----------
    rows
        Its table.
    summary
        What the table says.
    """

    rows: Path
    summary: Summary


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> Finish:
    """Run a study, or what is left of it, and summarise it.

    Parameters
    ----------
    study
        What to run.
    folder
        Where its files are, or shall be; made if need be.
    workers
        Processes of this machine; None: as many as it has cores.
    scheduler
        Address of a Dask scheduler, on whose workers to run instead.
    progress
        Hears how many rows are finished, whenever a chunk is.

    Raises
    ------
    RecordError
        If the folder holds another study or another version's, is being written by somebody else, or cannot be written.
    ConfigError
        If the settings do not fit together, there is no such scheduler, or its workers have another version.
    """
    try:
        (folder / PARTS).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise RecordError(
            f"{folder}: the folder cannot be made ({problem.strerror}); name one that can be written, with --out"
        ) from problem
    with _alone(folder):
        _claim(folder, study)
        if not (folder / ROWS).exists():
            _run_chunks(study, folder / PARTS, workers=workers, scheduler=scheduler, progress=progress)
            _join(study, folder)
        if progress is not None:
            progress(study.rows)
        if not (folder / SUMMARY).exists():
            summary = summarise(study, read_rows(folder / ROWS, study))
            commit(folder / SUMMARY, msgspec.json.format(msgspec.json.encode(summary), indent=1) + b"\n")
        shutil.rmtree(folder / PARTS)
        return Finish(rows=folder / ROWS, summary=_summary(folder / SUMMARY))


def _summary(path: Path) -> Summary:
    try:
        return msgspec.json.decode(read_input(path, most_bytes=_MOST_BYTES), type=Summary, strict=True)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
        raise RecordError(f"{path}: it cannot be read: {problem}; delete it, and it is computed again") from problem


def _claim(folder: Path, study: Study) -> None:
    """Write down whose folder it is, or refuse one that is another study's; forget what was not committed."""
    claim = {"hash": study.digest, "version": __version__, "study": msgspec.to_builtins(study)}
    path = folder / STUDY
    if path.exists():
        try:
            found = msgspec.json.decode(read_input(path, most_bytes=_MOST_BYTES), type=dict)
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
            raise RecordError(f"{path}: it cannot be read: {problem}") from problem
        if found.get("hash") != study.digest:
            made_by = found.get("version")
            cause = f"was begun by version {made_by}" if made_by != __version__ else "holds another study"
            raise RecordError(
                f"{folder}: the folder {cause} (hash {found.get('hash')}, this one is {study.digest}); "
                "choose another folder, or remove this one"
            )
    else:
        commit(path, msgspec.json.format(msgspec.json.encode(claim), indent=1) + b"\n")
    for unfinished in [*folder.glob(".*.part"), *(folder / PARTS).glob(".*.part")]:
        unfinished.unlink()


def _run_chunks(
    study: Study,
    parts: Path,
    *,
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[int], None] | None,
) -> None:
    """Compute the chunks whose parts are missing, and commit each as it is ready."""
    left = [index for index in range(chunk_count(study)) if not _part(parts, chunk(study, index)).exists()]
    missing = (chunk(study, index) for index in left)
    done = study.rows - sum(chunk_rows(study, chunk(study, index)) for index in left)
    if scheduler is not None:
        computed: Iterator[tuple[int, bytes]] = on_cluster(study, missing, address=scheduler)
    else:
        count = default_workers() if workers is None else workers
        computed = on_processes(partial(run_chunk, study), missing, workers=count)
    with closing(computed):  # type: ignore[type-var]
        for number, lines in computed:
            if not lines.startswith(study.digest.encode()):
                raise ConfigError("a worker has another version of markerseek than this process; install the same one")
            piece = chunk(study, left[number])
            commit(_part(parts, piece), lines)
            done += chunk_rows(study, piece)
            if progress is not None:
                progress(done)


def _join(study: Study, folder: Path) -> None:
    """Make the table of its parts."""
    with committed(folder / ROWS) as table:
        table.write(as_csv([columns(study)]))
        for index in range(chunk_count(study)):
            table.write(read_input(_part(folder / PARTS, chunk(study, index)), most_bytes=_MOST_BYTES))


def _part(parts: Path, piece: Chunk) -> Path:
    """Named by its trials, so that no part of a version with other chunks is taken for one of these."""
    return parts / f"{piece.first:09d}-{piece.last - 1:09d}.csv"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep everybody else out of the folder; the system lets go of the lock however this process ends."""
    try:
        import fcntl
    except ImportError:  # not on this system: two runs of one study would only do the work twice
        yield
        return
    try:
        # A lock is never a link, which would have another file opened, nor a pipe, which would wait for its reader.
        descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    except OSError as problem:
        raise RecordError(f"{folder / '.lock'}: it cannot be opened: {problem.strerror}; delete it") from problem
    with os.fdopen(descriptor, "r+b", buffering=0) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as problem:
            raise RecordError(f"{folder}: another process is running this study; wait for it") from problem
        yield
