"""What a journal holds, the configuration of a run and then its entries, and how the event of an entry is stored.

An event is stored as its kind, a JSON body, and the raw samples or pixels of a frame. The body is its dataclass, field
by field. Where a field can hold one of several classes (a frame, an estimate), ``type`` names the class. Two things are
stored elsewhere: the arrays of a frame behind the line, one behind the other, and the confirmation of `Finished` in the
entry of that acquisition.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeAlias, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import (
    Asked,
    ChannelFrame,
    Estimate,
    Event,
    Failed,
    Finished,
    Frame,
    Measured,
    Reading,
    RecordError,
    Refused,
    RigFacts,
    Sample,
    SearchPlan,
    Started,
    Swept,
    Turning,
    require_range,
)


def versions() -> dict[str, str]:
    """Versions of the libraries on which the last bit of a result depends."""
    return {
        "markerseek": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """Search and rig of a run."""

    plan: SearchPlan
    """What was asked of the search."""
    facts: RigFacts
    """What was known of the rig."""
    # Raw JSON, not decoded here: records may not import the settings of rigs and drivers.
    recipe: msgspec.Raw
    """All settings of the rig, as JSON; null for a rig that was not assembled from settings."""
    imaging: msgspec.Raw = msgspec.Raw(b"null")
    """Preset of the rig's imaging chain, as JSON; null where there are intensities only."""
    bank: msgspec.Raw = msgspec.Raw(b"null")
    """Facts of the bank that a scan becomes, as JSON; null for a search."""
    frames: bool = True
    """Whether the journal keeps the frames of the receiver; otherwise it has the samples only."""
    versions: dict[str, str] = msgspec.field(default_factory=versions)

    def flat(self) -> dict[str, object]:
        """Plan and facts as one flat table for JSON output; ``rig`` is the kind of the rig."""
        plan: dict[str, object] = msgspec.to_builtins(self.plan)
        facts: dict[str, object] = msgspec.to_builtins(self.facts)
        # Beside the keys of the plan, "kind" alone would not say of what.
        facts["rig"] = facts.pop("kind")
        return plan | facts | {"recipe": self.recipe, "imaging": self.imaging, "versions": self.versions}


@dataclass(frozen=True, slots=True, kw_only=True)
class Interrupted:
    """The run was stopped from outside and can be resumed; after a sudden death there is no such entry."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Resuming:
    """A person armed the rig again; before the search continues, its strongest angle is measured again."""

    by: str
    check_deg: float | None
    """This angle; None if nothing has been measured yet."""
    fault_reset: bool
    """Whether the run had ended with a fault, and the person reset it."""
    versions: dict[str, str]
    """Versions of the program that continues, as in `Configuration`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """What was measured at the angle of `Resuming`."""

    reading: Reading
    difference: str | None
    """How the reading differs from the earlier one, in words, so that the search begins again; None if it does not."""
    frame: ChannelFrame | None = None
    """None if there are intensities only."""


JournalEvent: TypeAlias = Event | Interrupted | Resuming | Checked
"""Every kind of event that a journal holds."""


class RecordedError(Exception):
    """The error that ended a recorded run; only its name and message are known."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One committed event."""

    number: int
    """Counted from 1."""
    written: str
    """When it was committed, UTC, ISO 8601."""
    clock_s: float
    """The rig's clock then."""
    event: JournalEvent


def without_frame(event: JournalEvent) -> JournalEvent:
    """Return the event without the frame of its acquisition, where it has one."""
    match event:
        case Measured(sample=sample):
            return replace(event, sample=replace(sample, frame=None))
        case Finished(confirmation=Sample() as sample):
            return replace(event, confirmation=replace(sample, frame=None))
        case Refused() | Checked():
            return replace(event, frame=None)
        case _:
            return event


_KINDS: dict[str, type[JournalEvent]] = {
    each.__name__.lower(): each
    for each in (Started, Asked, Turning, Measured, Swept, Refused, Finished, Failed, Interrupted, Resuming, Checked)
}
_TYPED = frozenset((*get_args(Frame), *get_args(Estimate)))
"""Classes whose name is stored with their fields."""

_MOST_DEG = 1e4
"""Largest angle that is read: no stage reaches it, and no grid of far larger ones has an end."""

