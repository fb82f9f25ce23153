"""Short restart campaign: frames of a search that died never make the next search find a wrong angle.

``python -m tests.faults.campaign --runs 0 --frames 0 --restarts 200`` is the long form.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("serial", reason="needs the extra devices")

from tests.faults.campaign.restart_counts import (  # type: ignore[import-not-found, unused-ignore]
    BURSTS,
    DAQS,
    lines,
    restarts,
)
from tests.faults.campaign.restarts import DEATHS  # type: ignore[import-not-found, unused-ignore]
from tests.faults.unchecked import unchecked  # type: ignore[import-not-found, unused-ignore]


@pytest.mark.long
@pytest.mark.parametrize("death", DEATHS)
@pytest.mark.parametrize("daq", DAQS)
def test_no_wrong_angle_is_found_after_a_restart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], daq: str, death: str
) -> None:
    counts = unchecked(restarts, daq, death, seed=2, count=1, folder=tmp_path)
    with capsys.disabled():
        sys.stdout.write("\n" + lines({f"{daq}, {death}": counts})[-1] + "\n")
    assert counts.runs == 1
    assert counts.off == 0
    if "loses power" not in daq:  # a small share of light in the dark frames is lost in the noise
        assert counts.accepted == 0
        assert "fault" not in counts.answers  # the search continues


@pytest.mark.long
def test_without_decision_20_frames_of_other_triggers_are_accepted(tmp_path: Path) -> None:
    """The judge can see it: else it would prove nothing."""
    counts = unchecked(restarts, "late files", "Ctrl-C", seed=1, count=2, folder=tmp_path, bare=True)
    assert counts.accepted > 0


@pytest.mark.long
def test_without_decision_75_bursts_of_the_search_that_died_are_believed(tmp_path: Path) -> None:
    counts = unchecked(restarts, BURSTS, "kill", seed=1, count=1, folder=tmp_path, first=1, bare=True)
    assert counts.accepted > 0
