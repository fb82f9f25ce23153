"""What a search shows on OpenIGTLink, without a network, and what the configuration for PLUS makes of it."""

from __future__ import annotations

import math
from datetime import datetime
from inspect import signature
from pathlib import Path
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.bridges import Outcome
from markerseek.bridges.igtl import StreamMessage, Streams
from markerseek.cli.igtl import command as igtl_command
from markerseek.core import (
    PAPER_RANGE,
    Asked,
    ChannelFrame,
    Measured,
    Sample,
    ScanGeometry,
    SearchPlan,
    Started,
    Sweep,
    SweepTiming,
    Swept,
    Turning,
)
from markerseek.runs import configuration_of
from markerseek.wire import igtl
from tests.pictured import WRITTEN, pictured_entry


def sent_at_5_degrees() -> tuple[rigs.Rig, Sample, dict[str, igtl.Image]]:
    """Rig, acquisition, and its image as a client reads it."""
    rig = rigs.simulated(seed=1)
    scanner = rig.scanner
    scanner.guard.arm(by="a test")
    sample = structs.replace(scanner.measure(5.0), angle_deg=5.0)
    streams = Streams()
    configuration = configuration_of(rig, SearchPlan(method="ternary"))
    streams.after(configuration)
    event = Measured(role="search", index=1, sample=sample)
    images = {}
    for each in streams.after(pictured_entry(configuration, event)):
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


def test_the_image_of_a_frame_lies_where_its_pixels_are() -> None:
    rig, sample, images = sent_at_5_degrees()
    assert isinstance(sample.frame, ChannelFrame)
    assert rig.imaging is not None
    assert set(images) == {"PA_ProbeHome"}
    require_place(rig, images["PA_ProbeHome"], rig.imaging.picture(sample.frame).geometry, row=300, column=90)


def by_device(streams: list[StreamMessage]) -> dict[str, StreamMessage]:
    return {each.device: each for each in streams}


def ended(answer: str, *, exit_code: int = 3, **known: object) -> list[StreamMessage]:
    streams = Streams()
    streams.started()
    return streams.ended(Outcome.of(exit_code, msgspec.json.encode({"answer": answer, "angle_deg": 1.0, **known})))


@pytest.mark.parametrize(
    ("answer", "name"),
    [
        ("found", "FOUND"),
        ("not found", "NOT_FOUND"),
        ("unsure", "UNSURE"),
        ("ambiguous", "AMBIGUOUS"),
        ("at bound", "AT_BOUND"),
    ],
)
def test_the_status_says_the_answer(answer: str, name: str) -> None:
    status = by_device(ended(answer, exit_code=0 if answer == "found" else 3))["PaSearch"].content
    assert (status.code, status.name) == (igtl.OK, name)


def test_a_published_form_claims_no_marker() -> None:
    sent = by_device(ended("found", exit_code=0, found=True, as_published=True, marker_trus_m=[0.001, 0.002, 0.003]))
    assert sent["PaSearch"].content.name == "NO_CLAIM"
    assert set(sent) == {"PaSearch", "SearchState"}


def test_a_place_that_is_known_roughly_is_no_marker() -> None:
    sent = by_device(ended("unsure", found=False, marker_trus_m=[0.001, 0.002, 0.003]))
    assert set(sent) == {"PaSearch", "SearchState"}


def test_a_command_that_ends_without_its_answer_is_a_fault() -> None:
    streams = Streams()
    streams.started()
    assert by_device(streams.ended(Outcome(exit_code=0)))["PaSearch"].content.name == "FAULT"


def test_the_marker_of_the_search_before_is_withdrawn_when_the_next_begins() -> None:
    streams = Streams()
    for sent in (by_device(streams.idle()), by_device(streams.started())):
        assert sent["PaMarker"].content == igtl.Points(points=())
        assert sent["PaMarkerToProbeHome"].content == igtl.Position(position_mm=None)
        assert sent["PaMarkerToProbeHome"].metadata == {"TransformStatus": "INVALID"}
    sent = by_device(ended("found", exit_code=0, found=True, marker_trus_m=[0.001, 0.002, 0.003]))
    assert sent["PaMarker"].content.points[0].position_mm == (1, 2, 3)
    assert sent["PaMarkerToProbeHome"].content.position_mm == (1, 2, 3)
    assert sent["PaMarkerToProbeHome"].metadata == {"TransformStatus": "OK"}


def test_a_probe_that_a_person_turns_is_shown_on_its_way() -> None:
    streams = Streams()
    rig = rigs.simulated(seed=1)
    configuration = configuration_of(rig, SearchPlan(method="ternary"))
    streams.after(configuration)
    begun = Started(start_deg=2.0, limits=PAPER_RANGE)
    streams.after(pictured_entry(configuration, begun))
    # The last read-back angle is said again if a person will type the angle in, and no transform is sent.
    for reads_deg, said_deg in ((30.0, 30.0), (None, 2.0)):
        event = Turning(target_deg=-12.0, angle_deg=reads_deg)
        sent = by_device(streams.after(pictured_entry(configuration, event, number=2)))
        state = msgspec.json.decode(sent["SearchState"].content.text)
        assert (state["target_deg"], state["angle_deg"]) == (-12.0, said_deg)
        assert ("ProbeToProbeHome" in sent) == (reads_deg is not None)
        if reads_deg is not None:
            assert sent["ProbeToProbeHome"].content.matrix[0, 2] == pytest.approx(0.5)


