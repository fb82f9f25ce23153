"""What a search, or a recording, shows on OpenIGTLink: pure, contents of messages made from its events.

TRANSFORM ``ProbeToProbeHome`` and ``DaVinciToProbeHome``, IMAGE ``PA_ProbeHome`` and ``BMode_ProbeHome``, POINT
``PaMarker`` and POSITION ``PaMarkerToProbeHome``, STRING ``SearchState``, STATUS ``PaSearch``. Lengths are in
millimetres; ProbeHome is the frame of the probe at 0 degrees.

Whoever connects has a TRANSFORM and a marker at once, which say that they hold for nothing until a search has them: the
TRANSFORM and the POSITION by the metadata ``TransformStatus``, as PLUS does, the marker by its content.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

import msgspec
import numpy as np

from markerseek.bridges.child import Outcome
from markerseek.core import (
    AcquisitionError,
    Asked,
    BModeImage,
    ChannelFrame,
    Failed,
    Finished,
    Measured,
    NotFound,
    Refused,
    RFFrame,
    Sample,
    ScanGeometry,
    Started,
    Swept,
    Turning,
    UInt8,
)
from markerseek.records import answer_name
from markerseek.records.exports import image_to_probe, probe_to_probe_home
from markerseek.records.journal import Checked, Configuration, Entry, Interrupted, JournalItem
from markerseek.ros import messages
from markerseek.runs import KnownRegistration, rebuild_image_reader
from markerseek.signals import AnyImageReader
from markerseek.wire import igtl


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stream:
    """A message of a stream: its device, which names it, its content, and the metadata of this stream alone.

    ``time_s`` is when that was so, in seconds since 1970: None is now, and 0 where a recording does not say.
    """

    device: str
    content: igtl.Content
    metadata: Mapping[str, str] = field(default_factory=dict)
    time_s: float | None = None


class Streams:
    """Follows the searches of one bridge.

    ``recording``: None where searches run. ``registration``: of the da Vinci system to the probe.
    """

    def __init__(self, *, recording: str | None = None, registration: KnownRegistration | None = None) -> None:
        self._recording, self._registration = recording, registration
        self._begin({"state": "idle"})

    def _begin(self, state: dict[str, Any]) -> None:
        self._state = state
        if self._recording is not None:
            self._state["recording"] = self._recording
        if self._registration is not None:
            self._state["registration"] = self._registration.known
        self._code, self._name, self._sentence = igtl.OK, "IDLE", "no search runs"
        self._imaging: AnyImageReader | None = None
        self._face_radius_m: float | None = None
        self._brightest = 0.0

    @property
    def metadata(self) -> dict[str, str]:
        """Sent with each message: kind of the rig, name of a recording, kind of the registration: what is no bench."""
        known: dict[str, str] = {name: str(self._state[name]) for name in ("rig", "recording") if name in self._state}
        if self._registration is not None:
            known["registration"] = "simulated" if self._registration.simulated else "measured"
        return known

    @property
    def status(self) -> Stream:
        """STATUS: sent on each change, and as a sign of life."""
        content = igtl.Status(code=self._code, name=self._name, message=self._sentence)
        return Stream(device="PaSearch", content=content)

    def idle(self) -> list[Stream]:
        """Before the first search; no angle is known, and TRANSFORM says so."""
        return [self.status, self._said(), _transform(0.0, known=False), *_marker(None), *self._registered()]

    def _registered(self) -> list[Stream]:
        if self._registration is None:
            return []
        matrix = self._registration.davinci_to_trus.matrix
        matrix[:3, 3] *= 1e3
        return [Stream(device="DaVinciToProbeHome", content=igtl.Transform(matrix=matrix))]

    def started(self) -> list[Stream]:
        """A search, or a recording, begins: the marker of the one before is withdrawn."""
        playing = self._recording is not None
        self._begin({"state": "playing" if playing else "running"})
        self._code, self._name = igtl.BUSY, "PLAYING" if playing else "SEARCHING"
        self._sentence = f"plays {self._recording}" if playing else "the search begins"
        return [*_marker(None), self.status, self._said()]

    def after(self, item: JournalItem) -> list[Stream]:
        """What changes with one item of a search's journal."""
        match item:
            case Configuration(facts=facts, plan=plan):
                self._imaging = rebuild_image_reader(item)
                self._face_radius_m = facts.face_radius_m
                self._state |= {"rig": facts.kind, "emulated": facts.emulated, "method": plan.method}
                self._state |= {"acquisitions": 0, "refused": 0}
                if self._face_radius_m is None:
                    self._state["no_image"] = (
                        "the rig has no probe.face_radius_m, so that the place of images is unknown"
                    )
                self._sentence += f", on a {facts.kind} rig"
                return [self.status, self._said()]
            case Entry():
                streams = [*self._after_event(item), self._said()]
                # One time for all: an image belongs to the transform of its acquisition.
                return [replace(each, time_s=self._time_s(item)) for each in streams]

    def _time_s(self, item: Entry) -> float:
        """When an event was, in seconds since 1970: of an acquisition its first moment, not that of its message."""
        written_s = _written_s(item.written)
        # A simulated clock runs ahead of the time of day.
        if not isinstance(item.event, Measured) or self._state.get("rig") != "bench":
            return written_s
        frame = item.event.sample.frame
        since_s = 0.0 if frame is None else item.clock_s - frame.header.started_s
        return written_s - since_s if 0 <= since_s <= written_s else written_s

    def _after_event(self, item: Entry) -> list[Stream]:
        event = item.event
        target_deg = event.target_deg if isinstance(event, Turning) else None
        self._state |= {"number": item.number, "clock_s": item.clock_s, "target_deg": target_deg}
        match event:
            case Started(start_deg=angle_deg) | Swept(angle_deg=angle_deg) | Turning(angle_deg=float(angle_deg)):
                # A search that begins anew counts from 0 again.
                self._state |= {"acquisitions": 0, "refused": 0} if isinstance(event, Started) else {}
                return [self._turned(angle_deg)]
            case Asked(role=role, index=index, angle_deg=angle_deg):
                self._state |= {"role": role, "index": index, "target_deg": angle_deg}
            case Measured(sample=sample):
                self._state["acquisitions"] += event.role == "search"
                self._state |= {"angle_deg": sample.angle_deg, "intensity": sample.reading.intensity}
                self._state |= {"role": event.role, "index": event.index}
                return [self._turned(sample.angle_deg), *self._pictured(sample)]
            case Refused(reason=reason):
                self._state["refused"] += 1
                self._state["reason"] = reason
            case Finished(estimate=estimate):
                self._state |= {"answer": answer_name(estimate), "answer_deg": estimate.mean_deg}
                if not isinstance(estimate, NotFound):
                    interval = estimate.interval95_deg
                    ends_deg = None if interval is None else (interval.low_deg, interval.high_deg)
                    self._state |= {"answer_sigma_deg": estimate.sigma_deg, "answer_interval95_deg": ends_deg}
            case Failed(error=error):
                self._state["reason"] = str(error)
            case Interrupted(reason=reason):
                self._state["reason"] = f"stopped by {reason}"
            case Checked():
                self._state["reason"] = event.difference
        return []

    def _turned(self, angle_deg: float) -> Stream:
        self._state["angle_deg"] = angle_deg
        return _transform(angle_deg, known=True)

    def _pictured(self, sample: Sample) -> list[Stream]:
        """The images of an acquisition at their place: a photoacoustic one in shades of decibels, B-mode as it is."""
        frame, angle_deg = sample.frame, sample.angle_deg
        b_mode: BModeImage | None = frame if isinstance(frame, BModeImage) else getattr(frame, "b_mode", None)
        sent = [] if b_mode is None else self._placed("BMode_ProbeHome", b_mode.pixels, b_mode.geometry, angle_deg)
        if self._imaging is None or self._face_radius_m is None or not isinstance(frame, ChannelFrame | RFFrame):
            return sent
        try:
            image = self._imaging.picture(frame)
        except AcquisitionError as problem:
            self._state["no_image"] = str(problem)
            return sent
        self._brightest = max(self._brightest, float(image.envelope.max()))
        shades = messages.grey(image.envelope, brightest=self._brightest)
        return [*sent, *self._placed("PA_ProbeHome", shades, image.geometry, angle_deg)]

    def _placed(
        self, device: str, pixels: UInt8[np.ndarray, "rows columns"], geometry: ScanGeometry, angle_deg: float
    ) -> list[Stream]:
        """An image in ProbeHome; nothing where its place there is unknown."""
        if self._face_radius_m is None:
            return []
        matrix = probe_to_probe_home(angle_deg) @ image_to_probe(geometry, face_radius_m=self._face_radius_m)
        return [Stream(device=device, content=igtl.Image(pixels=pixels[np.newaxis], matrix=matrix))]

    def ended(self, outcome: Outcome | None) -> list[Stream]:
        """The search has ended, or a recording, which may have no outcome."""
        if outcome is None:
            self._state |= {"state": "ended", "target_deg": None}
            self._code, self._name, self._sentence = igtl.OK, "ENDED", f"{self._recording} is over"
            return [self.status, self._said()]
        answer = outcome.answer or {}
        self._state |= {
            "state": "ended",
            "exit_code": outcome.exit_code,
            "message": outcome.message,
            "target_deg": None,
        }
        # 500 acquisitions would not fit into a STRING; they were sent one by one.
        self._state["result"] = {key: value for key, value in answer.items() if key != "samples"} or None
        self._code, self._name = _STATUS.get(outcome.exit_code, (igtl.UNKNOWN_ERROR, "FAULT"))
        published = bool(answer.get("as_published"))
        if outcome.answered and "answer" in answer:
            # The answer's own name: a marker that is unsure, ambiguous or at a bound may well be there.
            name = "no claim" if published else str(answer["answer"])
            self._code, self._name = igtl.OK, name.upper().replace(" ", "_")
        self._sentence = outcome.message
        # A place that is known roughly is not for one who aims at it.
        place = answer.get("marker_trus_m") if answer.get("found") and not published else None
        if place is None:
            return [self.status, self._said()]
        x, y, z = (1e3 * each for each in place)
        point = igtl.Point(name="PaMarker", group=str(self._state.get("rig", "")), position_mm=(x, y, z))
        return [self.status, *_marker(point), self._said()]

    def _said(self) -> Stream:
        text = msgspec.json.encode(self._state)
        if len(text) > igtl.MAX_TEXT_BYTES:
            text = msgspec.json.encode(self._state | {"result": None, "reason": "too long for a STRING"})
        return Stream(device="SearchState", content=igtl.Text(text=text.decode()))


