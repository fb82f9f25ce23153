"""Settings are read from plain values, and what does not fit is named; TOML that would take minutes is not parsed."""

from __future__ import annotations

import datetime as dt
import re
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import pytest

from markerseek.core import ConfigError, Within, require_fields
from markerseek.files import nearest_key, read_toml, recorded_settings, settings_from


@pytest.mark.parametrize(
    "text",
    [
        "stage" + ".x" * 9000 + " = 1",
        '"stage"' + ' . "two words"' * 9000 + " = 1",
        "[" + "'a'.b." * 5000 + "c]",
        "[[" + "a." * 5000 + "c]]",
        "limits = { " + "a." * 5000 + "c = 1 }",
    ],
)
def test_a_key_of_very_many_parts_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"rig\.toml: the rig file has a key of more than 32 parts, two or three are"):
        read_toml(path, what="rig file")


def test_numbers_texts_and_comments_with_many_dots_are_no_keys(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    numbers = [0.5 * each for each in range(60)]
    path.write_text(f"# {'. ' * 90}\na.b.c = {numbers}\ntext = '{'…. ' * 90}'\n", encoding="utf-8")
    assert read_toml(path, what="rig file")["a"] == {"b": {"c": numbers}}


class Line(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="line", tag_field="driver"):
    port: str
    window_us: tuple[float, float] | None = None


class Light(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pulses: Annotated[int, Within(1, 128)] = 16
    side: Literal["below", "above"] = "below"

    def __post_init__(self) -> None:
        require_fields(self, "light")


class Range(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    low_deg: float
    high_deg: float


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    line: Line
    light: Light = Light()
    bounds: Range | None = None
    marks: tuple[int, ...] = ()
    lights: list[Light] = []
    name: str | None = "rig"


LINE = {"port": "/dev/ttyUSB0"}


def test_settings_are_read_from_plain_values() -> None:
    table = {
        "line": LINE | {"driver": "line", "window_us": [0, 1.5]},
        "bounds": {"low_deg": -3, "high_deg": 3.5},
        "marks": [2, 4],
        "lights": [{"pulses": 3}],
        "name": "none",
    }
    assert settings_from(table, Settings) == Settings(
        line=Line(port="/dev/ttyUSB0", window_us=(0.0, 1.5)),
        bounds=Range(low_deg=-3.0, high_deg=3.5),
        marks=(2, 4),
        lights=[Light(pulses=3)],
        name=None,
    )


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "the key line is missing; add it"),
        ({"line": {}}, "the key line.port is missing; add it"),
        ({"line": {"prt": "a"}}, "the key line.prt is unknown; did you mean line.port?"),
        ({"line": LINE, "zzz": 1}, "the key zzz is unknown; known here: line, light, bounds, marks, lights, name"),
        ({"line": LINE | {"driver": "lines"}}, "line.driver is 'lines', it must be one of: line"),
        ({"line": LINE | {"driver": 3}}, "line.driver is a whole number, it must be one of: line"),
        ({"line": 3}, "line is a whole number, it must be a table"),
        ({"line": [LINE]}, "line is a list, it must be a table"),
        ({"line": LINE | {"window_us": [1.0]}}, "line.window_us has 1 values, it must have 2"),
        ({"line": LINE | {"window_us": [1.0, "b"]}}, "line.window_us[1] is text, it must be a number"),
        ({"line": LINE | {"window_us": 1.0}}, 'line.window_us is a number, it must be a list or "none"'),
        ({"line": LINE, "light": {"pulses": 16.0}}, "light.pulses is a number, it must be a whole number"),
        ({"line": LINE, "light": {"pulses": "none"}}, 'light.pulses is "none", it must be a whole number'),
        ({"line": LINE, "light": {"pulses": 0}}, "light: pulses is 0, it must lie in [1, 128]"),
        ({"line": LINE, "light": {"side": "left"}}, "light.side is 'left', it must be one of: below, above"),
        ({"line": LINE, "light": {"side": True}}, "light.side is true or false, it must be one of: below, above"),
        ({"line": LINE, "lights": [{}, {"pulse": 3}]}, "the key lights[1].pulse is unknown; did you mean lights[1].p"),
        ({"line": LINE, "lights": [{}, {"pulses": "x"}]}, "lights[1].pulses is text, it must be a whole number"),
        ({"line": LINE, "marks": [1, dt.date(2026, 1, 1)]}, "marks[1] is a date, it must be a whole number"),
        ({"line": LINE, "bounds": {"low_deg": 1.0}}, "the key bounds.high_deg is missing; add it"),
        ({"line": LINE, "bounds": {"low_dg": 1.0}}, "the key bounds.low_dg is unknown; did you mean bounds.low_deg?"),
        (
            {"line": LINE, "bounds": {"low_deg": 1.0, "high_deg": 2.0, "unit": "deg"}},
            "the key bounds.unit is unknown; known here: low_deg, high_deg",
        ),
        ({"line": LINE, "name": 3}, 'name is a whole number, it must be text or "none"'),
        # Keys and texts that look like the path in a message of msgspec.
        ({"line": LINE, "zzz - at `$.light": 1}, "the key zzz - at `$.light is unknown"),
        ({"line": LINE, "light": {"side": "x - at `$.line`"}}, "light.side is 'x - at `$.line`', it must be one of"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_its_path(table: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=f"^{re.escape(said)}"):
        settings_from(table, Settings)


def test_what_is_no_table_holds_no_settings() -> None:
    with pytest.raises(ConfigError, match=r"^the file is a list, it must be a table$"):
        settings_from([], Settings)


def test_keys_that_only_another_version_knows_are_left_out_of_a_record() -> None:
    line = {"driver": "line", "port": "/dev/ttyUSB0", "baud": 9600}
    lights = [{"pulses": 4}, {"pulses": 8, "colour": {"name": "red"}, "`, - at `$.line`": 1}]
    text = msgspec.json.encode({"line": line, "lights": lights, "newer": None})
    found = recorded_settings(text, Settings | None)
    assert found == Settings(line=Line(port="/dev/ttyUSB0"), lights=[Light(pulses=4), Light(pulses=8)])


@pytest.mark.parametrize(
    "text", [b"{", b"[]", b'{"line": {"driver": "other"}}', b'{"newer": 1}', b'{"line": {"driver": "line", "port": 1}}']
)
def test_a_record_of_other_settings_is_refused(text: bytes) -> None:
    with pytest.raises(msgspec.MsgspecError):
        recorded_settings(text, Settings)


def test_a_table_without_keys_of_its_own_says_so():
    with pytest.raises(ConfigError, match=r"^the key stage\.zero is unknown; no further key is known here$"):
        nearest_key("zero", (), prefix="stage.")
