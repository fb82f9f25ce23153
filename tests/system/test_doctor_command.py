"""`markerseek doctor`: the installation, packages that are missing, and the sense of rotation of a rig."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from markerseek.cli import doctor
from markerseek.cli.doctor import verdict_of

Shell = Callable[..., tuple[int, str, str]]


def test_the_doctor_passes(shell: Shell) -> None:
    code, out, _ = shell("doctor", "--json")
    findings = json.loads(out)
    assert (code, findings["ok"]) == (0, True)
    searched = [finding["what"] for finding in findings["findings"] if finding["what"].startswith("simulated search")]
    assert searched == ["simulated search, weighted-average", "simulated search, posterior"]


def test_a_package_that_is_not_needed_is_called_optional(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"plot": ("no_such_package", "a picture")})
    finding = doctor._packages()[-1]
    assert (finding.state, finding.needed) == ("absent", False)
    assert finding.detail == "not installed; a picture needs it: pip install 'markerseek[plot]'"
    assert "optional" in doctor._STATES[finding.state, finding.needed]


@pytest.mark.parametrize(
    ("source_deg", "code", "said"),
    [
        (-14, 0, "the stage turns the right way"),
        (14, 1, "the mirrored angle: the stage turns the other way round; change stage.direction"),
    ],
)
def test_a_source_at_the_mirrored_angle_is_named_by_the_command(
    shell: Shell, tmp_path: Path, source_deg: int, code: int, said: str
) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n[marker]\nangle_deg = -14.0\n')
    ended, out, _ = shell("doctor", "--rig", rig, "--source-deg", source_deg, "--json")
    assert (ended, said in json.loads(out)["findings"][-1]["detail"]) == (code, True), out


@pytest.mark.parametrize(
    ("answer", "angle_deg", "said"),
    [
        ("ambiguous", 13.1, "13.10 deg, the mirrored angle of -14 deg: the stage seems to turn the other way round"),
        ("unsure", -13.1, "place one point source, and no other"),
        ("not found", 14.0, "place one point source, and no other"),
    ],
)
def test_a_mirror_is_named_where_the_source_is_not_found_for_certain(answer: str, angle_deg: float, said: str) -> None:
    result = SimpleNamespace(answer=answer, angle_deg=angle_deg, reason="a test")
    assert said in doctor._not_found(result, -14.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("found_deg", "source_deg", "verdict"),
    [(-12.4, -12, "right"), (-11.0, 12, "mirrored"), (3.0, 12, "neither"), (0.0, 5, "neither")],
)
def test_the_verdict(found_deg: float, source_deg: float, verdict: str) -> None:
    assert verdict_of(found_deg, source_deg) == verdict


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--source-deg", "3"), "at least 5 deg off 0"),
        (("--source-deg", "40"), "lies outside limits.search"),
        (("--arm",), "without --source-deg nothing moves"),
    ],
)
def test_what_proves_nothing_is_refused(shell: Shell, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n')
    code, _, err = shell("doctor", "--rig", rig, *words)
    assert (code, said in err) == (2, True), err


def test_a_source_needs_a_rig_and_an_angle_before_anything_is_searched(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "_search", lambda _: pytest.fail("it was searched"))
    (tmp_path / "rig.toml").write_text('kind = "simulated"\n')
    code, _, err = shell("doctor", "--source-deg", "12")
    assert (code, "name one with --rig" in err) == (2, True)


def test_a_light_meter_says_what_a_usual_pulse_is(monkeypatch: pytest.MonkeyPatch) -> None:
    meter = SimpleNamespace(usual=19_876.0)
    monkeypatch.setattr(doctor.drivers, "EnergyMeter", SimpleNamespace)
    said = doctor._usual_energy(SimpleNamespace(receiver=meter))
    assert said == ", and its meter says 19880 of a usual pulse (laser.usual_energy)"
