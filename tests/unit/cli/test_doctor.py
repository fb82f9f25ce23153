"""The doctor's report of a package that is not installed."""

from __future__ import annotations

import pytest

from markerseek.cli import doctor


def test_a_package_that_is_not_needed_is_called_optional(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {"plot": ("no_such_package", "a picture")})
    finding = doctor._packages()[-1]
    assert (finding.state, finding.needed) == ("absent", False)
    assert finding.detail == "not installed; a picture needs it: pip install 'markerseek[plot]'"
    assert "optional" in doctor._STATES[finding.state, finding.needed]
