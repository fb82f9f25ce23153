"""Rigs that cannot sweep position-triggered: the command says what is missing and the cure, before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("serial", reason="needs the extra devices")
pytest.importorskip("serial", reason="needs the extra devices")

Shell = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("words", "rig", "said"),
    [
        (
            ("search", "--sweep"),
            '[laser]\nsweep_mode = "position"\n',
            "laser.sweep_mode is 'position', it must be one of: free-running, position-triggered",
        ),
        (
            ("search", "--sweep"),
            '[stage]\nsweep_mode = "position-triggered"\n',
            "the key stage.sweep_mode is unknown; known here: speed_deg_s,",
        ),
        (
            ("search", "--sweep"),
            '[laser]\nsweep_mode = "position-triggered"\n[limits.search]\nlow_deg = -0.2\nhigh_deg = 0.2\n',
            "two triggers are 0.55 deg apart, which leaves none from -0.20 to 0.2 deg; widen the search range, or",
        ),
    ],
)
def test_a_rig_file_that_asks_for_too_much_is_refused_with_the_cure(
    shell: Shell, tmp_path: Path, words: tuple[str, ...], rig: str, said: str
) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(f'kind = "simulated"\n[marker]\nangle_deg = 0.0\n{rig}')
    code, _, err = shell(*words, "--rig", file)
    assert code == 2
    assert said in " ".join(err.split())


def test_a_rig_that_is_turned_by_hand_cannot_sweep(shell: Shell) -> None:
    code, _, err = shell("search", "--sweep", "--arm", "--rig", Path("examples/rigs/guided.toml").absolute())
    assert code == 2
    assert "this rig cannot sweep: its stage (GuidedStage) only works with the probe at rest; leave --sweep out" in (
        " ".join(err.split())
    )
