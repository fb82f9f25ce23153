"""What a search shows on OpenIGTLink, without a network."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from markerseek import rigs
from markerseek.bridges.igtl import Streams
from markerseek.core import BModeFrame, ChannelFrame, Measured, RFFrame, Sample, ScanGeometry, SearchPlan
from markerseek.records.stream import StreamEvent, StreamHead
from markerseek.runs import configuration_of
from markerseek.sim import ReceiverSettings, SimulatedSettings
from markerseek.wire import igtl


def sent_at_5_degrees(receiver: ReceiverSettings) -> tuple[rigs.Rig, Sample, dict[str, igtl.Image]]:
    """Rig, acquisition, and its images as a client reads them."""
    rig = rigs.simulated(seed=1, settings=SimulatedSettings(receiver=receiver))
    scanner = rig.scanner
    scanner.guard.arm(by="a test")
    sample = replace(scanner.measure(5.0), angle_deg=5.0)
    streams = Streams()
    streams.after(StreamHead(configuration=configuration_of(rig, SearchPlan(method="ternary")), frames=True))
    event = Measured(role="search", index=1, sample=sample)
    images = {}
    for each in streams.after(
        StreamEvent(number=1, written="", clock_s=0.0, event=event, header=None, lost_lines=0, lost_frames=0)
    ):
        if isinstance(each.content, igtl.Image):
            data = igtl.encode(igtl.Message(device=each.device, content=each.content))
            header = igtl.decode_header(data[: igtl.HEADER_BYTES], most_bytes=len(data))
            images[each.device] = igtl.decode(header, data[igtl.HEADER_BYTES :]).content
    return rig, sample, images


def require_place(rig: rigs.Rig, image: igtl.Image, geometry: ScanGeometry, *, row: int, column: int) -> None:
    lateral_m, depth_m = geometry.position_m(row=row, column=column)
    radius_mm = 1e3 * (rig.facts.face_radius_m + depth_m)
    expected = (radius_mm * math.sin(math.radians(5)), 1e3 * lateral_m, radius_mm * math.cos(math.radians(5)))
    assert (image.matrix @ (column, row, 0, 1))[:3] == pytest.approx(expected, abs=1e-3)


def test_a_b_mode_image_lies_where_its_pixels_are() -> None:
    rig, sample, images = sent_at_5_degrees(ReceiverSettings(data="b-mode"))
    assert isinstance(sample.frame, BModeFrame)
    assert set(images) == {"BMode_Reference"}
    np.testing.assert_array_equal(images["BMode_Reference"].pixels[0], sample.frame.pixels)
    require_place(rig, images["BMode_Reference"], sample.frame.geometry, row=40, column=7)


@pytest.mark.parametrize("data", ["channels", "rf"])
def test_both_images_of_a_frame_lie_where_their_pixels_are(data: Literal["channels", "rf"]) -> None:
    rig, sample, images = sent_at_5_degrees(ReceiverSettings(data=data, b_mode=True))
    assert isinstance(sample.frame, ChannelFrame | RFFrame)
    assert sample.frame.b_mode is not None
    assert rig.imaging is not None
    assert set(images) == {"PA_Reference", "BMode_Reference"}
    np.testing.assert_array_equal(images["BMode_Reference"].pixels[0], sample.frame.b_mode.pixels)
    require_place(rig, images["BMode_Reference"], sample.frame.b_mode.geometry, row=40, column=7)
    require_place(rig, images["PA_Reference"], rig.imaging.picture(sample.frame).geometry, row=300, column=90)
