"""What a search, or a recording, shows on OpenIGTLink: pure, contents of messages made from its events.

TRANSFORM ``ProbeToProbeHome`` and ``DaVinciToTrus``, IMAGE ``PA_Reference`` and ``BMode_Reference``, POINT
``PaMarker`` and POSITION ``PaMarkerToProbeHome``, STRING ``SearchState``, STATUS ``PaSearch``. Lengths are in
millimetres. Reference and Trus are ProbeHome, the frame of the probe at 0 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    Refused,
    RFFrame,
    Sample,
    ScanGeometry,
    Started,
    UInt8,
)
from markerseek.records import answer_name
from markerseek.records.exports import image_to_probe, probe_to_probe_home
from markerseek.records.journal import Checked, Interrupted
from markerseek.records.stream import StreamEnd, StreamEvent, StreamHead, StreamItem
from markerseek.ros import messages
from markerseek.runs import KnownRegistration, rebuild_image_reader
from markerseek.signals import AnyImageReader
from markerseek.wire import igtl

MARKER, MARKER_POSITION = "PaMarker", "PaMarkerToProbeHome"
"""Streams that tell of the last search only."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stream:
    """A message of a stream: its device, which names it, and its content."""

    device: str
    content: igtl.Content


class Streams:
    """Follows the searches of one bridge.

    Parameters
    ----------
    recording
        Name of the recording that is played; None where searches run.
    registration
        Of the da Vinci system to the probe; None where none is known.
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
        """Before the first search."""
        return [self.status, self._said(), *self._registered()]

    def _registered(self) -> list[Stream]:
        if self._registration is None:
            return []
        matrix = self._registration.davinci_to_trus.matrix
        matrix[:3, 3] *= 1e3
        return [Stream(device="DaVinciToTrus", content=igtl.Transform(matrix=matrix))]

    def started(self) -> list[Stream]:
        """A search, or a recording, begins."""
        playing = self._recording is not None
        self._begin({"state": "playing" if playing else "running"})
        self._code, self._name = igtl.BUSY, "PLAYING" if playing else "SEARCHING"
        self._sentence = f"plays {self._recording}" if playing else "the search begins"
        return [self.status, self._said()]

    def after(self, item: StreamItem) -> list[Stream]:
        """What changes with one item of a search's stream."""
        match item:
            case StreamHead(configuration=configuration):
                facts, plan = configuration.facts, configuration.plan
                self._imaging = rebuild_image_reader(configuration)
                self._face_radius_m = facts.face_radius_m
                self._state |= {"rig": facts.kind, "emulated": facts.emulated, "method": plan.method}
                self._state |= {"acquisitions": 0, "refused": 0, "lost_lines": 0, "lost_frames": 0}
                if self._face_radius_m is None:
                    self._state["no_image"] = (
                        "the rig has no probe.face_radius_m, so that the place of images is unknown"
                    )
                self._sentence += f", on a {facts.kind} rig"
                return [self.status, self._said()]
            case StreamEvent():
                self._state["lost_lines"] += item.lost_lines
                self._state["lost_frames"] += item.lost_frames
                return [*self._after_event(item), self._said()]
            case StreamEnd():
                return []

    def _after_event(self, item: StreamEvent) -> list[Stream]:
        event = item.event
        self._state |= {"number": item.number, "clock_s": item.clock_s, "target_deg": None}
        match event:
            case Started(start_deg=start_deg):
                return [self._turned(start_deg)]
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
            case Failed(error=error):
                self._state["reason"] = str(error)
            case Interrupted(reason=reason):
                self._state["reason"] = f"stopped by {reason}"
            case Checked(difference=difference):
                self._state["reason"] = difference
        return []

    def _turned(self, angle_deg: float) -> Stream:
        self._state["angle_deg"] = angle_deg
        return Stream(device="ProbeToProbeHome", content=igtl.Transform(matrix=probe_to_probe_home(angle_deg)))

    def _pictured(self, sample: Sample) -> list[Stream]:
        """The images of an acquisition at their place: a photoacoustic one in shades of decibels, B-mode as it is."""
        frame, angle_deg = sample.frame, sample.angle_deg
        b_mode: BModeImage | None = frame if isinstance(frame, BModeImage) else getattr(frame, "b_mode", None)
        sent = [] if b_mode is None else self._placed("BMode_Reference", b_mode.pixels, b_mode.geometry, angle_deg)
        if self._imaging is None or self._face_radius_m is None or not isinstance(frame, ChannelFrame | RFFrame):
            return sent
        try:
            image = self._imaging.picture(frame)
        except AcquisitionError as problem:
            self._state["no_image"] = str(problem)
            return sent
        self._brightest = max(self._brightest, float(image.envelope.max()))
        shades = messages.grey(image.envelope, brightest=self._brightest)
        return [*sent, *self._placed("PA_Reference", shades, image.geometry, angle_deg)]

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
        self._sentence = outcome.message
        place = answer.get("marker_trus_m")
        marker = [] if place is None else self._marked(tuple(1e3 * each for each in place))
        return [self.status, *marker, self._said()]

    def _marked(self, position_mm: tuple[float, ...]) -> list[Stream]:
        x, y, z = position_mm
        # POINT for people, who see it named; POSITION for controllers, which need no list.
        point = igtl.Point(name="PaMarker", group=str(self._state.get("rig", "")), position_mm=(x, y, z))
        return [
            Stream(device=MARKER, content=igtl.Points(points=(point,))),
            Stream(device=MARKER_POSITION, content=igtl.Position(position_mm=(x, y, z))),
        ]

    def _said(self) -> Stream:
        text = msgspec.json.encode(self._state)
        if len(text) > igtl.MOST_TEXT_BYTES:
            text = msgspec.json.encode(self._state | {"result": None, "reason": "too long for a STRING"})
        return Stream(device="SearchState", content=igtl.Text(text=text.decode()))


_STATUS = {
    0: (igtl.OK, "FOUND"),
    3: (igtl.OK, "NOT_FOUND"),
    4: (igtl.NOT_READY, "NOT_ARMED"),
    130: (igtl.OK, "STOPPED"),
    143: (igtl.OK, "STOPPED"),
}
"""Code and name of a STATUS by the exit code of a search; any other is a fault."""
