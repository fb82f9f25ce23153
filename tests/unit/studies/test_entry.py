"""Entries from elsewhere: a child that keeps to the contract searches, and any other is a failed entry that is said."""

from __future__ import annotations

import select
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

from markerseek.core import ConfigError, Found, Interval, NotFound, Reading, Sample, Tolerance, Unsure
from markerseek.studies import entry
from markerseek.studies.benchmark import WORLDS
from markerseek.studies.policies import study_policy
from markerseek.studies.study import cells
from markerseek.studies.trial import run_trial

LIMITS = Interval(low_deg=-35.0, high_deg=35.0)

HEAD = """
import json, sys
def reply(text): print(text, flush=True)
def angle(deg): reply(json.dumps({"angle_deg": deg}))
lines = map(json.loads, sys.stdin)
"""


def command(body):
    return (sys.executable, "-c", HEAD + textwrap.dedent(body))


def policy(body, *, acquisitions=3):
    words = command(body)
    return entry.EntryPolicy(words, limits=LIMITS, acquisitions=acquisitions, start_deg=-35.0, tolerance=Tolerance())


def sample(angle_deg, intensity=1.0, **more):
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity), **more)


def searched(body, *, acquisitions=3):
    made = policy(body, acquisitions=acquisitions)
    while (angle_deg := made.ask()) is not None:
        made.tell(sample(angle_deg))
    return made.estimate()


def test_it_is_told_of_the_search_and_of_each_sample():
    made = policy(
        """
        search = next(lines)
        assert search["type"] == "search" and (search["low_deg"], search["high_deg"]) == (-35, 35)
        assert search["acquisitions"] == 3 and search["start_deg"] == -35 and search["tolerance_mm"] == 1
        angle(search["dark"][0]["intensity"])
        told = next(lines)
        assert told["type"] == "sample" and told["angle_deg"] == 7.5
        angle(told["intensity"])
        next(lines)
        reply('{"answer": "found", "angle_deg": 3, "low_deg": 2, "high_deg": 4}')
        next(lines)
        angle(1)
        next(lines, None)
        """
    )
    assert isinstance(made.estimate(), NotFound)
    made.tell(sample(0.0, 7.0, dark=True))
    assert made.ask() == made.ask() == 7.0
    made.tell(sample(7.5, 9.0))
    assert made.ask() == 9.0
    made.tell(sample(9.0))
    assert made.ask() is None
    found = made.estimate()
    assert isinstance(found, Found)
    assert (found.mean_deg, found.interval95_deg) == (3.0, Interval(low_deg=2.0, high_deg=4.0))
    # The same child meets the next search.
    assert made._child.reply_to({"type": "search"}).angle_deg == 1


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        ('{"answer": "not found"}', NotFound),
        ('{"answer": "unsure", "angle_deg": 0, "low_deg": -1, "high_deg": 1}', Unsure),
    ],
)
def test_it_need_not_claim_anything(answer, kind):
    assert isinstance(searched(f"for _ in lines: reply('{answer}')"), kind)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("for _ in lines: reply('hello')", r"it replied b'hello', which is no JSON of a reply"),
        ("for _ in lines: reply('[1]')", "which is no JSON of a reply"),
        ("for _ in lines: reply('{\"angle\": 3}')", "unknown field `angle`"),
        ("for _ in lines: angle(float('nan'))", "which is no JSON of a reply"),
        ("for _ in lines: reply('{\"angle_deg\": null}')", "angle_deg is None deg, it must be a finite number"),
        ("for _ in lines: reply('{\"angle_deg\": 1e999}')", "no JSON of a reply|must be a finite number"),
        ("for _ in lines: angle(35.5)", "angle_deg is 35.5 deg, it must be a finite number in the range"),
        ("for _ in lines: angle(0)", "asked for more than the 3 acquisitions"),
        ('for _ in lines: reply(\'{"answer": "maybe"}\')', "which is no JSON of a reply"),
        ('for _ in lines: reply(\'{"answer": "found", "angle_deg": 3}\')', "low_deg and high_deg must be finite"),
        (
            'for _ in lines: reply(\'{"answer": "found", "angle_deg": 3, "low_deg": 4, "high_deg": 5}\')',
            "hold the angle between them",
        ),
        (
            'for _ in lines: reply(\'{"answer": "found", "angle_deg": 3, "low_deg": -1e308, "high_deg": 1e308}\')',
            "and be at most 140 deg apart",
        ),
        (
            'for _ in lines: reply(\'{"answer": "unsure", "angle_deg": 3, "low_deg": -71, "high_deg": 71}\')',
            "and be at most 140 deg apart",
        ),
        ("raise KeyError('oops')", "it ended where a reply was due; its last words: KeyError: 'oops'"),
        ("for _ in lines: print('x' * 100_000, end='', flush=True)", "it replied b'xxx"),
        ("import os\nfor _ in lines: os._exit(0)", "it ended where a reply was due"),
    ],
)
def test_a_child_that_breaks_the_contract_is_a_failed_entry(body, message):
    with pytest.raises(entry.EntryError, match=message):
        searched(body)


