"""Where journals go that nobody named, and folders that outlive a loss of power."""

from __future__ import annotations

import os
import sys
from datetime import UTC, datetime
from pathlib import Path

from markerseek.files.whole import sync_folder


def data_folder() -> Path:
    """Folder of the user's data of markerseek, as the system has it: ``XDG_DATA_HOME``, or that of macOS or Windows."""
    named = os.environ.get("XDG_DATA_HOME", "")
    if Path(named).is_absolute():
        return Path(named) / "markerseek"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "markerseek"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "markerseek"
    return Path.home() / ".local" / "share" / "markerseek"


def journals_folder() -> Path:
    """Folder of journals that nobody named."""
    return data_folder() / "journals"


def default_journal(*, method: str) -> Path:
    """Name of a new journal in the user's data folder; its name begins with the time, UTC.

    Parameters
    ----------
    method
        What searches.
    """
    now = datetime.now(UTC)
    return journals_folder() / f"{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}-{method}.journal"


def make_folder(folder: Path) -> None:
    """Make a folder that only its owner can open, with those above it that are missing, their names on the disk.

    Parameters
    ----------
    folder
        One that may exist.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)
        sync_folder(each.parent)
