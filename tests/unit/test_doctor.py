"""What the doctor says of a computer that wakes up late."""

from __future__ import annotations

import pytest

from markerseek.cli import doctor


@pytest.mark.parametrize(
    ("late_s", "state", "words"), [(0.0, "ok", "0.1 ms late"), (0.033, "ok", "33.0 ms"), (0.034, "broken", "priority")]
)
def test_a_computer_that_wakes_up_late_is_told_of(
    monkeypatch: pytest.MonkeyPatch, late_s: float, state: str, words: str
) -> None:
    naps = iter([0.01] * 57 + [0.01 + late_s] + [0.0101] * 42)
    monkeypatch.setattr(doctor, "_timed_nap", lambda: next(naps))
    finding = doctor._punctuality()
    assert finding.state == state
    assert words in finding.detail
    assert not finding.needed or state == "ok"
    assert next(naps, None) is None


def test_a_nap_is_timed() -> None:
    assert doctor._timed_nap() >= doctor._NAP_S
