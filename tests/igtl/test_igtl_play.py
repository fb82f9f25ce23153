"""Recordings played over OpenIGTLink: a journal and a bank, with their own timing."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import pytest

from markerseek.bridges import Recording, open_recording
from markerseek.bridges.igtl import SearchService
from markerseek.core import Measured
from markerseek.records.journal import Entry
from markerseek.wire import igtl
from tests.igtl.igtl_bridge import bridge
from tests.igtl.igtl_client import IgtlClient

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    path = tmp_path / "run.journal"
    command = [sys.executable, "-m", "markerseek", "search", "--seed", "3", "--method", "golden-section"]
    subprocess.run([*command, "--acquisitions", "5", "--journal", str(path)], check=False, capture_output=True)
    return path


def over(message: igtl.Message) -> bool:
    return message.device == "SearchState" and json.loads(message.content.text)["state"] == "ended"


def test_a_journal_is_played_to_its_answer_and_commands_are_refused(journal: Path) -> None:
    with bridge("--play", str(journal), "--pace", "0.05") as running, IgtlClient(running.port) as client:
        refused = client.ask('<Command Name="StartSearch" />')
        assert "FAIL" in refused
        assert "this bridge plays a recording" in refused
        messages = client.until(over)
        assert running.stop() == 130
    angles = [
        item.event.sample.angle_deg
        for _, item in open_recording(journal).items()
        if isinstance(item, Entry) and isinstance(item.event, Measured)
    ]
    states = [json.loads(each.content.text) for each in messages if each.device == "SearchState"]
    # A client that comes late sees the rest of the angles, in their order.
    shown = list(dict.fromkeys(each["angle_deg"] for each in states if each.get("phase") == "measured"))
    assert len(shown) >= 2
    assert shown == list(dict.fromkeys(angles))[-len(shown) :]
    assert states[-1]["recording"] == "run.journal"
    assert states[-1]["result"]["angle_deg"] == open_recording(journal).outcome.answer["angle_deg"]
    image = next(each for each in messages if each.device == "PA_ProbeHome")
    assert image.metadata["recording"] == "run.journal"
    assert image.metadata["rig"] == "simulated"


def played(recording: Recording, *, pace: float) -> tuple[float, list[float]]:
    """Seconds that a recording took on the clock of an event loop that jumps to the next timer, and its waits."""

    async def run() -> tuple[float, list[float]]:
        loop = asyncio.get_running_loop()
        service = SearchService(None, recording=recording.name, on_note=print)
        waits: list[float] = []
        ahead = 0.0
        clock = loop.time
        began_s = clock()

        async def sleep(seconds: float) -> None:
            nonlocal ahead
            waits.append(seconds)
            ahead += max(0.0, seconds)

        loop.time = lambda: clock() + ahead
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(asyncio, "sleep", sleep)
            await service.play(recording, pace=pace)
        del loop.time
        return clock() + ahead - began_s, waits

    return asyncio.run(run())


def test_a_recording_has_its_own_timing(journal: Path) -> None:
    recording = open_recording(journal)
    times_s = [time_s for time_s, _ in recording.items()]
    duration_s = times_s[-1] - times_s[0]
    assert duration_s > 50
    # Making images takes part of the time, which the waits make good; that of the last comes after all waits.
    assert played(recording, pace=1.0)[0] == pytest.approx(duration_s, abs=5)
    assert played(recording, pace=10.0)[0] == pytest.approx(10 * duration_s, abs=5)
    assert max(played(recording, pace=0.0)[1]) <= 0


def test_a_table_of_intensities_is_played() -> None:
    recording = open_recording(EXAMPLES / "simulated_scan.csv")
    items = [item for _, item in recording.items()]
    assert recording.outcome is None
    assert len(items) > 10
    options = ("--play", str(EXAMPLES / "simulated_scan.csv"), "--pace", "0")
    with bridge(*options) as running, IgtlClient(running.port) as client:
        last = client.until(over)[-1]
    state = json.loads(last.content.text)
    assert state["rig"] == "replayed"
    assert state["angle_deg"] == items[-1].event.sample.angle_deg


def test_a_rig_and_a_recording_together_are_refused(journal: Path) -> None:
    command = [sys.executable, "-m", "markerseek", "igtl", "--play", str(journal), "--rig", "rig.toml"]
    ended = subprocess.run(command, capture_output=True, check=False, text=True)
    assert ended.returncode == 2
    assert "leave out --rig or --play" in " ".join(ended.stderr.split())
