"""A run that follows, as OpenIGTLink clients see it: the transform all the time, and withdrawn when it is silent."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from msgspec import structs

from markerseek.bridges.follow_feed import SILENT_S
from markerseek.bridges.igtl import FollowService
from markerseek.bridges.igtl.follow_service import follow_messages
from markerseek.core import ConfigError
from markerseek.following import FollowStep
from markerseek.wire import igtl
from tests.waiting import wait_until

STEP = FollowStep(
    at_s=1.0,
    word="there",
    said="there",
    probe_deg=1.0,
    target_deg=1.2,
    sigma_deg=0.3,
    within_deg=1.0,
    turning=False,
    davinci_to_trus=[[1.0, 0.0, 0.0, 0.01], [0.0, 1.0, 0.0, -0.02], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]],
    tre_m=0.7e-3,
)


def test_the_transform_is_in_millimetres_with_its_error() -> None:
    transform, state = follow_messages(STEP, simulated=True)
    assert isinstance(transform.content, igtl.Transform)
    assert transform.content.matrix is not None
    assert transform.content.matrix[:3, 3] == pytest.approx([10.0, -20.0, 100.0])
    assert transform.metadata == {"TransformStatus": "OK", "tre_m": "0.0007"}
    assert isinstance(state.content, igtl.Text)
    said = json.loads(state.content.text)
    assert (said["word"], said["holds"], said["simulated"]) == ("there", True, True)


def test_a_run_that_is_silent_is_said_to_be() -> None:
    _, state = follow_messages(None, simulated=False)
    assert isinstance(state.content, igtl.Text)
    said = json.loads(state.content.text)
    assert (said["word"], said["holds"]) == ("silent", False)


@pytest.mark.parametrize("step", [None, structs.replace(STEP, word="tissue", davinci_to_trus=None, tre_m=None)])
def test_a_registration_that_does_not_hold_is_withdrawn(step: FollowStep | None) -> None:
    transform = follow_messages(step, simulated=False)[0]
    assert isinstance(transform.content, igtl.Transform)
    assert transform.content.matrix is None
    assert transform.metadata == {"TransformStatus": "INVALID"}


def received(connection: socket.socket, *, for_s: float) -> Iterator[tuple[float, igtl.Message]]:
    """Transforms that come within so many seconds, with the time."""
    framer = igtl.Framer(most_bytes=100_000)
    ends_s = time.monotonic() + for_s
    connection.settimeout(0.2)
    while (now_s := time.monotonic()) < ends_s:
        try:
            data = connection.recv(65536)
        except TimeoutError:
            continue
        for header, body in framer.feed(data):
            if header.kind == "TRANSFORM":
                yield now_s, igtl.decode(header, body)


def test_it_opens_where_an_event_loop_runs_already_as_in_a_notebook() -> None:
    async def opened() -> int:
        with FollowService("127.0.0.1", 0, simulated=True, on_note=print) as service:
            return service.port

    with ThreadPoolExecutor(1) as alone:
        assert alone.submit(lambda: asyncio.run(opened())).result() > 0


def test_a_port_that_is_taken_is_the_callers_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(ConfigError, match="port"):
        FollowService("127.0.0.1", taken.getsockname()[1], simulated=True, on_note=print)


def test_a_failure_to_send_is_raised_once_and_leaves_no_thread_and_no_port(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_given: object, **_named: object) -> None:
        raise RuntimeError("as this test says")

    monkeypatch.setattr("markerseek.bridges.igtl.follow_service.follow_messages", failing)
    service = FollowService("127.0.0.1", 0, simulated=True, on_note=print)
    wait_until(service._sending.done)
    with pytest.raises(RuntimeError, match="as this test says"):
        service.close()
    service.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", service.port))


@pytest.mark.real_time
def test_clients_get_it_ten_times_a_second_until_the_run_is_silent() -> None:
    notes: list[str] = []
    with FollowService("127.0.0.1", 0, simulated=True, on_note=notes.append) as service:
        service.show(STEP)
        with socket.create_connection(("127.0.0.1", service.port)) as connection:
            came = list(received(connection, for_s=SILENT_S + 1.0))
    valid = [at_s for at_s, message in came if message.metadata["TransformStatus"] == "OK"]
    withdrawn = [message for _, message in came if message.metadata["TransformStatus"] == "INVALID"]
    assert len(valid) >= 3
    assert withdrawn
    last = withdrawn[-1].content
    assert isinstance(last, igtl.Transform)
    assert last.matrix is None or np.isnan(last.matrix).all()
    assert any("connected" in note for note in notes)
