"""Events as rows: a kind, a JSON body, and the samples of a frame as they are."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeVar

import msgspec

from markerseek.core import (
    Ambiguous,
    Asked,
    AtBound,
    ChannelFrame,
    Estimate,
    Failed,
    Finished,
    Found,
    Interval,
    Measured,
    NotFound,
    Reading,
    RecordError,
    Refused,
    Role,
    Sample,
    Started,
    Unsure,
)
from markerseek.records.journal.entries import Checked, Happening, Interrupted, RecordedError, Resuming
from markerseek.records.journal.frame_rows import (
    ChannelFrameBody,
    FrameBody,
    channel_body,
    channels_of,
    counts_of,
    frame_body,
    frame_of,
    is_exact,
)
from markerseek.records.journal.plain import plain
from markerseek.records.result import answer_name

Body = TypeVar("Body")

_ANSWERS: dict[str, type[Estimate]] = {
    "found": Found,
    "not found": NotFound,
    "ambiguous": Ambiguous,
    "at bound": AtBound,
    "unsure": Unsure,
}


class _StartedBody(msgspec.Struct, frozen=True, kw_only=True):
    start_deg: float
    limits: Interval


class _AskedBody(msgspec.Struct, frozen=True, kw_only=True):
    role: Role
    index: int
    angle_deg: float


class _MeasuredBody(msgspec.Struct, frozen=True, kw_only=True):
    role: Role
    index: int
    angle_deg: float
    dark: bool
    reading: Reading
    frame: FrameBody | None


class _RefusedBody(msgspec.Struct, frozen=True, kw_only=True):
    angle_deg: float
    reason: str
    frame: FrameBody | None = None


class _CheckedBody(msgspec.Struct, frozen=True, kw_only=True):
    reading: Reading
    difference: str | None
    frame: ChannelFrameBody | None = None


class _FinishedBody(msgspec.Struct, frozen=True, kw_only=True):
    answer: Literal["found", "not found", "ambiguous", "at bound", "unsure"]
    estimate: object
    acquisitions: int
    travel_deg: float
    elapsed_s: float


class _FailedBody(msgspec.Struct, frozen=True, kw_only=True):
    error: str
    message: str


def to_row(event: Happening) -> tuple[str, bytes, memoryview | None]:
    """Kind, body and samples of an event.

    Raises
    ------
    RecordError
        If JSON cannot hold the event exactly: a number in it is not finite.
    """
    if isinstance(event, Refused) and event.frame is not None and not is_exact(event.frame):
        # Its numbers are why it was refused, and the reason names them.
        event = replace(event, frame=None)
    kind, encoded = _encoded(event)
    samples = _samples(event)
    if _encoded(from_row(kind, encoded, samples, confirmation=None))[1] != encoded:
        raise RecordError(f"journal: {kind} does not read back as it was and cannot be recorded: {event!r}")
    return kind, encoded, samples


def _encoded(event: Happening) -> tuple[str, bytes]:
    kind, body = _body(event)
    return kind, msgspec.json.encode(plain(body, what=kind))


def from_row(kind: str, body: bytes, samples: bytes | memoryview | None, *, confirmation: Sample | None) -> Happening:
    """Event of a row.

    Parameters
    ----------
    kind, body, samples
        As `to_row` gave them.
    confirmation
        The confirming acquisition that was read before, which the end of a run refers to.

    Raises
    ------
    RecordError
        If the row is none of ours.
    """
    match kind:
        case "started":
            started = _decode(body, _StartedBody)
            return Started(start_deg=started.start_deg, limits=started.limits)
        case "asked":
            asked = _decode(body, _AskedBody)
            return Asked(role=asked.role, index=asked.index, angle_deg=asked.angle_deg)
        case "measured":
            return _measured(_decode(body, _MeasuredBody), samples)
        case "refused":
            refused = _decode(body, _RefusedBody)
            frame = None if refused.frame is None else frame_of(refused.frame, samples)
            return Refused(angle_deg=refused.angle_deg, reason=refused.reason, frame=frame)
        case "finished":
            return _finished(_decode(body, _FinishedBody), confirmation)
        case "failed":
            failed = _decode(body, _FailedBody)
            return Failed(error=RecordedError(failed.error, failed.message))
        case "interrupted":
            return _decode(body, Interrupted)
        case "resuming":
            return _decode(body, Resuming)
        case "checked":
            checked = _decode(body, _CheckedBody)
            seen = None if checked.frame is None else channels_of(checked.frame, samples)
            return Checked(reading=checked.reading, difference=checked.difference, frame=seen)
    raise RecordError(f"an entry of the unknown kind {kind[:40]!r}")


def _body(event: Happening) -> tuple[str, object]:
    match event:
        case Started():
            return "started", _StartedBody(start_deg=event.start_deg, limits=event.limits)
        case Asked():
            return "asked", _AskedBody(role=event.role, index=event.index, angle_deg=event.angle_deg)
        case Measured(sample=sample):
            body = _MeasuredBody(
                role=event.role,
                index=event.index,
                angle_deg=sample.angle_deg,
                dark=sample.dark,
                reading=sample.reading,
                frame=None if sample.frame is None else frame_body(sample.frame),
            )
            return "measured", body
        case Refused():
            held = None if event.frame is None else frame_body(event.frame)
            return "refused", _RefusedBody(angle_deg=event.angle_deg, reason=event.reason, frame=held)
        case Finished(estimate=estimate):
            return "finished", _FinishedBody(
                answer=answer_name(estimate),
                estimate=estimate,
                acquisitions=event.acquisitions,
                travel_deg=event.travel_deg,
                elapsed_s=event.elapsed_s,
            )
        case Failed(error=error):
            name = error.kind if isinstance(error, RecordedError) else type(error).__name__
            return "failed", _FailedBody(error=name, message=str(error))
        case Interrupted():
            return "interrupted", event
        case Resuming():
            return "resuming", event
        case Checked(frame=seen):
            channels = None if seen is None else channel_body(seen)
            return "checked", _CheckedBody(reading=event.reading, difference=event.difference, frame=channels)


def _samples(event: Happening) -> memoryview | None:
    match event:
        case Measured(sample=sample):
            frame = sample.frame
        case Refused(frame=frame) | Checked(frame=frame):
            pass
        case _:
            return None
    return counts_of(frame) if isinstance(frame, ChannelFrame) else None


def _measured(body: _MeasuredBody, samples: bytes | memoryview | None) -> Measured:
    frame = None if body.frame is None else frame_of(body.frame, samples)
    sample = Sample(angle_deg=body.angle_deg, reading=body.reading, dark=body.dark, frame=frame)
    return Measured(role=body.role, index=body.index, sample=sample)


def _finished(body: _FinishedBody, confirmation: Sample | None) -> Finished:
    try:
        estimate = msgspec.convert(body.estimate, _ANSWERS[body.answer])
    except msgspec.ValidationError as problem:
        raise RecordError(f"an entry that cannot be read: {problem}") from problem
    return Finished(
        estimate=estimate,
        confirmation=confirmation,
        acquisitions=body.acquisitions,
        travel_deg=body.travel_deg,
        elapsed_s=body.elapsed_s,
    )


def _decode(body: bytes, kind: type[Body]) -> Body:
    try:
        return msgspec.json.decode(body, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
        raise RecordError(f"an entry that cannot be read: {problem}") from problem
