"""Rig files: settings as written, and an error for unknown keys."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import msgspec
import pytest

from markerseek.core import ConfigError
from markerseek.rigs import read_rig_file
from markerseek.sim import SimulatedSettings

EXAMPLES = Path(__file__).parents[3] / "examples" / "rigs"


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def flat(table: dict[str, object], prefix: str = "") -> dict[str, object]:
    """Nested tables as one with dotted keys; None as a rig file writes it."""
    keys: dict[str, object] = {}
    for name, value in table.items():
        if isinstance(value, dict):
            keys |= flat(value, f"{prefix}{name}.")
        else:
            keys[prefix + name] = "none" if value is None else value
    return keys


def test_the_commented_example_shows_every_key_with_its_default() -> None:
    path = EXAMPLES / "simulated.toml"
    shown = flat(tomllib.loads(path.read_text(encoding="utf-8")))
    # A line whose value is not the default names the default in its comment.
    for name, default in re.findall(r'^(\w+) = .*# .*default "(\w+)"', path.read_text(encoding="utf-8"), re.MULTILINE):
        assert shown[f"marker.{name}"] != default
        shown[f"marker.{name}"] = default
    assert shown.pop("kind") == "simulated"
    assert shown == flat(json.loads(msgspec.json.encode(SimulatedSettings())))
    assert read_rig_file(path).marker.angle_deg == 12.5


def test_values_reach_the_settings_and_none_leaves_a_part_out(tmp_path: Path) -> None:
    text = 'kind = "simulated"\ntissue = "liver"\n[probe]\nelevation_focus_m = "none"\n[noise]\npeak_snr_db = 30\n'
    settings = read_rig_file(write(tmp_path, text + "[noise.bursts]\nframe_probability = 0.01\n"))
    assert settings.tissue == "liver"
    assert settings.probe.elevation_focus_m is None
    assert settings.noise.peak_snr_db == 30
    assert settings.noise.bursts is not None
    assert settings.noise.bursts.frame_probability == 0.01


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", 'the key kind is missing; write kind = "simulated" or'),
        ('kind = "real"\n', "kind is 'real'"),
        ('kind = "simulated"\ntisue = "liver"\n', "key tisue is unknown; did you mean tissue?"),
        (
            'kind = "simulated"\n[limits.serch]\nlow_deg = -30\n',
            "key limits.serch is unknown; did you mean",
        ),
        ('kind = "simulated"\n[noise.bursts]\nzzz = 1\n', "key noise.bursts.zzz is unknown; known here: frame_prob"),
        ('kind = "simulated"\n[stage]\nspeed_deg_s = "fast"\n', "stage.speed_deg_s is text, it must be a number"),
        (
            'kind = "simulated"\n[stage]\nspeed_deg_s = 2001.0\n',
            r"speed_deg_s is 2001.0 deg/s, it must lie in \(0, 2000\] deg/s",
        ),
        ('kind = "simulated"\n[limits.search]\nlow_deg = -60.0\nhigh_deg = 35.0\n', "leaves the travel range"),
        ('kind = "simulated"\nstart_deg = 40.0\n', "outside the travel range"),
        ('kind = "simulated"\nreceiver.samples = 9223372036854775807\n', "2080 is usual"),
        ('kind = "simulated"\nprobe.array.pitch_m = 1e-300\n', "it must lie between 1e-6 and 0.1 m"),
        ('kind = "simulated"\n[stage\n', "not valid TOML"),
    ],
)
def test_a_file_with_a_fault_is_refused_with_file_key_and_cure(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        read_rig_file(write(tmp_path, text))
    assert "rig.toml" in str(caught.value)


def test_a_file_that_is_not_text_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_bytes(b'kind = "simulated"\n\xff\xfe')
    with pytest.raises(ConfigError, match=r"this is no text in UTF-8 .*, and a rig file is expected; name one in TOML"):
        read_rig_file(path)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        read_rig_file(tmp_path / "rig.toml")
