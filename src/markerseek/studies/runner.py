"""Runs a study into a folder. A study that was interrupted is continued by the same command.

The folder holds ``study.json``, the study that it belongs to; ``parts/``, the lines of each finished chunk; and at the
end, instead of the parts, ``rows.csv`` and ``summary.json``. Each file is written completely or not at all. The files
of a continued study are those of an uninterrupted one, byte for byte.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TypeVar

import msgspec

from markerseek._version import __version__
from markerseek.core import ConfigError, RecordError
from markerseek.files import MIB, read_input
from markerseek.studies.study import Study
from markerseek.studies.summary import Summary, summarise
from markerseek.studies.table import as_csv, chunks, columns, read_rows, run_chunk, write_whole
from markerseek.studies.workers import default_workers, on_cluster, on_processes

ROWS, SUMMARY, STUDY, PARTS = "rows.csv", "summary.json", "study.json", "parts"
"""Names in a study's folder."""

_MAX_BYTES = 256 * MIB
"""Largest file beside the table that is read."""

Kind = TypeVar("Kind")


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedStudy:
    """A study that has been run."""

    rows: Path
    summary: Summary


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int], None] | None = None,
) -> FinishedStudy:
    """Run a study, or the rest of it, and summarise it.

    ``folder``: created if it does not exist. ``workers``: processes of this machine; None: as many as it has cores.
    ``scheduler``: address of a Dask scheduler, to run on its workers instead. ``progress``: receives the number of
    finished rows after each chunk.
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
            write_whole(folder / SUMMARY, _json(summary))
        # Last: however a run ends before this line, parts or table are there to continue from.
        shutil.rmtree(folder / PARTS)
        summary = _read(folder / SUMMARY, Summary, cure="; delete it, and it is computed again")
        return FinishedStudy(rows=folder / ROWS, summary=summary)


def _read(path: Path, kind: type[Kind], *, cure: str = "") -> Kind:
    """Content of a JSON file."""
    try:
        return msgspec.json.decode(read_input(path, most_bytes=_MAX_BYTES), type=kind)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
        raise RecordError(f"{path}: it cannot be read: {problem}{cure}") from problem


def _claim(folder: Path, study: Study) -> None:
    """Record the study of the folder, or refuse the folder of another; remove files that were not finished."""
    claim = {"hash": study.digest, "version": __version__, "study": msgspec.to_builtins(study)}
    path = folder / STUDY
    if path.exists():
        found = _read(path, dict)
        if found.get("hash") != study.digest:
            made_by = found.get("version")
            cause = f"was begun by version {made_by}" if made_by != __version__ else "holds another study"
            raise RecordError(
                f"{folder}: the folder {cause} (hash {found.get('hash')}, this one is {study.digest}); "
                "choose another folder, or remove this one"
            )
    else:
        write_whole(path, _json(claim))
    for unfinished in [*folder.glob(".*.part"), *(folder / PARTS).glob(".*.part")]:
        unfinished.unlink()


def _json(value: object) -> list[bytes]:
    return [msgspec.json.format(msgspec.json.encode(value), indent=1), b"\n"]


def _run_chunks(
    study: Study,
    parts: Path,
    *,
    workers: int | None,
    scheduler: str | None,
    progress: Callable[[int], None] | None,
) -> None:
    """Compute the chunks whose parts are missing, and write each as it is ready."""
    left = [trials for trials in chunks(study) if not _part(parts, trials).exists()]
    done = study.rows - sum(map(len, left)) * len(study.policies)
    if scheduler is not None:
        computed: Iterator[tuple[int, bytes]] = on_cluster(run_chunk, study, left, address=scheduler)
    else:
        count = default_workers() if workers is None else workers
        computed = on_processes(partial(run_chunk, study), left, workers=count)
    # Closed at Ctrl-C too: the processes would otherwise continue their jobs.
    with closing(computed):  # type: ignore[type-var]
        for number, lines in computed:
            # The hash of a study contains the version of the package that computed it.
            if not lines.startswith(study.digest.encode()):
                raise ConfigError("a worker has another version of markerseek than this process; install the same one")
            write_whole(_part(parts, left[number]), [lines])
            done += len(left[number]) * len(study.policies)
            if progress is not None:
                progress(done)


def _join(study: Study, folder: Path) -> None:
    """Write the table from its parts."""
    parts = (read_input(_part(folder / PARTS, trials), most_bytes=_MAX_BYTES) for trials in chunks(study))
    write_whole(folder / ROWS, chain([as_csv([columns(study)])], parts))


def _part(parts: Path, trials: range) -> Path:
    """Path of a part. Its name holds its trials, so that a part of chunks of another size is not mistaken for it."""
    return parts / f"{trials.start:09d}-{trials.stop - 1:09d}.csv"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder; the operating system releases the lock however this process ends."""
    try:
        import fcntl
    except ImportError:  # Windows: without the lock, two runs of one study do the work twice and write the same files
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
