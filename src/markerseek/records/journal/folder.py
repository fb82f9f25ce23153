"""Default folder and names of journals."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from platformdirs import user_data_path

from markerseek.files import sync_folder


def journals_folder() -> Path:
    """Default folder of journals, in the user's data folder."""
    return user_data_path("markerseek", appauthor=False) / "journals"


def default_journal(*, method: str) -> Path:
    """Name of a new journal in the user's data folder; its name begins with the time, UTC.

    Parameters
    ----------
    method
        What searches.
    """
    # With microseconds, so that two searches begun in one second get two names.
    now = datetime.now(UTC)
    return journals_folder() / f"{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}-{method}.journal"


def make_folder(folder: Path) -> None:
    """Make a folder and its missing parents, readable by the owner only, and flush their names to disk.

    Parameters
    ----------
    folder
        One that may exist.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    # Path.mkdir(parents=True) gives the parents default rights, and does not flush their names.
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)
        sync_folder(each.parent)
