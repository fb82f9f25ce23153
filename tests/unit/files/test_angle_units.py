"""Units of angles in the names of columns, variables and files: read, or named as no unit of an angle."""

from __future__ import annotations

import pytest

from markerseek.files import DEG_PER, AngleUnit, angle_in, series_indices, unit_in


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("angle_deg", "deg"),
        ("Winkel [°]", "deg"),
        ("Angle(Degrees)", "deg"),
        ("angleDeg", "deg"),
        ("angledeg", "deg"),
        ("encoder angle [deg]", "deg"),
        ("step_deg", "deg"),
        ("angle (probe, deg)", "deg"),
        ("m°", "mdeg"),
        ("stage (millidegrees)", "mdeg"),
        ("theta / rad", "rad"),
        ("probeAngleRad", "rad"),
        ("mRad", "mrad"),
        ("angle in mrad", "mrad"),
        ("angle [\N{MICRO SIGN}rad]", "urad"),
        ("angle [\N{GREEK SMALL LETTER MU}rad]", "urad"),
        ("angle [Gon]", "gon"),
        ("angle [']", "arcmin"),
        ("tilt_arcsec", "arcsec"),
        ("rotation_turns", "turn"),
        ("motor [rev.]", "turn"),
    ],
)
def test_a_unit_of_angle_is_read(name: str, unit: AngleUnit) -> None:
    named = unit_in(name)
    assert (named.unit, named.other, named.is_angle) == (unit, "", True)


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("angle [steps]", "steps"),
        ("encoder_counts", "counts"),
        ("pos [mm]", "mm"),
        ("position_mm", "mm"),
        ("stage_m", "m"),
        ("Winkel [Grad]", "Grad"),
        ("angle [0.1 deg]", "0.1 deg"),
        ("angle (1/100 deg)", "1/100 deg"),
        ("rate [deg/s]", "deg/s"),
        ("angle [foo]", "foo"),
        ("angle_deg_rad", "deg and rad"),
        ("angle_deg [rad]", "deg and rad"),
        ("frame", "frame"),
    ],
)
def test_another_unit_is_named(name: str, other: str) -> None:
    named = unit_in(name)
    assert (named.unit, named.other) == (None, other)


@pytest.mark.parametrize("name", ["angle", "Winkel", "angle (measured)", "Motor", "angle_s", "angle_v2", "", "1"])
def test_a_name_without_a_unit_names_none(name: str) -> None:
    named = unit_in(name)
    assert (named.unit, named.other) == (None, "")


def test_a_turn_is_as_long_in_every_unit() -> None:
    of_a_turn = {"mdeg": 360_000, "rad": 6.283185307, "mrad": 6283.185307, "urad": 6283185.307, "gon": 400}
    of_a_turn |= {"arcmin": 21_600, "arcsec": 1_296_000, "turn": 1, "deg": 360}
    assert {unit: count * DEG_PER[unit] for unit, count in of_a_turn.items()} == pytest.approx(  # type: ignore[index]
        dict.fromkeys(DEG_PER, 360.0)
    )


@pytest.mark.parametrize(
    ("name", "angle_deg", "stated"),
    [
        ("frame_017", 17.0, False),
        ("17", 17.0, False),
        ("frame_17deg", 17.0, True),
        ("winkel_17", 17.0, True),
        ("-17", -17.0, True),
        ("17.5", 17.5, True),
        ("scan_100gon", 90.0, True),
        ("scan_500_mrad", 28.6479, True),
    ],
)
def test_a_number_in_a_name_is_stated_by_a_word_a_sign_a_decimal_or_a_unit(
    name: str, angle_deg: float, stated: bool
) -> None:
    found = angle_in(name)
    assert found is not None
    assert (found.angle_deg, found.stated) == (angle_deg, stated)


def test_files_keep_the_places_of_those_that_are_missing() -> None:
    assert series_indices(["f_7", "f_8", "f_11"]) == ([0, 1, 2], [])
    assert series_indices(["f_07", "f_08", "f_10"]) == ([0, 1, 3], [9])
    assert series_indices(["f_1", "f_100", "f_200"]) == ([0, 1, 2], [])
    assert series_indices(["a", "b"]) == ([0, 1], [])
