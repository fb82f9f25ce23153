"""The configuration for PLUS names what the bridge sends."""

from __future__ import annotations

from inspect import signature
from pathlib import Path
from xml.etree import ElementTree as ET

from markerseek import rigs
from markerseek.bridges.igtl import Streams
from markerseek.cli import igtl
from markerseek.core import Interval, SearchPlan, Started
from markerseek.records.journal import Entry
from markerseek.runs import configuration_of

FILE = Path(__file__).parents[2] / "examples" / "plus" / "PlusDeviceSet_Server_markerseek.xml"


def test_plus_looks_for_the_transform_that_the_bridge_sends_where_it_sends_it() -> None:
    device = ET.parse(FILE).find("DataCollection/Device")
    tool = device.find("DataSources/DataSource").get("Id")
    streams = Streams()
    streams.started()
    streams.after(configuration_of(rigs.simulated(seed=1), SearchPlan(method="ternary")))
    event = Started(start_deg=1.0, limits=Interval(low_deg=-10, high_deg=10))
    item = Entry(number=1, written="2026-01-01T00:00:00+00:00", clock_s=0.0, event=event)
    sent = streams.after(item)
    names = [stream.device for stream in sent if stream.content.kind == device.get("MessageType")]
    # PLUS names a transform "<tool>To<reference>".
    assert names == [f"{tool}To{device.get('ToolReferenceFrame')}"]
    port = signature(igtl.command).parameters["port"].default
    assert int(device.get("ServerPort")) == port
    assert device.get("IgtlMessageCrcCheckEnabled") == "true"
    # PLUS repeats the last angle with its own time, and drops what comes with an older one, as of an acquisition.
    assert device.get("UseLastTransformsOnReceiveTimeout") == "true"
    assert device.get("UseReceivedTimestamps") == "false"
    server = ET.parse(FILE).find("PlusOpenIGTLinkServer")
    assert int(server.get("ListeningPort")) != port
