"""A curve as SVG: what lies where, and what is left out."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from markerseek.show import DrawnAngle, DrawnCurve, DrawnInterval, Mark, curve_svg

SVG = "{http://www.w3.org/2000/svg}"


def tree_of(angles_deg: list[float], intensities: list[float], **known: Any) -> ET.Element:
    marks = [Mark(angle_deg=at, intensity=each) for at, each in zip(angles_deg, intensities, strict=True)]
    ends = {"low_deg": -10.0, "high_deg": 20.0}
    return ET.fromstring(curve_svg(DrawnCurve(marks=tuple(marks), **ends | known)))


def texts_of(tree: ET.Element) -> dict[str, ET.Element]:
    return {text.text: text for text in tree.iter(f"{SVG}text")}


def test_dots_lie_where_the_numbers_say() -> None:
    """On straight lines through both axes: equal steps of angle and intensity are equal steps of pixels."""
    tree = tree_of([-10.0, 0.0, 10.0, 20.0], [0.0, 1.0, 2.0, 4.0])
    dots = [(float(dot.get("cx")), float(dot.get("cy"))) for dot in tree.iter(f"{SVG}circle")]
    steps = np.diff(dots, axis=0)
    np.testing.assert_allclose(steps[:, 0], steps[0, 0], atol=0.11)
    np.testing.assert_allclose(steps[:, 1] / [1, 1, 2], steps[0, 1], atol=0.11)
    assert steps[0, 0] > 0 > steps[0, 1]
    ticks = texts_of(tree)
    assert float(ticks["−10"].get("x")) == pytest.approx(dots[0][0], abs=0.1)
    assert float(ticks["20"].get("x")) == pytest.approx(dots[3][0], abs=0.1)


def test_the_size_of_a_dot_is_its_weight_in_a_weighted_average() -> None:
    marks = tuple(Mark(angle_deg=at, intensity=1.0, weight=weight) for at, weight in ((0.0, 0.0), (5.0, 1.0)))
    tree = ET.fromstring(curve_svg(DrawnCurve(marks=marks, low_deg=-10.0, high_deg=10.0)))
    light, heavy = (float(dot.get("r")) for dot in tree.iter(f"{SVG}circle"))
    assert 0 < light < heavy


@pytest.mark.parametrize(("is_claimed", "dashes"), [(True, ""), (False, "8 4")])
def test_the_answer_is_a_line_with_its_angle_solid_if_it_is_claimed(is_claimed: bool, dashes: str) -> None:
    answer = DrawnAngle(angle_deg=5.0, text="5.00°")
    others = (DrawnAngle(angle_deg=-8.0, text="−8.00°?"), DrawnAngle(angle_deg=5.5, text="5.50°?"))
    tree = tree_of([5.0], [2.0], answers=(answer,), is_claimed=is_claimed, others=others)
    x = tree.find(f"{SVG}circle").get("cx")
    (line,) = [
        path for path in tree.iter(f"{SVG}path") if path.get("d").startswith(f"M{x} ") and path.get("stroke-width")
    ]
    assert line.get("stroke-dasharray") == dashes
    # A label that would lie on that of the answer is left out.
    assert {"5.00°", "−8.00°?"} <= texts_of(tree).keys()
    assert "5.50°?" not in texts_of(tree)


@pytest.mark.parametrize(("width_deg", "is_drawn"), [(0.5, True), (10.0, False)])
def test_an_answer_that_is_one_line_has_an_inset(width_deg: float, is_drawn: bool) -> None:
    interval = DrawnInterval(low_deg=5.0 - width_deg / 2, high_deg=5.0 + width_deg / 2, text="95 % interval")
    known: dict[str, Any] = {"answers": (DrawnAngle(angle_deg=5.0, text="5.00°"),), "interval": interval}
    tree = tree_of([-5.0, 4.0], [1.0, 2.0], **known)
    inset = tree.find(f".//{SVG}g[@class='ms-inset']")
    assert (inset is not None) == is_drawn
    if inset is not None:
        # Of both dots only one lies within 2 degrees.
        assert len(list(inset.iter(f"{SVG}circle"))) == 1


def test_the_density_fills_the_height_and_has_an_axis() -> None:
    tree = tree_of([0.0], [3.0], density_deg=(-1.0, 0.0, 1.0), density_per_deg=(0.0, 0.8, 0.0))
    (area,) = [path for path in tree.iter(f"{SVG}path") if path.get("class") == "ms-density"]
    heights = [float(point.split()[1]) for point in area.get("d")[1:-1].split("L")]
    # From the bottom of the frame, at 282, up to some pixels below its top, at 34.
    assert max(heights) == 282
    assert 34 < min(heights) < 50
    assert "probability [1/deg]" in texts_of(tree)
    assert "probability [1/deg]" not in texts_of(tree_of([0.0], [3.0]))
