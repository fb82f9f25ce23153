"""`markerseek resume` of a journal of devices: the rig comes from the user's rig file, not the journal."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from msgspec import structs
from msgspec.structs import replace as changed_keys

from markerseek.core import ConfigError, Interval
from markerseek.drivers import BenchSettings, Kdc101Settings, LaserBoxSettings, SonixDaqSettings
from markerseek.guard import FiringLimits, Limits
from markerseek.records.journal import Configuration, Journal, RecordedRun
from markerseek.rigs import BenchRecipe, SimulatedRecipe, bench_fingerprint
from markerseek.runs import rebuild_rig, require_same_measurement
from markerseek.sim import SimulatedSettings
from tests.unit.records.journal.synthetic_journals import changed, configuration

Shell = Callable[..., tuple[int, str, str]]

RIG = """kind = "bench"
[stage]
port = "{0}/stage"
zero_deg = 0.0
[laser]
port = "{0}/laser"
[receiver]
folder = "{0}"
"""


def settings_of(folder: Path) -> BenchSettings:
    return BenchSettings(
        stage=Kdc101Settings(port=f"{folder}/stage", zero_deg=0.0),
        laser=LaserBoxSettings(port=f"{folder}/laser"),
        receiver=SonixDaqSettings(folder=str(folder)),
    )


def hostile(folder: Path) -> BenchSettings:
    """The same bench with a program, wide limits, a larger budget, and another port."""
    plain = settings_of(folder)
    return structs.replace(
        plain,
        stage=changed_keys(plain.stage, port="/elsewhere/stage"),
        receiver=changed_keys(plain.receiver, start_command=("touch", str(folder / "ran"))),
        limits=structs.replace(plain.limits, travel=Interval(low_deg=-170.0, high_deg=170.0)),
        firing=FiringLimits(pulses_per_session=10**9),
    )


def begun_with(settings: BenchSettings, **changes: object) -> Configuration:
    return configuration(
        kind="bench",
        recipe=msgspec.Raw(msgspec.json.encode(BenchRecipe.of(settings))),
        fingerprint=bench_fingerprint(settings),
        search=settings.limits.search,
        truth_deg=None,
        seed=None,
        **changes,
    )


def journal_and_rig(folder: Path, settings: BenchSettings) -> tuple[Path, Path]:
    path = folder / "run.journal"
    rig = folder / "rig.toml"
    Journal.create(path, begun_with(settings)).close()
    rig.write_text(RIG.format(folder))
    return path, rig


def test_without_a_rig_file_a_journal_of_devices_is_not_armed(shell: Shell, tmp_path: Path) -> None:
    path, _ = journal_and_rig(tmp_path, hostile(tmp_path))
    code, _, err = shell("resume", path, "--arm")
    assert code == 2
    assert f"which is not taken from a journal; name the rig file: markerseek resume {path} --rig RIG.toml" in err
    assert "elsewhere" not in err  # nothing was opened
    code, out, _ = shell("resume", path)
    assert code == 4
    assert f"continue with: markerseek resume {path} --rig RIG.toml --arm" in out
    code, out, _ = shell("resume", path, "--json")
    assert (code, json.loads(out)["rig_file_needed"], json.loads(out)["armed"]) == (4, True, False)


def test_ports_limits_budgets_and_programs_are_those_of_the_rig_file_and_shown(shell: Shell, tmp_path: Path) -> None:
    path, rig = journal_and_rig(tmp_path, hostile(tmp_path))
    code, _, err = shell("resume", path, "--rig", rig, "--arm")
    assert code == 1
    assert re.search(f"{tmp_path}/(laser|stage).*cannot be opened", err)
    for shown in (
        "limits: search [-35, 35] deg, travel [-36.5, 36.5] deg",
        "budgets: 128 pulses per permit, 1000 per second, 100000 per session",
        "start_command: none",
        "limits.travel.high_deg is 36.5, was 170.0",
        "firing.pulses_per_session is 100000, was 1000000000",
        "receiver.start_command is None, was",
        "was /elsewhere/stage",
    ):
        assert shown in err, err
    code, out, _ = shell("resume", path, "--rig", rig, "--json")
    assert (code, json.loads(out)["rig_file_needed"]) == (4, False)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda s: structs.replace(s, stage=changed_keys(s.stage, zero_deg=1.0)), "stage.zero_deg is 0.0, was 1.0"),
        (lambda s: structs.replace(s, laser=changed_keys(s.laser, pulses=8)), "laser.pulses is 16, was 8"),
        (
            lambda s: structs.replace(s, limits=Limits(search=Interval(low_deg=-20.0, high_deg=35.0))),
            "limits.search.low_deg is -35.0, was -20.0",
        ),
    ],
)
def test_a_rig_file_of_another_rig_is_refused(
    shell: Shell, tmp_path: Path, change: Callable[[BenchSettings], BenchSettings], said: str
) -> None:
    path, rig = journal_and_rig(tmp_path, change(settings_of(tmp_path)))
    code, _, err = shell("resume", path, "--rig", rig, "--arm")
    assert (code, f"{rig}: the rig file does not describe the rig of the journal: {said}" in err) == (2, True), err


def test_a_search_range_wider_than_the_rig_file_s_is_refused(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    wide = begun_with(settings)
    wide = changed(wide, search=Interval(low_deg=-170.0, high_deg=170.0))
    with pytest.raises(ConfigError, match=r"limits.search is \[-35, 35\] deg, the journal searches \[-170, 170\] deg"):
        require_same_measurement(wide, settings, settings)


def recorded(configuration: Configuration) -> RecordedRun:
    return RecordedRun(path=Path("run.journal"), configuration=configuration, entries=())


@pytest.mark.parametrize(("was", "now"), [((), ("stage", "laser")), (("laser",), ("stage",)), (("laser",), ())])
def test_emulated_devices_do_not_continue_a_search_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, was: tuple[str, ...], now: tuple[str, ...]
) -> None:
    closed = []
    settings = settings_of(tmp_path)
    held = begun_with(settings)
    held = changed(held, emulated=was)
    facts = structs.replace(held.facts, emulated=now)
    rig = SimpleNamespace(facts=facts, close=lambda: closed.append(True))
    monkeypatch.setattr("markerseek.runs.recorded_rig.bench", lambda _: rig)
    said = f"the emulated devices of the journal are: {', '.join(was) or 'none'}; those of the rig file are: "
    with pytest.raises(ConfigError, match=said):
        rebuild_rig(recorded(held), bench_settings=settings)
    assert closed == [True]
    assert rebuild_rig(recorded(changed(held, emulated=now)), bench_settings=settings) is rig


def test_a_rig_file_where_none_is_needed_or_of_another_kind_is_refused(shell: Shell, tmp_path: Path) -> None:
    path, rig = journal_and_rig(tmp_path, settings_of(tmp_path))
    simulated = tmp_path / "simulated.toml"
    simulated.write_text('kind = "simulated"\n')
    code, _, err = shell("resume", path, "--rig", simulated, "--arm")
    assert (code, "describes a simulated rig" in err) == (2, True)
    other = tmp_path / "other.journal"
    recipe = SimulatedRecipe(seed=1, settings=SimulatedSettings(), pace=0.0)
    Journal.create(other, configuration(recipe=msgspec.Raw(msgspec.json.encode(recipe)))).close()
    code, _, err = shell("resume", other, "--rig", rig, "--arm")
    assert (code, "describes it in full; leave --rig out" in err) == (2, True)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "simulated"}, "says that its rig is simulated and holds the settings of another kind, bench"),
        ({"recipe": b'{"type":"bench","settings":{}}'}, "the journal's rig cannot be read: the key stage is missing"),
    ],
)
def test_a_journal_that_contradicts_itself_is_refused(
    shell: Shell, tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    if "recipe" in changes:
        changes = {"recipe": msgspec.Raw(changes["recipe"])}  # type: ignore[arg-type]
    path = tmp_path / "run.journal"
    Journal.create(path, changed(begun_with(settings_of(tmp_path)), **changes)).close()
    code, _, err = shell("resume", path, "--arm")
    assert (code, said in err) == (2, True), err
