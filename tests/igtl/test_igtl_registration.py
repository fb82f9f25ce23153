"""A registration session handed on over OpenIGTLink while it runs: given, given again, withdrawn, and continued."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pyigtl
import pytest

from markerseek.registration import SessionRecord
from markerseek.wire import igtl
from tests.emulated import ran
from tests.igtl.igtl_bridge import bridge, compiled_peer, peer_lines
from tests.igtl.igtl_client import IgtlClient
from tests.registration_sessions import ENDED, begin, kill, matrix_m, registered


def in_mm(markers: int) -> np.ndarray:
    matrix = matrix_m(markers)
    matrix[:3, 3] *= 1e3
    return matrix


def said(message: igtl.Message, name: str) -> bool:
    return message.device == "DaVinciRegistration" and message.content.name == name


def cameras(messages: list[igtl.Message]) -> list[igtl.Message]:
    return [each for each in messages if each.device == "DaVinciToProbeHome"]


def test_a_session_is_handed_on_marker_by_marker_and_withdrawn(tmp_path: Path) -> None:
    record = begin(tmp_path / "session", markers=2)
    with bridge("--registration", str(tmp_path / "session")) as running, IgtlClient(running.port) as client:
        before = client.until(lambda message: said(message, "NOT_REGISTERED"))
        record.add(registered(3))
        first = client.until(lambda message: said(message, "REGISTERED"))
        assert cameras(before) == []
        (camera,) = cameras(first)
        assert camera.content.matrix == pytest.approx(in_mm(3), rel=1e-5, abs=1e-5)
        assert camera.metadata["registration"] == "simulated"
        report = registered(3).report
        for name in ("fre_m", "tre_m", "tre95_m"):
            assert float(camera.metadata[name]) == pytest.approx(getattr(report, name), rel=1e-5)
        assert (camera.metadata["markers"], camera.metadata["TransformStatus"]) == ("3", "OK")
        # Killed within a line, and continued: nothing is sent that was sent already.
        kill(record)
        stopped = client.until(lambda message: said(message, "REGISTERED"))
        assert "continue it" in stopped[-1].content.message
        record = SessionRecord.reopen(tmp_path / "session")
        resumed = client.until(lambda message: said(message, "REGISTERED"))
        assert cameras(stopped + resumed) == []
        record.add(registered(4))
        second = client.until(lambda message: said(message, "REGISTERED"))
        assert cameras(second)[0].content.matrix == pytest.approx(in_mm(4), rel=1e-5, abs=1e-5)
        record.add(registered(5, decided=False))
        withdrawn = client.until(lambda message: said(message, "WITHDRAWN"))
        assert withdrawn[-1].content.code == igtl.NOT_READY
        (camera,) = cameras(withdrawn)
        assert camera.content.matrix is None
        assert camera.metadata["TransformStatus"] == "INVALID"
        assert "tre_m" not in camera.metadata
        state = client.until(lambda message: message.device == "SearchState")[-1]
        known = json.loads(state.content.text)["registration"]
        assert (known["decided"], known["session"], known["said"]) == (False, "running", "not certain after 5")
        # Who comes now gets no transform either.
        late = pyigtl.OpenIGTLinkClient("127.0.0.1", running.port)
        assert np.isnan(late.wait_for_message("DaVinciToProbeHome", timeout=60).matrix[:3]).all()
        record.add(registered(5))
        record.add(ENDED)
        record.close()
        again = client.until(lambda message: said(message, "REGISTERED") and message.content.message == "over")
        assert cameras(again)[-1].content.matrix == pytest.approx(in_mm(5), rel=1e-5, abs=1e-5)
        received = late.wait_for_message("DaVinciToProbeHome", timeout=60)
        while np.isnan(received.matrix).any():
            received = late.wait_for_message("DaVinciToProbeHome", timeout=60)
        late.stop()
        assert received.matrix == pytest.approx(in_mm(5), rel=1e-5, abs=1e-5)
        assert running.stop(signal.SIGINT) == 130


def test_a_client_of_header_version_1_cannot_take_a_withdrawn_transform_for_a_place(tmp_path: Path) -> None:
    record = begin(tmp_path / "session", markers=3)
    program = compiled_peer(tmp_path)
    lines: list[str] = []
    with (
        bridge("--header-version", "1", "--registration", str(tmp_path / "session")) as running,
        peer_lines(program, running.port) as (_, printed),
    ):
        for line in printed:
            lines.append(line)
            if line.startswith("STATUS DaVinciRegistration 1 REGISTERED"):
                record.add(registered(4, decided=False))
            if line.startswith("STATUS DaVinciRegistration 13 WITHDRAWN"):
                break
    record.close()
    given, withdrawn = (line.split()[2:] for line in lines if line.startswith("TRANSFORM DaVinciToProbeHome"))
    assert np.array(given, dtype=float).reshape(3, 4) == pytest.approx(in_mm(3)[:3], rel=1e-4, abs=1e-4)
    assert np.isnan(np.array(withdrawn, dtype=float)).all()


def test_a_folder_without_a_session_ends_with_exit_code_2_and_the_cure(tmp_path: Path) -> None:
    ended = ran("igtl", "--port", 0, "--registration", tmp_path, timeout=120)
    assert ended.returncode == 2
    assert "no session has begun; name the folder of a session" in " ".join(ended.stderr.split())
