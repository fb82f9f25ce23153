"""Rig files of kind "bench": settings as written, and an error for missing required ones."""

from __future__ import annotations

import inspect
import math
import tomllib
from pathlib import Path
from typing import Annotated, Literal, get_args, get_origin, get_type_hints

import pytest

from markerseek.core import ConfigError, Interval, Within
from markerseek.drivers import (
    BenchProbe,
    BenchSettings,
    BenchSupervisor,
    Kdc101Settings,
    LaserBoxSettings,
    PicolasSettings,
    SonixDaqSettings,
)
from markerseek.drivers.entry import PARTS, driver_names, entry_named
from markerseek.emulators import EmulatedKdc101
from markerseek.guard import Limits
from markerseek.rigs import read_rig_file

EXAMPLE = Path(__file__).parents[3] / "examples" / "rigs" / "bench.toml"

MINIMAL = '[stage]\nport = "/dev/a"\nzero_deg = 12.5\n[laser]\nport = "/dev/b"\n[receiver]\nfolder = "daq"\n'


def read(folder: Path, text: str) -> BenchSettings:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    settings = read_rig_file(path)
    assert isinstance(settings, BenchSettings)
    return settings


def keys_of(table: dict[str, object], prefix: str = "") -> set[str]:
    keys: set[str] = set()
    for key, value in table.items():
        keys |= keys_of(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key}
    return keys


def test_the_commented_example_names_every_key_and_holds_the_defaults() -> None:
    settings = read_rig_file(EXAMPLE)
    assert isinstance(settings, BenchSettings)
    # A rig's record leaves out `trace` and a motion that is not stated.
    named = keys_of(settings.table()) | {"kind", "trace", "tissue.motion_mm"}
    assert keys_of(tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))) == named
    assert settings == BenchSettings(
        stage=Kdc101Settings(port="/dev/ttyUSB0", zero_deg=0.0),
        laser=LaserBoxSettings(port="/dev/ttyACM0"),
        receiver=SonixDaqSettings(folder=str(EXAMPLE.parent / "daq")),
    )


