"""A client's StartSearch is armed by what is typed after the question, which names the client."""

from __future__ import annotations

import os
import re

import pytest

from markerseek.wire import igtl
from tests.emulated import emulation
from tests.igtl.igtl_bridge import on_terminal
from tests.igtl.igtl_client import IgtlClient

pytestmark = pytest.mark.real_time


def test_keys_typed_before_a_client_asks_arm_nothing_and_the_question_names_it(tmp_path) -> None:
    far, near = os.openpty()
    with emulation(tmp_path) as devices:
        os.write(far, b"y\nrig.toml\n")
        process = on_terminal(devices.rig, near)
        assert process.stderr is not None
        said = b""
        while (found := re.search(rb"connect to 127\.0\.0\.1, port (\d+)", said)) is None:
            said += os.read(process.stderr.fileno(), 4096)
        with IgtlClient(int(found[1])) as client:
            address = client.socket.getsockname()
            assert "SUCCESS" in client.ask('<Command Name="StartSearch" />')
            while b"name of the rig: " not in said:
                said += os.read(process.stderr.fileno(), 4096)
            assert f"asked by: an OpenIGTLink client, {address[0]}:{address[1]}\n" in said.decode()
            os.write(far, b"y\n")
            client.until(lambda message: isinstance(message.content, igtl.Text) and "not armed" in message.content.text)
        process.terminate()
        process.communicate(timeout=60)
        assert devices.end() == (0.0, 0.0, 0)
    os.close(far)
    os.close(near)