def _transform(angle_deg: float, *, known: bool) -> Stream:
    content = igtl.Transform(matrix=probe_to_probe_home(angle_deg))
    return Stream(device="ProbeToProbeHome", content=content, metadata=_status(known=known))


def _marker(point: igtl.Point | None) -> list[Stream]:
    """The marker; None withdraws what clients have."""
    place_mm = None if point is None else point.position_mm
    # POINT for people, who see it named; POSITION for controllers, which need no list.
    return [
        Stream(device="PaMarker", content=igtl.Points(points=() if point is None else (point,))),
        Stream(
            device="PaMarkerToProbeHome",
            content=igtl.Position(position_mm=place_mm),
            metadata=_status(known=point is not None),
        ),
    ]


def _status(*, known: bool) -> dict[str, str]:
    """What PLUS and 3D Slicer call the status of a transform."""
    return {"TransformStatus": "OK" if known else "INVALID"}


def _written_s(text: str) -> float:
    """Seconds since 1970; 0 where a recording has no time, or none that can be sent."""
    try:
        time_s = datetime.fromisoformat(text).timestamp()
    except (ValueError, OverflowError, OSError):
        return 0.0
    return time_s if 0 <= time_s < 2**32 else 0.0


_STATUS = {
    4: (igtl.NOT_READY, "NOT_ARMED"),
    130: (igtl.OK, "STOPPED"),
    143: (igtl.OK, "STOPPED"),
}
"""Code and name of a STATUS by the exit code of a search without an answer; any other is a fault."""
