"""One serial port for two devices of a rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

Shell = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize("as_link", [False, True])
def test_one_path_for_two_devices_is_wrong_usage(tmp_path: Path, shell: Shell, as_link: bool) -> None:
    port = tmp_path / "ttyUSB0"
    name = tmp_path / "by-id"
    port.touch()
    name.symlink_to(port)
    rig = tmp_path / "rig.toml"
    rig.write_text(
        f'kind = "bench"\n[stage]\nport = "{port}"\nzero_deg = 0.0\n[laser]\nport = "{name if as_link else port}"\n'
        f'[receiver]\nfolder = "{tmp_path}"\n'
    )
    code, _, said = shell("search", "--rig", rig, "--arm")
    assert code == 2
    said = " ".join(said.split())
    assert "laser and stage have one serial port" in said
    assert "each device has its own" in said
