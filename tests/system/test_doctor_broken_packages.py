"""`doctor` where packages cannot be imported."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from markerseek.cli import doctor
from tests.broken_packages import BROKEN, break_package

Shell = Callable[..., tuple[int, str, str]]


def test_doctor_shows_what_is_broken_with_its_cause_and_goes_on(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {each: doctor.EXTRAS[each] for each in ("vision", "igtl", "records")})
    break_package(monkeypatch, "cv2", BROKEN["a library of the system"])
    break_package(monkeypatch, "pyigtl", ValueError("numpy.dtype size changed, may indicate binary incompatibility"))
    code, out, _ = shell("doctor", "--json")
    findings = {each["what"]: each for each in json.loads(out)["findings"]}
    assert (code, findings["cv2"]["state"], findings["pyigtl"]["state"]) == (0, "broken", "broken")
    assert "libGL.so.1: cannot open shared object file" in findings["cv2"]["detail"]
    assert "numpy.dtype size changed" in findings["pyigtl"]["detail"]
    assert (findings["h5py"]["state"], findings["simulated search, posterior"]["state"]) == ("ok", "ok")
