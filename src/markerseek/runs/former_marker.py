"""The intensity curve of a former marker on a rig, from the result of its search or the journal of it."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import Finished, Found, MarkerCurve, MarkerseekError, RecordError
from markerseek.files import MIB, read_input
from markerseek.records.journal import read_journal

_MOST_BYTES = 16 * MIB
"""Largest result that is read; one of 500 acquisitions has 0.1 MiB."""


class _Result(msgspec.Struct, frozen=True, kw_only=True):
    curve: MarkerCurve | None = None


def former_curve(path: Path) -> MarkerCurve:
    """Intensity curve of the marker that a search found.

    Parameters
    ----------
    path
        The result of the search, as printed with --json, or its journal.

    Raises
    ------
    RecordError
        If the file cannot be read, or no marker was found.
    """
    curve = _of_journal(path) if path.suffix == ".journal" else _of_result(path)
    if curve is None:
        raise RecordError(f"{path}: it found no marker whose curve it knows; name the result of a posterior that did")
    return curve


def _of_result(path: Path) -> MarkerCurve | None:
    try:
        return msgspec.json.decode(read_input(path, most_bytes=_MOST_BYTES), type=_Result).curve
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror or problem}; check the name") from problem
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, MarkerseekError) as problem:
        raise RecordError(
            f"{path}: it cannot be read as the result of a search: {problem}; name what --json printed, or a journal"
        ) from problem


def _of_journal(path: Path) -> MarkerCurve | None:
    for entry in read_journal(path, frames=False).entries:
        if isinstance(entry.event, Finished) and isinstance(entry.event.estimate, Found):
            return entry.event.estimate.curve
    return None
