"""Records of registration sessions as a session writes them, with markers of one known transform."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from markerseek.registration import (
    Begun,
    Ended,
    MovedMarker,
    PointPair,
    Registered,
    SessionRecord,
    Spot,
    StereoSettings,
    TakenMarker,
    Waiting,
    register_pairs,
)
from markerseek.sim import endoscope

CAMERA_M = np.array([[0.0, 0.0, 0.1], [0.02, 0.0, 0.11], [0.0, 0.03, 0.1], [0.02, 0.03, 0.13], [0.01, 0.02, 0.12]])
ROTATION = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
TRANSLATION_M = np.array([0.01, -0.02, 0.05])
# Residuals, so that each marker more gives another transform.
TRUS_M = (
    CAMERA_M @ ROTATION.T + TRANSLATION_M + 1e-4 * np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0] * 3])
)


def stereo() -> StereoSettings:
    """A calibration with which marks are drawn."""
    return StereoSettings.of(endoscope(), calibration_sigma_px=0.2)


BEGUN = Begun(
    rig="r",
    description="a rig",
    simulated=True,
    images="images",
    cameras="{}",
    size_px=(64, 48),
    goal_m=5e-4,
    target_trus_m=None,
    begun="2026-01-01T00:00:00+00:00",
)


def registered(markers: int, *, decided: bool = True) -> Registered:
    """What a session says after a number of markers."""
    report = None
    if markers >= 3:
        pairs = [
            PointPair(name=str(number), trus_m=TRUS_M[number], camera_m=CAMERA_M[number]) for number in range(markers)
        ]
        report = register_pairs(pairs)
    decided = decided and report is not None
    return Registered(
        report=report,
        decided=decided,
        chosen={},
        left_out=(),
        open=() if decided else ("1",),
        reason=None if decided else "marker 1 may be another source",
        place=None,
        done=False,
        said=f"registered by {markers}" if decided else f"not certain after {markers}",
    )


def taken(name: str, **changes: Any) -> TakenMarker:
    """A marker that was not found, but for the changes."""
    marker = TakenMarker(
        name=name,
        spot=Spot(left_px=(1.0, 2.0), right_px=(1.0, 2.0), sigma_px=0.1),
        camera_m=[0.0, 0.0, 0.1],
        camera_covariance_m2=[[0.0] * 3] * 3,
        camera_shared_m=[[0.0]] * 3,
        answer="not found",
        reason=None,
        candidates=[],
        acquisitions=5,
        rig_s=1.0,
        prior=None,
        journal=None,
        at="2026-01-01T00:00:00+00:00",
    )
    return structs.replace(marker, **changes)


def matrix_m(markers: int) -> np.ndarray:
    """The transform that a session hands on after a number of markers."""
    return np.array(registered(markers).report.davinci_to_trus)


WAITING = Waiting(name="2", place=None, said="light a spot")
MOVED = MovedMarker(name="1", moved_m=2e-3, sigma_m=1e-4, moved=True, said="marker 1 has moved")
ENDED = Ended(registered=True, said="over", rig_s=1.0)


def begin(folder: Path, *, markers: int = 0) -> SessionRecord:
    """A session that runs, after a number of markers."""
    record = SessionRecord.create(folder, BEGUN)
    for number in range(1, markers + 1):
        record.add(registered(number))
    return record


def kill(record: SessionRecord) -> None:
    """End the writer within a line, as a process that is killed does."""
    record.close()
    with (record.folder / "session.jsonl").open("ab") as file:
        file.write(b"0123abcd {")
