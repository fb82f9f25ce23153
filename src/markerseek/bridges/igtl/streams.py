"""What a search shows on OpenIGTLink: pure, contents of messages made from its view.

TRANSFORM ``ProbeToProbeHome`` and ``DaVinciToProbeHome``, IMAGE ``PA_ProbeHome``, POINT
``PaMarker`` and POSITION ``PaMarkerToProbeHome``, STRING ``SearchState``, STATUS ``PaSearch`` and
``DaVinciRegistration``. Lengths are in millimetres; ProbeHome is the frame of the probe at 0 degrees.

A new client has a TRANSFORM and a marker at once. Until a search has found them, both say that they are not valid: the
TRANSFORM and the POSITION by the metadata ``TransformStatus``, as in PLUS, the marker by its content. A registration is
sent when it holds, and withdrawn when it holds no longer: its TRANSFORM is NaN then, which no client can take for a
place, whether it reads metadata or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

import msgspec
import numpy as np

from markerseek.bridges.outcome import Outcome
from markerseek.bridges.run_images import PicturedEntry, PicturedItem, since_fired_s
from markerseek.core import Float64, Measured
from markerseek.records.banks import image_to_probe, probe_to_probe_home
from markerseek.records.journal import Configuration, RunView
from markerseek.registration import KnownRegistration, SessionView
from markerseek.show import event_line, grey_levels
from markerseek.wire import igtl


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreamMessage:
    """A message of one of the streams, before it is encoded."""

    device: str
    """Name of the stream."""
    content: igtl.Content
    """Content of the message."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Metadata of this stream alone."""
    time_s: float | None = None
    """Time of the content in seconds since 1970; None for now."""


class Streams:
    """Shows the searches of one bridge, one after the other.

    ``registration``: of the da Vinci system to the probe, as it is now; None if none is shown.
    """

    def __init__(self, *, registration: SessionView | None = None) -> None:
        self.registration = registration
        self._withdrawn = False
        self._begin("idle")

    def _begin(self, state: str) -> None:
        self._state = state
        self._outcome = Outcome(exit_code=0)
        self._view: RunView | None = None
        self._problem = ""

    @property
    def metadata(self) -> dict[str, str]:
        """Sent with each message: kind of the rig, kind of the registration."""
        known = {} if self._view is None else {"rig": str(self._view.facts.kind)}
        if self._known_registration is not None:
            known["registration"] = "simulated" if self._known_registration.simulated else "measured"
        return known

    @property
    def _known_registration(self) -> KnownRegistration | None:
        """The registration that holds; None if there is none."""
        return None if self.registration is None else self.registration.registration

    @property
    def status(self) -> StreamMessage:
        """STATUS: sent on each change, and as a sign of life."""
        code, name, sentence = self._status()
        return StreamMessage(device="PaSearch", content=igtl.Status(code=code, name=name, message=sentence))

    def _status(self) -> tuple[int, str, str]:
        match self._state:
            case "idle":
                return igtl.OK, "IDLE", "no search runs"
            case "running":
                return igtl.BUSY, "SEARCHING", (self._view and event_line(self._view)) or "the search begins"
        outcome = self._outcome
        if outcome.answered and outcome.result is not None:
            # The answer's own name: a marker that is unsure, ambiguous or at a bound may well be there.
            name = "no claim" if outcome.result.as_published else outcome.result.answer
            return igtl.OK, name.upper().replace(" ", "_"), outcome.message
        if outcome.stopped:
            return igtl.OK, "STOPPED", outcome.message
        if outcome.failed or outcome.answered:
            return igtl.UNKNOWN_ERROR, "FAULT", outcome.message
        return igtl.NOT_READY, "NOT_ARMED", outcome.message

    def idle(self) -> list[StreamMessage]:
        """Return the messages before the first search; no angle is known, and TRANSFORM says so."""
        streams = [self.status, self._state_message(), _transform(0.0, known=False), *_marker(None)]
        if self.registration is not None:
            streams.append(_registration_status(self.registration, withdrawn=False))
        if self._known_registration is not None:
            streams.append(_registration_transform(self._known_registration))
        return streams

    def registered(self, view: SessionView) -> list[StreamMessage]:
        """Return what changes with a new state of the registration: its transform if it is another, or withdrawn."""
        before = self._known_registration
        self.registration = view
        now = view.registration
        # Once withdrawn, it is called so until there is another.
        self._withdrawn = now is None and (self._withdrawn or before is not None)
        streams = [] if now is before else [_registration_transform(now)]
        return [*streams, _registration_status(view, withdrawn=self._withdrawn), self._state_message()]

    def started(self) -> list[StreamMessage]:
        """Begin a search; the marker of the search before is withdrawn."""
        self._begin("running")
        return [*_marker(None), self.status, self._state_message()]

    def after(self, item: PicturedItem) -> list[StreamMessage]:
        """Return what changes with one item of a search's journal."""
        if isinstance(item, Configuration):
            self._view = RunView.of(item)
            return [self.status, self._state_message()]
        before = self._view
        entry = item.entry
        assert before is not None  # noqa: S101  a journal begins with its configuration
        view = before.add_entry(entry)
        self._view = view
        self._problem = item.problem
        streams = []
        if view.seen_deg is not None and (isinstance(entry.event, Measured) or view.seen_deg != before.seen_deg):
            streams.append(_transform(view.seen_deg, known=True))
        streams += _pictured(item, face_radius_m=view.facts.face_radius_m)
        # One time for all: an image belongs to the transform of its acquisition.
        time_s = datetime.fromisoformat(entry.written).timestamp() - since_fired_s(view, entry)
        return [replace(each, time_s=time_s) for each in [*streams, self._state_message()]]

    def ended(self, outcome: Outcome) -> list[StreamMessage]:
        """End a search, and return the messages of its end."""
        self._state = "ended"
        self._outcome = outcome
        result = outcome.result
        marker = []
        # A place that is known roughly is not for a robot that aims at it.
        if result is not None and result.is_claimed and result.marker_trus_m is not None:
            x, y, z = (1e3 * each for each in result.marker_trus_m)
            marker = _marker(igtl.Point(name="PaMarker", group=self.metadata.get("rig", ""), position_mm=(x, y, z)))
        return [self.status, *marker, self._state_message()]

    def _state_message(self) -> StreamMessage:
        """Return the state as JSON, a STRING."""
        state: dict[str, Any] = {"state": self._state}
        if self.registration is not None:
            state["registration"] = self.registration.known
        if self._view is not None:
            state |= _known(self._view)
            problem = self._problem
            if self._view.facts.face_radius_m is None:
                problem = "the rig has no probe.face_radius_m, so that the place of images is unknown"
            state |= {"no_image": problem} if problem else {}
        if self._state == "ended":
            outcome = self._outcome
            # 500 acquisitions would not fit into a STRING; they were sent one by one.
            result = {key: value for key, value in (outcome.printed or {}).items() if key != "samples"}
            state |= {"exit_code": outcome.exit_code, "message": outcome.message, "result": result or None}
        text = msgspec.json.encode(state)
        if len(text) > igtl.MAX_TEXT_BYTES:
            text = msgspec.json.encode(state | {"result": None, "line": "too long for a STRING"})
        return StreamMessage(device="SearchState", content=igtl.Text(text=text.decode()))


