"""The doctor's report on a computer that wakes up late."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.cli import doctor
from markerseek.core import ConfigError


@pytest.mark.parametrize(
    ("late_s", "lease_s", "state", "words"),
    [
        (0.0, 0.1, "ok", "0.1 ms late"),
        (0.033, 0.1, "ok", "33.0 ms"),
        (0.034, 0.1, "broken", "priority"),
        (0.034, 1.0, "ok", "after 1 s"),
    ],
)
def test_a_computer_that_wakes_up_late_is_reported(
    monkeypatch: pytest.MonkeyPatch, late_s: float, lease_s: float, state: str, words: str
) -> None:
    naps = iter([0.01] * 57 + [0.01 + late_s] + [0.0101] * 42)
    monkeypatch.setattr(doctor, "_timed_nap", lambda: next(naps))
    finding = doctor._punctuality(lease_s)
    assert finding.state == state
    assert words in finding.detail
    assert not finding.needed or state == "ok"
    assert next(naps, None) is None


def test_a_nap_is_timed() -> None:
    assert doctor._timed_nap() >= doctor._NAP_S


def test_a_simulated_rig_has_no_lease(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n')
    assert doctor._lease_s(rig) is None
    with pytest.raises(ConfigError, match="check the name"):
        doctor._lease_s(tmp_path / "missing.toml")