_ARRAYS = {"samples": "<i2", "pixels": "|u1"}
"""Fields of frames and images that are arrays, and how they are stored."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodedEvent:
    """An event as it is stored."""

    kind: str
    """Name of its class in lower case."""
    body: bytes
    """Its fields, JSON."""
    samples: memoryview | None
    """Arrays of its frame, one behind the other, row after row: counts as little-endian int16, grey values as uint8;
    None if it has none."""


def encode(event: JournalEvent) -> EncodedEvent:
    """Encode an event.

    Raises `RecordError` if JSON cannot hold the event exactly: a number in it is not finite.
    """
    kind = type(event).__name__.lower()
    blobs: list[memoryview] = []
    stored = replace(event, confirmation=None) if isinstance(event, Finished) else event
    try:
        values = json_values(stored, what=kind, blobs=blobs)
    except RecordError:
        if not isinstance(event, Refused) or event.frame is None:
            raise
        # Such a frame may have been refused because a number in it is not finite; the reason names that number.
        return encode(replace(event, frame=None))
    samples = None if not blobs else blobs[0] if len(blobs) == 1 else memoryview(b"".join(blobs))
    return EncodedEvent(kind=kind, body=msgspec.json.encode(values), samples=samples)


def decode(kind: str, body: bytes, samples: bytes | memoryview | None, *, confirmation: Sample | None) -> JournalEvent:
    """Decode the event of an entry.

    ``confirmation``: the confirming acquisition that was read before, to which `Finished` refers. Raises `RecordError`
    if it cannot have been written by `encode`.
    """
    if kind not in _KINDS:
        raise RecordError(f"an entry of the unknown kind {kind[:40]!r}")
    try:
        # Any of these errors means that `encode` did not write it.
        arrays = _Arrays(samples)
        event: JournalEvent = _built(_KINDS[kind], msgspec.json.decode(body), arrays)
        arrays.require_end()
        if isinstance(event, Measured):
            require_range("the angle of a sample", event.sample.angle_deg, low=-_MOST_DEG, high=_MOST_DEG, unit="deg")
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError, RecursionError) as problem:
        raise RecordError(f"an entry that cannot be read: {problem}") from problem
    return replace(event, confirmation=confirmation) if isinstance(event, Finished) else event


def json_values(value: object, *, what: str, blobs: list[memoryview] | None = None) -> object:
    """A value in the types of JSON.

    ``value``: dataclasses, structs, lists, tuples and dicts of numbers and texts. Text that is no Unicode gets escapes.
    ``blobs``: receives the bytes of each array; only its shape becomes JSON. Raises `RecordError` if a number is not
    finite, which JSON would write as null, as it does what is not known; or of another type.
    """
    match value:
        # msgspec writes bytes as base64, and reads them so.
        case None | bool() | int() | bytes() | msgspec.Raw():
            return value
        case float():
            # msgspec would write NaN and infinity as null, and a value that was lost would look like one not known.
            return require_finite(value, what=what)
        case str():
            return escaped(value)
        case list() | tuple():
            return [json_values(each, what=f"{what}[{index}]", blobs=blobs) for index, each in enumerate(value)]
        case dict():
            return {
                escaped(name): json_values(each, what=f"{what}.{name}", blobs=blobs) for name, each in value.items()
            }
        case np.ndarray() if blobs is not None and (stored := value.dtype.newbyteorder("<").str) in _ARRAYS.values():
            blobs.append(np.ascontiguousarray(value, dtype=stored).data.cast("B"))
            return {"dtype": stored, "shape": list(value.shape)}
        case Exception():
            name = value.kind if isinstance(value, RecordedError) else type(value).__name__
            return {"error": name, "message": escaped(str(value))}
    if is_dataclass(value):
        names = [each.name for each in fields(value)]
    elif isinstance(value, msgspec.Struct):
        names = list(value.__struct_fields__)
    else:
        raise RecordError(f"journal: {what} is a {type(value).__name__}, which cannot be recorded")
    written: dict[str, object] = {"type": type(value).__name__} if type(value) in _TYPED else {}
    return written | {name: json_values(getattr(value, name), what=f"{what}.{name}", blobs=blobs) for name in names}


def escaped(text: str) -> str:
    """A text with bytes that are not Unicode (of a device, or a file name) written as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


def require_finite(number: float, *, what: str) -> float:
    """The number; `RecordError` if it is not finite."""
    if not math.isfinite(number):
        raise RecordError(f"journal: {what} is {number}, which is not finite and cannot be recorded")
    return number


def _built(hint: Any, value: Any, arrays: _Arrays) -> Any:
    """Value of a type from JSON; msgspec converts all but unions of dataclasses, arrays, and what holds them."""
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else ()
    classes: list[type] = [each for each in members if isinstance(each, type) and is_dataclass(each)]
    if classes:
        if value is None and NoneType in members:
            return None
        hint = classes[0] if len(classes) == 1 else {each.__name__: each for each in classes}[_object(value)["type"]]
    if hint is Exception:
        error = msgspec.convert(value, dict[str, str])
        return RecordedError(error["error"], error["message"])
    if isinstance(hint, type) and is_dataclass(hint):
        given = _object(value)
        parts: dict[str, Any] = {}
        # In the order of the fields, which is that of the arrays in the blob.
        for name, kind in _hints(hint).items():
            if name in _ARRAYS:
                parts[name] = arrays.next(given[name], dtype=_ARRAYS[name])
            elif name in given:
                parts[name] = _built(kind, given[name], arrays)
        return hint(**parts)
    return msgspec.convert(value, hint)


@cache
def _hints(kind: type) -> dict[str, Any]:
    # The core imports NumPy for its type checker only.
    return get_type_hints(kind, localns={"np": np})


def _object(value: object) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise TypeError(f"an object is expected, {type(value).__name__} found")
    return value


class _Array(msgspec.Struct, frozen=True, kw_only=True):
    dtype: str
    shape: tuple[int, int]


class _Arrays:
    """The arrays of an entry, read-only views of its blob, in the shapes that the body names."""

    def __init__(self, blob: bytes | memoryview | None) -> None:
        self._left = memoryview(b"" if blob is None else blob)

    def next(self, described: object, *, dtype: str) -> np.ndarray:
        """The next array; `ValueError` if the blob does not hold it."""
        array = msgspec.convert(described, _Array)
        rows, columns = array.shape
        size = np.dtype(dtype).itemsize * rows * columns
        if array.dtype != dtype or rows < 1 or columns < 1 or len(self._left) < size:
            found = f"{array.dtype[:20]} with {len(self._left)} bytes"
            raise ValueError(f"a frame of {rows} rows and {columns} columns of {found}")
        data, self._left = self._left[:size], self._left[size:]
        stored = np.frombuffer(data, dtype=dtype).reshape(rows, columns)
        return stored.astype(stored.dtype.newbyteorder("="), copy=False)

    def require_end(self) -> None:
        """Refuse bytes that belong to no array."""
        if len(self._left):
            raise ValueError(f"{len(self._left)} bytes more than its frame has")
