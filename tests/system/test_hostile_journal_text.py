"""Texts and angles of foreign journals: no terminal control characters, no angle outside the limits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import (
    Asked,
    Failed,
    Interval,
    Measured,
    MoveError,
    Reading,
    Refused,
    Sample,
    SearchPlan,
    Started,
)
from markerseek.records.journal import Configuration, Interrupted, Journal, JournalEvent
from markerseek.runs import configuration_of
from tests.unit.records.journal.synthetic_journals import changed

Shell = Callable[..., tuple[int, str, str]]

EVIL = "\x1b]0;owned\x07\x1b[2J\r\x9b31m\u202e\nstate: finished"
SHOWN = r"\x1b]0;owned\x07\x1b[2J\r\x9b31m\u202e"
RANGE = Interval(low_deg=-35.0, high_deg=35.0)


def begun_with(**changes: object) -> Configuration:
    plain = configuration_of(rigs.simulated(seed=1), SearchPlan(method="ternary", acquisitions=8, as_published=False,
        start_deg=0.0, dark_frames=0, stay=False))  # fmt: skip
    return changed(plain, **changes)


def journal(path: Path, *events: JournalEvent, **changes: object) -> Path:
    with Journal.create(path, begun_with(**changes)) as kept:
        for event in events:
            kept.commit(event, clock_s=0.0)
    return path


def controls(text: str) -> set[str]:
    return {char for char in text if char != "\n" and not char.isprintable()}


STARTED = Started(start_deg=0.0, limits=RANGE)
ASKED = Asked(role="search", index=1, angle_deg=1.0)


@pytest.mark.parametrize(
    ("words", "last"),
    [
        (("journal", "show"), Interrupted(reason=EVIL)),
        (("journal", "replay"), Failed(error=MoveError(EVIL))),
        (("resume",), Failed(error=MoveError(EVIL))),
    ],
)
def test_no_command_hands_control_characters_of_a_journal_to_the_terminal(
    shell: Shell, tmp_path: Path, words: tuple[str, ...], last: JournalEvent
) -> None:
    path = journal(
        tmp_path / "run.journal", STARTED, ASKED, Refused(angle_deg=1.0, reason=EVIL), last,
        description=EVIL, versions={"evil": EVIL},
    )  # fmt: skip
    for as_json in ((), ("--json",)):
        _, out, err = shell(*words, path, *as_json)
        assert controls(out) | controls(err) == set()
    _, out, _ = shell("journal", "show", path)
    assert out.count(SHOWN) >= 2
    assert out.count(SHOWN[:12]) >= 4  # those in the narrow columns of the table are wrapped
    assert sum(line.startswith("state: ") for line in out.splitlines()) == 1


def sample(angle_deg: float) -> Sample:
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=1.0))


@pytest.mark.parametrize("angle_deg", [900.0, -37.2])
def test_an_angle_outside_the_limits_of_the_run_is_not_gone_to(shell: Shell, tmp_path: Path, angle_deg: float) -> None:
    taken = Measured(role="search", index=1, sample=sample(angle_deg))
    path = journal(tmp_path / "run.journal", STARTED, ASKED, taken)
    before = path.stat().st_size
    code, _, err = shell("resume", path, "--arm")
    assert code == 2
    assert f"the strongest acquisition lies at {angle_deg:g} deg, outside of" in " ".join(err.split())
    assert path.stat().st_size >= before