def _known(view: RunView) -> dict[str, Any]:
    """Return what a view says, as plain values."""
    facts = view.facts
    return {
        "number": view.number,
        "phase": view.phase,
        "line": event_line(view),
        "role": view.role,
        "index": view.index,
        "acquisitions": view.acquisitions,
        "refused": view.refused,
        "rig": facts.kind,
        "emulated": facts.emulated,
        "method": view.plan.method,
        "clock_s": view.started_s + view.elapsed_s,
        "angle_deg": view.probe_deg if view.seen_deg is None else view.seen_deg,
        "target_deg": view.asked_deg if view.target_deg is None else view.target_deg,
        "intensity": view.points[-1].intensity if view.points else None,
    }


def _pictured(item: PicturedEntry, *, face_radius_m: float | None) -> list[StreamMessage]:
    """Return the image of an acquisition in ProbeHome, in grey levels; nothing if its place there is unknown."""
    image = item.image
    event = item.entry.event
    if image is None or not isinstance(event, Measured) or face_radius_m is None:
        return []
    pixels = grey_levels(image.envelope, brightest=item.brightest)
    matrix = probe_to_probe_home(event.sample.angle_deg) @ image_to_probe(image.geometry, face_radius_m=face_radius_m)
    return [StreamMessage(device="PA_ProbeHome", content=igtl.Image(pixels=pixels[np.newaxis], matrix=matrix))]


def _transform(angle_deg: float, *, known: bool) -> StreamMessage:
    content = igtl.Transform(matrix=probe_to_probe_home(angle_deg))
    return StreamMessage(device="ProbeToProbeHome", content=content, metadata=_validity(known=known))


def _registration_transform(known: KnownRegistration | None) -> StreamMessage:
    """Return the transform of the camera with its errors; None withdraws what clients have."""
    if known is None:
        return camera_transform(None, errors={})
    return camera_transform(known.davinci_to_trus.matrix, errors=known.errors)


def camera_transform(
    davinci_to_trus: Float64[np.ndarray, "4 4"] | None, *, errors: Mapping[str, float]
) -> StreamMessage:
    """Return the TRANSFORM from the camera to the probe; None: none holds.

    ``davinci_to_trus``: in metres. ``errors``: what stands beside it in the metadata, by name.
    """
    matrix = None
    if davinci_to_trus is not None:
        matrix = davinci_to_trus.copy()
        matrix[:3, 3] *= 1e3
    return StreamMessage(
        device="DaVinciToProbeHome",
        content=igtl.Transform(matrix=matrix),
        metadata=_validity(known=matrix is not None) | {name: f"{value:g}" for name, value in errors.items()},
    )


def _registration_status(view: SessionView, *, withdrawn: bool) -> StreamMessage:
    """Return the STATUS of the registration, which is sent on each change."""
    holds = view.registration is not None
    name = "REGISTERED" if holds else "WITHDRAWN" if withdrawn else "NOT_REGISTERED"
    status = igtl.Status(code=igtl.OK if holds else igtl.NOT_READY, name=name, message=view.sentence)
    return StreamMessage(device="DaVinciRegistration", content=status)


def _marker(point: igtl.Point | None) -> list[StreamMessage]:
    """Return the marker; None withdraws what clients have."""
    place_mm = None if point is None else point.position_mm
    # POINT for people, who see it named; POSITION for controllers, which need no list.
    return [
        StreamMessage(device="PaMarker", content=igtl.Points(points=() if point is None else (point,))),
        StreamMessage(
            device="PaMarkerToProbeHome",
            content=igtl.Position(position_mm=place_mm),
            metadata=_validity(known=point is not None),
        ),
    ]


def _validity(*, known: bool) -> dict[str, str]:
    """Return what PLUS and 3D Slicer call the status of a transform."""
    return {"TransformStatus": "OK" if known else "INVALID"}
