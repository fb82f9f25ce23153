"""A probe whose angle comes from an OpenIGTLink server: what it says of its validity."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import DeviceTimeoutError, NotConnectedError
from markerseek.rigs import read_rig_file
from markerseek.rigs.bench_rig import bench
from tests.unit.drivers.openigtlink_server import ImpoliteServer


def hand_rig(folder: Path, port: int, *, more: str = "") -> Path:
    """Rig file of a probe that a person turns, whose angle comes from a server; laser and receiver are simulated."""
    path = folder / "hand.toml"
    path.write_text(
        f'kind = "bench"\n[stage]\ndriver = "guided"\nencoder = "openigtlink"\nport = {port}\nconnect_s = 1.0\n{more}\n'
        '[laser]\ndriver = "simulated"\n[receiver]\ndriver = "simulated"\n'
    )
    return path


@pytest.mark.real_time
def test_a_server_is_asked_for_version_2_and_its_invalid_ends_the_angle(tmp_path: Path) -> None:
    with ImpoliteServer() as server, bench(read_rig_file(hand_rig(tmp_path, server.port))) as rig:
        assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)
        assert server.version == 2
        # The tracker sees nothing any more: the server repeats its last matrix, with times of now.
        server.status = "INVALID"
        server.sent.wait(1.0)
        with pytest.raises(DeviceTimeoutError, match="it says that its transform is 'INVALID'"):
            rig.stage.angle_deg  # noqa: B018  reading it asks the encoder
        server.status = "OK"
        assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("highest", "status", "said"),
    [
        (1, "OK", r"does not state by TransformStatus.*came in header version 1; version 2 was asked for: use a newer"),
        (
            2,
            None,
            r"does not state by TransformStatus in its metadata that it is valid; let the server send it, as PLUS does",
        ),
        (2, "OUT_OF_VIEW", r"it says that its transform is 'OUT_OF_VIEW'"),
    ],
)
def test_a_transform_without_a_status_is_not_believed(
    tmp_path: Path, highest: int, status: str | None, said: str
) -> None:
    with ImpoliteServer(highest=highest, status=status) as server:
        path = hand_rig(tmp_path, server.port)
        with pytest.raises(NotConnectedError, match=said), bench(read_rig_file(path)):
            pass
        if status == "OUT_OF_VIEW":
            return
        # A person may take the word of a server that never states it.
        with bench(read_rig_file(hand_rig(tmp_path, server.port, more="require_status = false"))) as rig:
            assert rig.stage.angle_deg == pytest.approx(server.angle_deg, abs=1e-4)
