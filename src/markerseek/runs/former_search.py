"""What a former search says of its marker, from its result or its journal: the intensity curve, and the position."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec

from markerseek.core import ConfigError, MarkerCurve, MarkerPosition, RecordError, SearchError
from markerseek.files import MIB, as_read_error, read_json
from markerseek.records import SearchResult
from markerseek.records.journal import is_journal, read_journal
from markerseek.runs.run_view import RunView

_MAX_BYTES = 16 * MIB
"""Largest result that is read; one of 500 acquisitions has 0.1 MiB."""


class _Result(msgspec.Struct, frozen=True, kw_only=True):
    """The only key of a result that a prior needs."""

    curve: MarkerCurve | None = None


_Kind = TypeVar("_Kind", _Result, SearchResult)


def former_curve(path: Path) -> MarkerCurve:
    """Intensity curve of the marker that a search found.

    ``path``: the result of the search, as printed with --json, or its journal.
    """
    curve = _result_of(path, _Result).curve
    if curve is None:
        raise RecordError(f"{path}: it found no marker whose curve it knows; name the result of a posterior that did")
    return curve


def read_marker(path: Path) -> MarkerPosition:
    """Position of the marker in the TRUS frame, from a search's result.

    ``path``: journal of the search, or its result as JSON.
    """
    result = _result_of(path, SearchResult)
    # An uncertain angle counts less, by its sigma. If it is uncertain which source the angle is of, it is not taken.
    if not (result.found or result.doubt == "width"):
        raise RecordError(
            f"{path}: its search found no marker ({result.answer}: {result.reason}); search again, or leave it out"
        )
    if result.marker_trus_m is None or result.marker_sigma_m is None:
        raise RecordError(
            f"{path}: the marker's position is not known, because the rig's face radius is not, or its data are "
            "intensities only; calibrate with 'markerseek bank scan point.hdf5 --rig RIG.toml' and 'markerseek "
            "calibrate point.hdf5', put face_radius_m into [probe] of the rig file, and search again"
        )
    return MarkerPosition(position_m=result.marker_trus_m, sigma_m=result.marker_sigma_m)


def _result_of(path: Path, kind: type[_Kind]) -> SearchResult | _Kind:
    """Result of a journal, or what is read of a result."""
    try:
        with as_read_error(path):
            if is_journal(path):
                return RunView.of(read_journal(path, frames=False)).result()
        return read_json(
            path,
            kind,
            most_bytes=_MAX_BYTES,
            what="the journal of a search or its result as JSON",
            cure="make one with 'markerseek search --json > result.json'",
        )
    except (ConfigError, SearchError) as problem:
        raise RecordError(f"{path}: {problem}") from problem