def test_a_child_that_hangs_is_ended_and_not_asked_again(monkeypatch):
    monkeypatch.setattr(entry, "START_S", 2.0)
    made = policy("import time\nprint('loading', file=sys.stderr, flush=True)\ntime.sleep(99)")
    message = "it did not reply within 2 s; its last words: loading"
    with pytest.raises(entry.EntryError, match=message):
        made.ask()
    assert made._child._child.poll() is not None
    with pytest.raises(entry.EntryError, match=message):
        made.ask()


def test_a_line_that_comes_before_it_is_asked_is_no_reply():
    """Else the angle of one sample would be taken for that of the next."""
    made = policy(
        """
        import time
        next(lines)
        angle(1)
        time.sleep(0.3)
        angle(2)
        next(lines)
        """
    )
    made.ask()
    assert select.select([made._child._child.stdout], [], [], 10)[0]
    made.tell(sample(1.0))
    with pytest.raises(entry.EntryError, match="a line that nobody asked for"):
        made.ask()


def test_it_begins_in_an_empty_folder_and_with_few_variables(monkeypatch):
    monkeypatch.setenv("SEED", "7")
    body = """
    import os
    next(lines)
    assert os.listdir() == []
    assert "SEED" not in os.environ
    assert os.environ["TMPDIR"] == os.getcwd()
    open("kept", "w").close()
    reply('{"answer": "not found"}')
    next(lines, None)
    """
    made = policy(body)
    assert made.ask() is None
    assert isinstance(made.estimate(), NotFound)
    (folder,) = [each for each in Path(tempfile.gettempdir()).glob("entry-*") if (each / "kept").exists()]
    made._child._end()
    assert not folder.exists()


def test_a_program_that_is_not_there_is_a_failed_entry():
    with pytest.raises(entry.EntryError, match="no-such-program: it cannot be started: No such file"):
        entry.EntryPolicy(("no-such-program",), limits=LIMITS, acquisitions=3, tolerance=Tolerance())


def study_of(tier, world, body, *, channels=True):
    (held,) = [each for each in WORLDS if (each.tier, each.name) == (tier, world)]
    settings = study_policy(method="mine", acquisitions=5, command=command(body), channels=channels)
    return held.study("test", (settings,), searches=1)


@pytest.mark.parametrize(("channels", "answer"), [(True, "found"), (False, "not found")])
def test_channel_data_and_block_maxima_are_told(channels, answer):
    """The entry answers found only where it was told of 128 × 2080 counts and of all blocks."""
    body = """
    import base64
    for line in lines:
        if line["type"] == "search":
            angle(3)
            continue
        channels = line.get("channels", {"shape": (0, 0), "int16": ""})
        rows, columns = channels["shape"]
        counts = base64.b64decode(channels["int16"])
        blocks = line["blocks"]
        whole = (rows, columns) == (128, 2080) and len(counts) == 2 * 128 * 2080
        whole = whole and max(blocks["intensities"]) <= line["intensity"] * 1.01 and line["noise_sigma"] > 0
        found = '{"answer": "found", "angle_deg": 3, "low_deg": 2, "high_deg": 4}'
        reply(found if whole else '{"answer": "not found"}')
    """
    study = study_of("raw channels", "one", body, channels=channels)
    row = run_trial(study, cells(study)[0], 0, 0)
    assert (row.answer, row.acquisitions) == (answer, 1)


@pytest.mark.parametrize("setting", [{"sweep": True}, {"early_end": False}, {"others": 0.1}, {"prior": True}])
def test_a_setting_that_no_entry_has_is_refused(setting):
    """They were dropped without a word."""
    with pytest.raises(ConfigError, match=f"mine: {next(iter(setting))} is .*, an entry has no such setting"):
        study_policy(method="mine", acquisitions=5, command=("mine",), **setting)
