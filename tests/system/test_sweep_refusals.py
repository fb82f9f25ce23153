"""Rigs that cannot sweep: the command says why, before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("serial", reason="needs the extra devices")

Shell = Callable[..., tuple[int, str, str]]


def test_a_rig_that_is_turned_by_hand_cannot_sweep(shell: Shell) -> None:
    code, _, err = shell("search", "--sweep", "--arm", "--rig", Path("examples/rigs/guided.toml").absolute())
    assert code == 2
    assert "this rig cannot sweep: its stage (GuidedStage) only works with the probe at rest; leave --sweep out" in (
        " ".join(err.split())
    )
