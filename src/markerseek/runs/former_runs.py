"""What former runs say: a line of a list of journals, and of a search's marker the intensity curve and the position."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeVar

import msgspec

from markerseek.core import ConfigError, Doubt, MarkerCurve, MarkerPosition, RecordError, SearchError, plain
from markerseek.files import MIB, as_read_error, read_json
from markerseek.records.journal import RunView, escaped, is_journal, read_journal, salvage, size_bytes_of
from markerseek.show import SearchResult, answer_line, answer_name, flat_result

_MAX_BYTES = 16 * MIB
"""Largest result that is read; one of 500 acquisitions has 0.1 MiB."""


class _Curve(msgspec.Struct, frozen=True, kw_only=True):
    """The key of a printed result that a prior needs."""

    curve: MarkerCurve | None = None


class _Marker(msgspec.Struct, frozen=True, kw_only=True):
    """The keys of a printed result that a registration needs."""

    found: bool
    answer: str
    reason: str | None
    doubt: Doubt | None
    marker_trus_m: tuple[float, float, float] | None
    marker_sigma_m: tuple[float, float, float] | None


_Kind = TypeVar("_Kind", _Curve, _Marker)


def former_curve(path: Path) -> MarkerCurve:
    """Return the intensity curve of the marker that a search found.

    ``path``: the result of the search as JSON, or its journal.
    """
    curve = _printed(path, _Curve).curve
    if curve is None:
        raise RecordError(f"{path}: it found no marker whose curve it knows; name the result of a posterior that did")
    return curve


def read_marker(path: Path) -> MarkerPosition:
    """Return the position of the marker in the TRUS frame, from a search's result.

    ``path``: journal of the search, or its result as JSON.
    """
    result = _printed(path, _Marker)
    # An uncertain angle counts less, by its sigma. If it is uncertain which source the angle is of, it is not taken.
    if not (result.found or result.doubt == "width"):
        raise RecordError(
            f"{path}: its search found no marker ({result.answer}: {result.reason}); search again, or leave it out"
        )
    if result.marker_trus_m is None or result.marker_sigma_m is None:
        raise RecordError(
            f"{path}: the marker's position is not known, because the rig's face radius is not, or its data are "
            "intensities only; scan a point with this rig, calibrate with "
            "`calibrate(point.hdf5)`, put face_radius_m into [probe] of the rig file, and search again"
        )
    return MarkerPosition(position_m=result.marker_trus_m, sigma_m=result.marker_sigma_m)


def _printed(path: Path, kind: type[_Kind]) -> _Kind:
    """Return what is read of a result, printed or in the journal of its search."""
    try:
        with as_read_error(path):
            if is_journal(path):
                result = SearchResult.of(RunView.of(read_journal(path, frames=False)))
                return msgspec.convert(flat_result(result), kind, from_attributes=True)
        return read_json(
            path,
            kind,
            most_bytes=_MAX_BYTES,
            what="the journal of a search or its result as JSON",
            cure="name the journal of a search, or what the search printed as JSON",
        )
    except (ConfigError, SearchError) as problem:
        raise RecordError(f"{path}: {problem}") from problem


class JournalSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a list of journals; values that cannot be read are None."""

    path: str
    """The file; bytes of its name that are not Unicode are written as escapes."""
    size_bytes: int
    begun: str | None = None
    """When its run began, UTC, ISO 8601."""
    method: str | None = None
    as_published: bool | None = None
    rig: str | None = None
    emulated: tuple[str, ...] = ()
    """``method``, ``as_published``, ``rig`` and ``emulated``: the policy's name and whether it is in the paper's form,
    the kind of the rig, and its emulated devices."""
    description: str | None = None
    """The rig in words; of a simulated one also tissue and seed."""
    seed: int | None = None
    """Seed of a simulated rig."""
    state: Literal["finished", "fault", "open", "running", "damaged", "unreadable"]
    """"running" while a program writes it, "damaged" if only a part can be read, "unreadable" if nothing can."""
    answer: str | None = None
    angle_deg: float | None = None
    """``answer`` and ``angle_deg``: the answer of a run that is over, and the angle in degrees to which it points."""
    acquisitions: int | None = None
    """Acquisitions with light that the search received."""
    problem: str | None = None
    """What is wrong, in words."""

    @property
    def end(self) -> str:
        """The answer with its angle, in a line; the state of a run without an answer."""
        if self.answer is None or self.angle_deg is None:
            return self.state
        return answer_line(self.answer, self.angle_deg, as_published=bool(self.as_published))


def journal_summary(path: Path) -> JournalSummary:
    """Return the summary of a journal; damage is reported in it, not raised."""
    size_bytes = size_bytes_of(path)
    name = escaped(str(path))
    try:
        recorded, damage = salvage(path, frames=False)
    except RecordError as problem:
        # One unreadable file must not hide the others of the list.
        return JournalSummary(path=name, size_bytes=size_bytes, state="unreadable", problem=_without(path, problem))
    view = RunView.of(recorded)
    over = view.finished
    return JournalSummary(
        path=name,
        size_bytes=size_bytes,
        begun=recorded.entries[0].written if recorded.entries else None,
        method=recorded.configuration.plan.method,
        as_published=recorded.configuration.plan.as_published,
        rig=recorded.configuration.facts.kind,
        emulated=recorded.configuration.facts.emulated,
        description=recorded.configuration.facts.description,
        seed=recorded.configuration.facts.seed,
        state="damaged" if damage is not None else "running" if recorded.is_written else view.state,
        answer=None if over is None else answer_name(over.estimate),
        angle_deg=None if over is None else over.estimate.mean_deg,
        acquisitions=view.acquisitions,
        problem=view.fault if damage is None else _without(path, damage),
    )


def _without(path: Path, problem: RecordError) -> str:
    # The list prints the path once, so that the message need not begin with it.
    return escaped(plain(str(problem)).removeprefix(f"{path}: "))
