"""Journals in a folder: default names, and what lies there."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files import sync_folder
from markerseek.records.journal.file import journals_folder

SUFFIX = ".journal"
"""Suffix of the files that `journals_in` finds, and of default names."""


def default_journal(*, method: str) -> Path:
    """Name of a new journal in the user's data folder; its name begins with the time, UTC."""
    # With microseconds, so that two searches begun in one second get two names.
    now = datetime.now(UTC)
    return journals_folder() / f"{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}-{method}{SUFFIX}"


def make_folder(folder: Path) -> None:
    """Make a folder and its missing parents, readable by the owner only, and flush their names to disk.

    ``folder``: one that may exist. Raises `OSError` if it cannot be made.
    """
    # Path.mkdir(parents=True) gives the parents default rights, and does not flush their names.
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)
        sync_folder(each.parent)


def journals_in(folder: Path) -> list[Path]:
    """Journals of a folder, the newest change last.

    ``folder``: where to look; not in the folders that it holds.
    """
    try:
        found = [
            (each.stat().st_mtime_ns, each)
            for each in folder.iterdir()
            if each.suffix == SUFFIX and each.is_file() and not each.name.startswith(".")
        ]
    except OSError as problem:
        raise RecordError(f"{folder}: no journals can be listed: {problem.strerror or problem}; check it") from problem
    return [path for _, path in sorted(found)]


def size_bytes_of(path: Path) -> int:
    """Bytes of a journal; a missing file counts 0."""
    with suppress(OSError):
        return path.stat().st_size
    return 0
