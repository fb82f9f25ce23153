"""What a journal holds, the configuration of a run and then its entries, and how the event of an entry is stored.

An event is stored as its kind, a JSON body, and the raw samples of a frame. The body is its struct, field by field.
Where a field can hold one of several classes (a frame, an estimate), ``type`` names the class. Two things are stored
elsewhere: the samples of a frame behind the line, and the confirmation of `Finished` in the entry of that
acquisition.
"""

from __future__ import annotations

import math
import platform
import zlib
from typing import TypeAlias

import msgspec
import numpy as np
import scipy
from msgspec.structs import replace

from markerseek._version import __version__
from markerseek.core import (
    Asked,
    ChannelFrame,
    Event,
    Failed,
    Finished,
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
    """Return the versions of the libraries on which the last bit of a result depends."""
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


class Interrupted(msgspec.Struct, frozen=True, kw_only=True):
    """The run was stopped from outside and can be resumed; after a sudden death there is no such entry."""

    reason: str


class Resuming(msgspec.Struct, frozen=True, kw_only=True):
    """A person armed the rig again; before the search continues, its strongest angle is measured again."""

    by: str
    check_deg: float | None
    """This angle; None if nothing has been measured yet."""
    fault_reset: bool
    """Whether the run had ended with a fault, and the person reset it."""
    versions: dict[str, str]
    """Versions of the program that continues, as in `Configuration`."""


class Checked(msgspec.Struct, frozen=True, kw_only=True):
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


class JournalEntry(msgspec.Struct, frozen=True, kw_only=True):
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
_MOST_DEG = 1e4
"""Largest angle that is read: no stage reaches it, and no grid of far larger ones has an end."""

_STORED = "<i2"
"""How the counts of a frame are stored: as little-endian int16."""


class StoredEntry(msgspec.Struct, frozen=True, kw_only=True):
    """An entry as it is stored: a line of JSON, behind which the samples of its frame stand."""

    number: int = 0
    """As of `JournalEntry`; 0 in files of version 1, whose lines have it elsewhere."""
    block: int = 0
    """Bytes of the samples behind the line."""
    block_crc: str = ""
    """CRC-32 of these bytes, hexadecimal."""
    kind: str = ""
    """Name of the event's class in lower case."""
    written: str = ""
    clock_s: float = 0.0
    """``written`` and ``clock_s``: as of `JournalEntry`."""
    body: msgspec.Raw = msgspec.Raw(b"null")
    """Fields of the event, JSON."""


def encode_entry(entry: JournalEntry) -> tuple[StoredEntry, bytes | memoryview]:
    """Return an entry as it is stored, and the samples of its frame: row after row, as little-endian int16.

    Raises `RecordError` if JSON cannot hold the event exactly: a number in it is not finite.
    """
    event = entry.event
    kind = type(event).__name__.lower()
    counts: list[memoryview] = []
    stored = replace(event, confirmation=None) if isinstance(event, Finished) else event
    try:
        body = as_json(stored, what=kind, counts=counts)
    except RecordError:
        if not isinstance(event, Refused) or event.frame is None:
            raise
        # Such a frame may have been refused because a number in it is not finite; the reason names that number.
        return encode_entry(replace(entry, event=replace(event, frame=None)))
    samples = counts[0] if counts else b""
    line = StoredEntry(
        number=entry.number,
        block=len(samples),
        block_crc=f"{zlib.crc32(samples):08x}",
        kind=kind,
        written=entry.written,
        clock_s=require_finite(float(entry.clock_s), what="the rig's clock"),
        body=msgspec.Raw(body),
    )
    return line, samples


def decode_entry(line: StoredEntry, samples: bytes | memoryview, *, confirmation: Sample | None) -> JournalEvent:
    """Return the event of an entry that was stored.

    ``confirmation``: the confirming acquisition that was read before, to which `Finished` refers. Raises `RecordError`
    if it cannot have been written by `encode_entry`.
    """
    if line.kind not in _KINDS:
        raise RecordError(f"an entry of the unknown kind {line.kind[:40]!r}")
    blob = _Blob(samples)
    try:
        # Any of these errors means that `encode_entry` did not write it.
        event = msgspec.json.decode(line.body, type=_KINDS[line.kind], dec_hook=blob.decoded)
        blob.require_end()
        if isinstance(event, Measured):
            require_range("the angle of a sample", event.sample.angle_deg, low=-_MOST_DEG, high=_MOST_DEG, unit="deg")
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as problem:
        raise RecordError(f"an entry that cannot be read: {problem}") from problem
    return replace(event, confirmation=confirmation) if isinstance(event, Finished) else event


def as_json(value: msgspec.Struct, *, what: str, counts: list[memoryview] | None = None) -> bytes:
    """Return a value as JSON, exactly.

    Text that is no Unicode gets escapes. ``counts``: receives the samples of each frame, of which only the shape
    becomes JSON. Raises `RecordError` if a number is not finite, or something has no JSON.
    """

    def encoded(other: object) -> object:
        """Return what stands for a value that msgspec does not encode."""
        match other:
            case np.ndarray() if counts is not None and other.dtype == _STORED:
                counts.append(np.ascontiguousarray(other, dtype=_STORED).data.cast("B"))
                return {"dtype": _STORED, "shape": list(other.shape)}
            case Exception():
                name = other.kind if isinstance(other, RecordedError) else type(other).__name__
                return {"error": name, "message": str(other)}
        raise RecordError(f"journal: {what} has a {type(other).__name__}, which cannot be recorded")

    values = msgspec.to_builtins(value, builtin_types=(msgspec.Raw,), enc_hook=encoded)
    # msgspec would write NaN and infinity as null, and a value that was lost would look like one that is not known.
    _require_finite(values, what=what)
    try:
        return msgspec.json.encode(values)
    except UnicodeEncodeError:
        return msgspec.json.encode(_escaped(values))


def _require_finite(value: object, *, what: str) -> None:
    """Refuse a number that is not finite, by its name."""
    if isinstance(value, float):
        require_finite(value, what=what)
    elif isinstance(value, dict):
        for name, each in value.items():
            if isinstance(each, float | dict | list | tuple):
                _require_finite(each, what=f"{what}.{name}")
    elif isinstance(value, list | tuple):
        for index, each in enumerate(value):
            _require_finite(each, what=f"{what}[{index}]")


def require_finite(number: float, *, what: str) -> float:
    """Return the number; `RecordError` if it is not finite."""
    if not math.isfinite(number):
        raise RecordError(f"journal: {what} is {number}, which is not finite and cannot be recorded")
    return number


def _escaped(value: object) -> object:
    """Return builtin values with all their texts `escaped`."""
    match value:
        case str():
            return escaped(value)
        case list() | tuple():
            return [_escaped(each) for each in value]
        case dict():
            return {_escaped(name): _escaped(each) for name, each in value.items()}
        case _:
            return value


def escaped(text: str) -> str:
    """Return a text with bytes that are not Unicode (of a device, or a file name) written as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


class _Array(msgspec.Struct, frozen=True, kw_only=True):
    dtype: str
    shape: tuple[int, int]


class _StoredError(msgspec.Struct, frozen=True, kw_only=True):
    error: str
    message: str


class _Blob:
    """The bytes behind a line: the samples of its frames, of which the body has the shapes in the same order."""

    def __init__(self, blob: bytes | memoryview) -> None:
        self._left = memoryview(blob)

    def decoded(self, kind: type, value: object) -> object:
        """Return an error of a run, or the next array: a read-only view, `ValueError` if the blob does not hold it."""
        if kind is Exception:
            error = msgspec.convert(value, _StoredError)
            return RecordedError(error.error, error.message)
        array = msgspec.convert(value, _Array)
        rows, columns = array.shape
        size = np.dtype(_STORED).itemsize * rows * columns
        if array.dtype != _STORED or rows < 1 or columns < 1 or len(self._left) < size:
            found = f"{array.dtype[:20]} with {len(self._left)} bytes"
            raise ValueError(f"a frame of {rows} rows and {columns} columns of {found}")
        data = self._left[:size]
        self._left = self._left[size:]
        stored = np.frombuffer(data, dtype=_STORED).reshape(rows, columns)
        return stored.astype(stored.dtype.newbyteorder("="), copy=False)

    def require_end(self) -> None:
        """Refuse bytes that belong to no array."""
        if len(self._left):
            raise ValueError(f"{len(self._left)} bytes more than its frame has")
