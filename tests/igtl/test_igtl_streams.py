"""What a search shows on OpenIGTLink, without a network."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from markerseek import rigs
from markerseek.bridges.igtl import Streams
from markerseek.core import BModeFrame, Measured, SearchPlan
from markerseek.records.stream import StreamEvent, StreamHead
from markerseek.runs import configuration_of
from markerseek.sim import ReceiverSettings, SimulatedSettings
from markerseek.wire import igtl


def test_a_b_mode_image_lies_where_its_pixels_are() -> None:
    rig = rigs.simulated(seed=1, settings=SimulatedSettings(receiver=ReceiverSettings(data="b-mode")))
    scanner = rig.scanner
    scanner.guard.arm(by="a test")
    sample = replace(scanner.measure(5.0), angle_deg=5.0)
    frame = sample.frame
    assert isinstance(frame, BModeFrame)
    streams = Streams()
    streams.after(StreamHead(configuration=configuration_of(rig, SearchPlan(method="ternary")), frames=True))
    event = Measured(role="search", index=1, sample=sample)
    sent = {
        each.device: each
        for each in streams.after(
            StreamEvent(number=1, written="", clock_s=0.0, event=event, header=None, lost_lines=0, lost_frames=0)
        )
    }
    data = igtl.encode(igtl.Message(device="BMode_Reference", content=sent["BMode_Reference"].content))
    header = igtl.decode_header(data[: igtl.HEADER_BYTES], most_bytes=len(data))
    image = igtl.decode(header, data[igtl.HEADER_BYTES :]).content
    np.testing.assert_array_equal(image.pixels[0], frame.pixels)
    assert "PA_Reference" not in sent
    row, column = 40, 7
    lateral_m, depth_m = frame.geometry.position_m(row=row, column=column)
    radius_mm = 1e3 * (rig.facts.face_radius_m + depth_m)
    expected = (radius_mm * math.sin(math.radians(5)), 1e3 * lateral_m, radius_mm * math.cos(math.radians(5)))
    assert (image.matrix @ (column, row, 0, 1))[:3] == pytest.approx(expected, abs=1e-3)
