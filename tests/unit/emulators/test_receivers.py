"""The emulated receivers of a bench."""

from __future__ import annotations

import socket
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.emulators import EmulatedBench, EmulatedPlus
from markerseek.sim import SimulatedSettings
from markerseek.wire import igtl


def test_the_emulated_server_sends_version_1_until_its_client_sends_version_2(tmp_path: Path) -> None:
    emulated = EmulatedBench(
        settings=SimulatedSettings(), rng=np.random.default_rng(1), folder=tmp_path, receiver="plus"
    )
    plus = emulated.daq
    assert isinstance(plus, EmulatedPlus)
    versions: list[int] = []
    with socket.create_connection(("127.0.0.1", plus.port)) as client:
        framer = igtl.Framer(most_bytes=1 << 24)

        def hear() -> None:
            plus.advance(0.0)
            versions.extend(header.version for header, _ in framer.feed(client.recv(1 << 24)))

        hear()
        client.sendall(igtl.encode(igtl.Message(device="x", content=igtl.Status(code=igtl.OK), version=1)))
        plus.trigger(1)
        while len(versions) < 2:
            hear()
        client.sendall(igtl.asks_for_metadata())
        plus.trigger(1)
        while len(versions) < 3:
            hear()
    plus.close()
    assert versions == [1, 1, 2]


def test_a_receiver_that_nobody_emulates_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="receiver is 'adq', it must be one of: sonixdaq, plus, vantage"):
        EmulatedBench(settings=SimulatedSettings(), rng=np.random.default_rng(1), folder=tmp_path, receiver="adq")
