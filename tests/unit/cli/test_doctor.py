"""The doctor's report on a computer that wakes up late."""

from __future__ import annotations

import subprocess
from contextlib import nullcontext
from pathlib import Path

import pytest

from markerseek.cli import doctor
from markerseek.core import ConfigError


@pytest.mark.parametrize(
    ("late_s", "lease_s", "state", "words"),
    [
        (0.07, 0.1, "ok", "of the lease of 0.1 s 10 ms are left"),
        (0.09, 0.1, "broken", "nothing is left: a search on a busy computer would be stopped in the middle"),
        (0.09, 1.0, "ok", "890 ms are left"),
    ],
)
def test_what_is_left_of_the_lease_under_load_is_reported(
    monkeypatch: pytest.MonkeyPatch, late_s: float, lease_s: float, state: str, words: str
) -> None:
    steps = iter([0.015] * 57 + [0.015 + late_s] + [0.0151] * 42)
    monkeypatch.setattr(doctor, "_timed_step", lambda: next(steps))
    monkeypatch.setattr(doctor, "_busy", lambda programs: nullcontext())
    finding = doctor._punctuality(lease_s)
    assert (finding.state, finding.needed) == (state, state == "ok")
    assert words in finding.detail


def test_the_load_runs_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def recorded(command: list[str]) -> subprocess.Popen[bytes]:
        started.append(real(command))
        return started[-1]

    real = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", recorded)
    with doctor._busy(2):
        assert [process.poll() for process in started] == [None, None]
        assert doctor._timed_step() >= doctor._NAP_S + doctor._WORK_S
    assert [process.returncode for process in started] == [-9, -9]


def test_a_package_that_is_not_needed_is_called_optional(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"plot": ("no_such_package", "a picture")})
    finding = doctor._packages()[-1]
    assert (finding.state, finding.needed) == ("absent", False)
    assert finding.detail == "not installed; a picture needs it: pip install 'markerseek[plot]'"
    assert "optional" in doctor._STATES[finding.state, finding.needed]


def test_a_simulated_rig_has_no_lease(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n')
    assert doctor._lease_s(rig) is None
    with pytest.raises(ConfigError, match="check the name"):
        doctor._lease_s(tmp_path / "missing.toml")
