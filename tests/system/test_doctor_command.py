"""`markerseek doctor`: the installation, packages that are missing, and the sense of rotation of a rig."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from markerseek.cli import doctor
from markerseek.cli.doctor import sense_of
from tests.emulated import ran

EXAMPLES = Path(__file__).parents[2] / "examples"

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
    assert finding.detail.startswith("not installed; a picture needs it: pip install '.[plot]' in the clone")
    assert "optional" in doctor._STATES[finding.state, finding.needed]


@pytest.mark.parametrize("named", [":/opt/lab", "/opt/lab:", "/opt/a::/opt/b", ".", "/opt/a:."])
def test_the_current_folder_in_the_python_path_is_named(monkeypatch: pytest.MonkeyPatch, named: str) -> None:
    monkeypatch.setenv("PYTHONPATH", named)
    (finding,) = (each for each in doctor._packages() if each.what == "PYTHONPATH")
    assert (finding.state, finding.needed) == ("broken", False)
    assert named in finding.detail


@pytest.mark.parametrize("named", ["", "/opt/a:/opt/b", "examples"])
def test_a_python_path_without_one_is_not(monkeypatch: pytest.MonkeyPatch, named: str) -> None:
    monkeypatch.setenv("PYTHONPATH", named)
    assert "PYTHONPATH" not in {each.what for each in doctor._packages()}


FORBID_MACHINE_CODE = "import ctypes\nassert ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) == 0"
"""PR_SET_MDWE: memory that was written cannot become executable, as with systemd's MemoryDenyWriteExecute."""


@pytest.fixture
def forbidden() -> None:
    """A kernel that can forbid machine code; Linux before 6.3 cannot."""
    if subprocess.run([sys.executable, "-c", FORBID_MACHINE_CODE], capture_output=True, check=False).returncode:
        pytest.skip("this system cannot forbid machine code")


@pytest.mark.usefixtures("forbidden")
def test_without_memory_for_machine_code_the_doctor_ends_with_cause_and_cure() -> None:
    done = ran("doctor", "--json", before=FORBID_MACHINE_CODE)
    findings = json.loads(done.stdout)
    assert (done.returncode, findings["ok"]) == (1, False), done.stderr
    broken = [each for each in findings["findings"] if each["state"] == "broken" and each["needed"]]
    assert len(broken) == 2
    for each in broken:
        assert "MemoryDenyWriteExecute=no" in each["detail"]


@pytest.mark.usefixtures("forbidden")
def test_without_memory_for_machine_code_a_recording_is_not_a_defect() -> None:
    done = ran("replay", EXAMPLES / "simulated_scan.csv", before=FORBID_MACHINE_CODE)
    assert (done.returncode, "NUMBA_DISABLE_JIT" in done.stderr) == (1, True), done.stderr


def test_kernels_run_as_python_where_the_user_asks_for_it() -> None:
    program = (
        "import numpy as np\nfrom markerseek.cli.terminal import announce_compilation\n"
        "from markerseek.search.posterior.grid import _tops\nannounce_compilation()\nprint(type(_tops).__name__)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "function\n", done.stderr


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
    assert sense_of(found_deg, source_deg) == verdict


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
