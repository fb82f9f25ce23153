"""Faults of a simulated receiver, one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from markerseek.core import Frame, FrameHeader, Permit, ReadingFrame
from tests.faults.campaign.receiver_faults import RECEIVER_FAULTS, FaultyReceiver

PERMIT = Permit(token="t", angle_deg=0.0, pulses=16, expires_s=math.inf)
HEADER = FrameHeader(sequence=1, token="t", pulses=16, commanded_deg=0.0, started_s=0.0, ended_s=0.1)


class Counting:
    """A receiver whose intensities are 1, 2, 3 and so on."""

    def __init__(self) -> None:
        self.armed = 0
        self.frames = 0

    def arm(self, permit: Permit) -> None:
        self.armed += 1

    def acquire(self, permit: Permit) -> Frame:
        self.frames += 1
        return ReadingFrame(header=HEADER, intensity=float(self.frames))


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("dead", {}, [0.0, 0.0, 0.0, 0.0]),
        ("NaN", {}, [math.nan] * 4),
        ("NaN", {"from_step": 2, "to_step": 3}, [1.0, math.nan, 3.0, 4.0]),
        ("late frames", {}, [1.0, 1.0, 2.0, 3.0]),
        ("clipped", {"amount": 2.5}, [1.0, 2.0, 2.5, 2.5]),
    ],
)
def test_each_fault_changes_the_frames_of_its_steps(
    name: str, changes: dict[str, float], expected: list[float]
) -> None:
    inner = Counting()
    receiver = FaultyReceiver(inner, replace(RECEIVER_FAULTS[name], **changes))  # type: ignore[arg-type]
    intensities = []
    for _ in expected:
        receiver.arm(PERMIT)
        frame = receiver.acquire(PERMIT)
        assert isinstance(frame, ReadingFrame)
        intensities.append(frame.intensity)
    assert intensities == pytest.approx(expected, nan_ok=True)
    assert inner.armed == len(expected)