def test_the_required_settings_suffice_and_folders_lie_beside_the_file(tmp_path: Path) -> None:
    settings = read(tmp_path, 'kind = "bench"\n' + MINIMAL)
    assert settings.stage.zero_deg == 12.5
    assert settings.receiver.folder == str(tmp_path / "daq")
    assert settings.supervisor.enabled
    other = read(tmp_path, 'kind = "bench"\n' + MINIMAL.replace('"daq"', '"/data/daq"\nstart_command = ["go", "now"]'))
    assert (other.receiver.folder, other.receiver.start_command) == ("/data/daq", ("go", "now"))
    # A number of pulses that varies is a watermark, where the receiver records as many as it is triggered.
    varied = read(tmp_path, 'kind = "bench"\n' + MINIMAL + 'frames = "triggered"\n')
    assert (settings.pulses, varied.pulses) == ((16,), (17, 15, 16))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MINIMAL.replace("zero_deg = 12.5\n", ""), "the key stage.zero_deg is missing"),
        (MINIMAL.replace('port = "/dev/b"\n', ""), "the key laser.port is missing"),
        ('[stage]\nport = "a"\nzero_deg = 0.0\n', "the key laser is missing"),
        (MINIMAL + "foldr = 1\n", "key receiver.foldr is unknown; did you mean receiver.folder"),
        (MINIMAL + "[supervisor]\nenabeld = false\n", "key supervisor.enabeld is unknown; did you mean"),
        (MINIMAL + "[limits.search]\nlow_deg = 35.0\nhigh_deg = -35.0\n", "low end must lie below the high end"),
        (MINIMAL + "[limits.search]\nlow_deg = nan\nhigh_deg = 35.0\n", "must be finite"),
        (MINIMAL + "[firing]\npulses_per_permit = 15\n", "pulses is 16, firing.pulses_per_permit is 15"),
        (
            MINIMAL.replace('port = "/dev/b"', 'port = "/dev/b"\ndriver = "lamp"'),
            "it must be one of: laserbox, picolas",
        ),
        (
            MINIMAL.replace('port = "/dev/b"', 'port = "/dev/b"\ndriver = { name = "laserbox" }'),
            "laser.driver is {'name': 'laserbox'}, it must be one of: laserbox, picolas",
        ),
        (
            MINIMAL.replace("zero_deg = 12.5", "zero_deg = 12.5\nspeed_deg_s = 99.0"),
            r"speed_deg_s is 99.0 deg/s, it must lie in \[0.1, 25\] deg/s",
        ),
        (MINIMAL + "stable_s = nan\n", "stable_s is nan s"),
        (MINIMAL + 'start_command = "rm -rf /"\n', 'start_command is text, it must be a list or "none"'),
        (MINIMAL + 'tissue = "liver"\n', "key receiver.tissue is unknown"),
        ('tissue = "liver"\n' + MINIMAL, "tissue is text, it must be a table"),
        ('medium = "liver"\n' + MINIMAL, "key medium is unknown"),
    ],
)
def test_a_file_with_a_fault_is_refused_with_file_key_and_cure(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read(tmp_path, 'kind = "bench"\n' + text)
    assert "rig.toml" in str(caught.value)


KINDS = [entry_named(part, driver).settings for part in PARTS for driver in driver_names(part)]
OTHERWISE = {"stable_s", "noise_ratio", "reach_deg", "drift_deg", "step_deg", "reversal_deg", "serial_number"}
"""Numbers whose limits depend on another key, or that have none."""
USUAL = {
    "port": "a",
    "zero_deg": 0.0,
    "folder": "a",
    "uri": "xi-com:a",
    "steps_per_deg": 9.0,
    "device": "a",
    "probe": "a",
}


def limited(kind: type) -> dict[str, Within]:
    """Limits of the numbers among the keys of a table."""
    hints = get_type_hints(kind, include_extras=True)
    return {key: hint.__metadata__[0] for key, hint in hints.items() if get_origin(hint) is Annotated}


@pytest.mark.parametrize("kind", [*KINDS, BenchProbe, BenchSupervisor, EmulatedKdc101])
def test_no_number_passes_outside_of_its_limits(kind: type) -> None:
    limits = limited(kind)
    names = {each.name for each in inspect.signature(kind).parameters.values()}
    needed = {key: 1 if key in limits else value for key, value in USUAL.items() if key in names}
    needed = {} if kind in (BenchProbe, EmulatedKdc101) else needed
    for key, within in limits.items():
        for value in (math.nan, within.low - 1, within.high + 1, *([within.low] if within.open_low else [])):
            with pytest.raises(ConfigError, match=rf": {key} is .* must lie in"):
                kind(**needed | {key: value})


@pytest.mark.parametrize("kind", KINDS)
def test_each_number_of_a_device_has_limits(kind: type) -> None:
    numbers = {key for key, hint in get_type_hints(kind).items() if {int, float} & {hint, *get_args(hint)}}
    assert numbers - OTHERWISE <= limited(kind).keys()


@pytest.mark.parametrize("noise_ratio", [1.0, math.nan])
def test_a_noise_ratio_is_a_factor_above_1(noise_ratio: float) -> None:
    with pytest.raises(ConfigError, match="noise_ratio is"):
        SonixDaqSettings(folder="a", noise_ratio=noise_ratio)


def test_a_picolas_driver_needs_the_supervisor() -> None:
    with pytest.raises(ConfigError, match="a PicoLAS driver has no lease of its own; keep it enabled"):
        BenchSettings(
            stage=Kdc101Settings(port="a", zero_deg=0.0),
            laser=PicolasSettings(port="b"),
            receiver=SonixDaqSettings(folder="c"),
            supervisor=BenchSupervisor(enabled=False),
        )


@pytest.mark.parametrize(("side", "low_deg", "high_deg"), [("below", -35.6, 35.0), ("above", -35.0, 35.6)])
def test_a_search_that_could_not_be_approached_from_one_side_is_refused(
    side: Literal["below", "above"], low_deg: float, high_deg: float
) -> None:
    def settings(limits: Limits) -> BenchSettings:
        return BenchSettings(
            stage=Kdc101Settings(port="a", zero_deg=0.0, approach_from=side),
            laser=LaserBoxSettings(port="b"),
            receiver=SonixDaqSettings(folder="c"),
            limits=limits,
        )

    settings(Limits(search=Interval(low_deg=-35.5, high_deg=35.5)))
    with pytest.raises(ConfigError, match=f"from {side} the stage must start at .*36.6 deg, outside the travel range"):
        settings(Limits(search=Interval(low_deg=low_deg, high_deg=high_deg)))
