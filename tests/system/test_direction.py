"""The check of the sense of rotation, on simulated and on emulated devices."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from markerseek.cli import direction as direction_of
from markerseek.cli import doctor
from markerseek.cli.direction import verdict_of
from markerseek.core import RigFacts
from markerseek.drivers import (
    Kdc101Settings,
    Kdc101Stage,
    LaserBox,
    LaserBoxSettings,
    SonixDaqReceiver,
    SonixDaqSettings,
    metered,
)
from markerseek.emulators import EmulatedBench, EmulatedKdc101
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs import Rig, image_reader
from markerseek.scan import Scanner
from markerseek.sim import LaserSettings, MarkerSettings, ReceiverSettings, SimulatedSettings
from tests.emulated_lines import BenchClock, DirectPort

Shell = Callable[..., tuple[int, str, str]]

SOURCE_DEG = 12.0
SETTINGS = SimulatedSettings(
    marker=MarkerSettings(angle_deg=SOURCE_DEG),
    receiver=ReceiverSettings(readout_s=0.3),
    laser=LaserSettings(pulses=4, energy_meter_noise=0.0),
)


class _Lines:
    """Lines that nothing has to be done with."""

    def arm(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Nothing to do."""


def emulated_rig(folder: Path, *, mirrored: bool, **stage: Any) -> Rig:
    """The real drivers on emulated devices in virtual time, with a light meter that nothing uses; unarmed."""
    bench = EmulatedBench(
        settings=SETTINGS,
        rng=np.random.default_rng(3),
        folder=folder,
        stage=EmulatedKdc101(play_deg=0.1, mirrored=mirrored),
    )
    clock = BenchClock()
    clock.lead(bench.stage.advance, bench.daq.advance)
    imaging = image_reader(SETTINGS.probe.array, sampling_hz=SETTINGS.receiver.sampling_hz)
    devices: dict[str, Any] = {
        "stage": Kdc101Stage(
            port=DirectPort(device=bench.stage, clock=clock),
            clock=clock,
            settings=Kdc101Settings(**{"port": "", "zero_deg": 0.0} | stage),
        ),
        "laser": LaserBox(
            port=DirectPort(device=bench.laser_box, clock=clock),
            clock=clock,
            settings=LaserBoxSettings(port="", pulses=4),
        ),
        "receiver": SonixDaqReceiver(
            settings=SonixDaqSettings(folder=str(folder), timeout_s=3.0), clock=clock, dark_triggers=4
        ),
    }
    keys = LaserBoxSettings(port="", energy_from="photodiode")
    devices["receiver"] = metered(keys, devices["laser"], devices["receiver"], full_scale=2047)
    guard = Guard(limits=SETTINGS.limits, firing=FiringLimits(), admission=Admission())
    scanner = Scanner(**devices, reader=imaging, clock=clock, guard=guard, pulses=4)
    return Rig(
        facts=RigFacts(kind="bench", description="emulated", fingerprint="", search=SETTINGS.limits.search),
        **devices,
        scanner=scanner,
        imaging=imaging,
        dark_frames=2,
        devices=_Lines(),
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("mirrored", "direction", "code", "said"),
    [
        (False, "forward", 0, "the stage turns the right way"),
        (True, "reverse", 0, "the stage turns the right way"),
        (True, "forward", 1, "the mirrored angle: the stage turns the other way round; change stage.direction"),
        (False, "reverse", 1, "the mirrored angle: the stage turns the other way round; change stage.direction"),
    ],
)
def test_a_probe_mounted_the_other_way_round_is_noticed_on_the_emulated_bench(
    shell: Shell,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mirrored: bool,
    direction: str,
    code: int,
    said: str,
) -> None:
    made: list[Rig] = []

    @contextmanager
    def open_emulated(_path: Path) -> Any:
        made.append(emulated_rig(tmp_path / f"daq-{len(made)}", mirrored=mirrored, direction=direction))
        yield made[-1], made[-1].scanner.angle_deg

    for module in (direction_of, doctor):
        monkeypatch.setattr(module, "open_rig", open_emulated)
    monkeypatch.setattr(doctor, "_search", lambda _: doctor.CheckResult(what="", state="ok", detail=""))
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n')
    words = ("doctor", "--rig", rig, "--source-deg", SOURCE_DEG, "--json")
    ended, out, _ = shell(*words)
    assert (ended, json.loads(out)["armed"]) == (4, False)  # it was not armed
    assert made[-1].scanner.guard.pulses_permitted == 0
    ended, out, err = shell(*words, "--arm")
    finding = json.loads(out)["findings"][-1]
    assert (ended, said in finding["detail"]) == (code, True), (finding, err)
    assert re.search(r", and its meter says (19|20)\d{3} of a usual pulse", finding["detail"])


def test_a_source_at_the_mirrored_angle_is_named_by_the_command(shell: Shell, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\n[marker]\nangle_deg = -14.0\n')
    code, out, _ = shell("doctor", "--rig", rig, "--source-deg", "14", "--json")
    assert (code, "mirrored" in json.loads(out)["findings"][-1]["detail"]) == (1, True)


@pytest.mark.parametrize(
    ("found_deg", "source_deg", "verdict"),
    [(12.4, 12, "right"), (-12.4, -12, "right"), (-11.0, 12, "mirrored"), (3.0, 12, "neither"), (0.0, 5, "neither")],
)
def test_the_verdict(found_deg: float, source_deg: float, verdict: str) -> None:
    assert verdict_of(found_deg, source_deg) == verdict


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--source-deg", "3"), "at least 5 deg off 0"),
        (("--source-deg", "nan"), "at least 5 deg off 0"),
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