def test_a_transform_before_the_first_search_says_that_no_angle_is_known() -> None:
    sent = by_device(Streams().idle())["ProbeToProbeHome"]
    assert sent.content.matrix.tolist() == np.eye(4).tolist()
    assert sent.metadata == {"TransformStatus": "INVALID"}


@pytest.mark.parametrize(
    ("kind", "written", "expected_s"),
    [
        # 2.5 s from the first pulse to the commit.
        ("bench", "2026-11-23T10:00:20.250000+00:00", datetime.fromisoformat("2026-11-23T10:00:17.75Z").timestamp()),
        (
            "simulated",
            "2026-11-23T10:00:20.250000+00:00",
            datetime.fromisoformat("2026-11-23T10:00:20.25Z").timestamp(),
        ),
    ],
)
def test_image_and_transform_carry_one_time_that_of_the_acquisition(kind: str, written: str, expected_s: float) -> None:
    rig = rigs.simulated(seed=1)
    rig.scanner.guard.arm(by="a test")
    sample = structs.replace(rig.scanner.measure(5.0), angle_deg=5.0)
    configuration = configuration_of(rig, SearchPlan(method="ternary"))
    configuration = structs.replace(configuration, facts=structs.replace(configuration.facts, kind=kind))
    streams = Streams()
    streams.after(configuration)
    event = Measured(role="search", index=1, sample=sample)
    fired_s = sample.frame.header.started_s
    sent = streams.after(pictured_entry(configuration, event, written=written, clock_s=fired_s + 2.5))
    assert [each.device for each in sent] == ["ProbeToProbeHome", "PA_ProbeHome", "SearchState"]
    assert [each.time_s for each in sent] == [expected_s] * 3
    assert sent[0].metadata == {"TransformStatus": "OK"}


def test_each_frame_of_a_sweep_has_its_own_angle_and_time() -> None:
    rig = rigs.simulated(seed=1)
    sample = rig.scanner.measure(5.0)
    assert sample.frame is not None
    configuration = configuration_of(rig, SearchPlan(method="posterior", sweep_speed_deg_s=8.6))
    configuration = structs.replace(configuration, facts=structs.replace(configuration.facts, kind="bench"))
    streams = Streams()
    streams.after(configuration)
    asked = Asked(role="search", index=1, angle_deg=35.0, sweep=Sweep(to_deg=35.0, speed_deg_s=8.6))
    streams.after(pictured_entry(configuration, asked))
    began_s = datetime.fromisoformat(WRITTEN).timestamp()
    for index, (angle_deg, fired_s) in enumerate([(5.0, 99.75), (5.4, 99.8)], start=1):
        frame = structs.replace(sample.frame, header=structs.replace(sample.frame.header, started_s=fired_s))
        pulse = structs.replace(sample, angle_deg=angle_deg, frame=frame, sweep=SweepTiming(number=1, speed_deg_s=8.6))
        event = Measured(role="search", index=index, sample=pulse)
        sent = by_device(streams.after(pictured_entry(configuration, event, number=index + 1, clock_s=100.0)))
        (time_s,) = {each.time_s for each in sent.values()}
        assert time_s == pytest.approx(began_s - (100.0 - fired_s))
        turned = sent["ProbeToProbeHome"].content
        assert isinstance(turned, igtl.Transform)
        assert math.degrees(math.atan2(turned.matrix[0, 2], turned.matrix[2, 2])) == pytest.approx(angle_deg)
        assert isinstance(sent["PA_ProbeHome"].content, igtl.Image)
    swept = Swept(angle_deg=6.0, pulses=2)
    ended = by_device(streams.after(pictured_entry(configuration, swept, number=4, clock_s=100.5)))
    assert set(ended) == {"ProbeToProbeHome", "SearchState"}


PLUS = Path(__file__).parents[2] / "examples" / "plus" / "PlusDeviceSet_Server_markerseek.xml"


def test_plus_looks_for_the_transform_that_the_bridge_sends_where_it_sends_it() -> None:
    device = ET.parse(PLUS).find("DataCollection/Device")
    tool = device.find("DataSources/DataSource").get("Id")
    streams = Streams()
    streams.started()
    configuration = configuration_of(rigs.simulated(seed=1), SearchPlan(method="ternary"))
    streams.after(configuration)
    sent = streams.after(pictured_entry(configuration, Started(start_deg=1.0, limits=PAPER_RANGE)))
    names = [stream.device for stream in sent if stream.content.kind == device.get("MessageType")]
    # PLUS names a transform "<tool>To<reference>".
    assert names == [f"{tool}To{device.get('ToolReferenceFrame')}"]
    port = signature(igtl_command).parameters["port"].default
    assert int(device.get("ServerPort")) == port
    assert device.get("IgtlMessageCrcCheckEnabled") == "true"
    # PLUS repeats the last angle with its own time, and drops what comes with an older one, as of an acquisition.
    assert device.get("UseLastTransformsOnReceiveTimeout") == "true"
    assert device.get("UseReceivedTimestamps") == "false"
    server = ET.parse(PLUS).find("PlusOpenIGTLinkServer")
    assert int(server.get("ListeningPort")) != port
