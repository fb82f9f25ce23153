"""Folder in which the package keeps the files of a user."""

from __future__ import annotations

from pathlib import Path

from markerseek.core import RecordError


def data_folder() -> Path:
    """The user's data folder, which may not exist yet; `RecordError` if the system knows none."""
    from platformdirs import user_data_path

    try:
        return user_data_path("markerseek", appauthor=False)
    # A container or service can run under a user number without a name and without HOME.
    except RuntimeError as problem:
        raise RecordError(
            "this user has no home folder; set XDG_DATA_HOME to a folder in which journals are kept"
        ) from problem
