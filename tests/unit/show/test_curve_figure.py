"""A curve as a figure: nothing clipped, nothing overlapping, nothing joined that was not measured."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest

from markerseek.core import PaImage, Reading, Sample

pytest.importorskip("matplotlib", reason="needs the extra plot")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from markerseek.show import (
    DrawnAngle,
    DrawnCurve,
    DrawnInterval,
    Mark,
    Threshold,
    comparison_figure,
    curve_figure,
)

TRUTH = DrawnAngle(angle_deg=0.83, text="truth 0.83°")
FOUND: dict[str, Any] = {
    "answers": (DrawnAngle(angle_deg=0.8, text="0.80°"),),
    "answer_text": "marker at 0.80°",
    "is_claimed": True,
    "interval": DrawnInterval(low_deg=0.6, high_deg=1.0, text="95 % interval (posterior)"),
}


def curve_of(*places: tuple[float, float], confirmation: tuple[float, float] | None = None, **known: Any) -> DrawnCurve:
    """A curve with an acquisition at each angle and intensity."""
    marks = [Mark(angle_deg=at, intensity=each, text=str(n)) for n, (at, each) in enumerate(places, start=1)]
    if confirmation is not None:
        marks.append(Mark(angle_deg=confirmation[0], intensity=confirmation[1], role="confirmation", text="✓"))
    usual = {
        "low_deg": -35.0,
        "high_deg": 35.0,
        "start_deg": 0.0,
        "unit": "as recorded",
        "known": TRUTH,
        "threshold": Threshold(level=130.0, text="detection threshold (dark frames)"),
        "stand_in": "simulated rig",
    }
    return DrawnCurve(marks=tuple(marks), **usual | known)


def drawn(curve: DrawnCurve, **image: Any) -> Figure:
    figure = curve_figure(curve, **image)
    FigureCanvasAgg(figure).draw()
    return figure


def legend_of(figure: Figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def test_a_confirmation_and_a_threshold_above_all_acquisitions_are_inside_the_picture() -> None:
    confirmed = drawn(curve_of((-3.0, 200.0), (2.0, 1000.0), confirmation=(0.8, 2000.0), **FOUND))
    assert confirmed.axes[0].get_ylim()[1] > 2000
    quiet = drawn(curve_of((-3.0, 40.0), (2.0, 60.0)))
    assert quiet.axes[0].get_ylim()[1] > 130


@pytest.mark.parametrize("count", [6, 28, 141])
def test_numbers_are_not_written_over_one_another_and_the_first_is_there(count: int) -> None:
    angles = np.linspace(-35, 35, count)
    figure = drawn(curve_of(*((float(at), float(2000 * np.exp(-((at - 0.8) ** 2) / 9) + 90)) for at in angles)))
    texts = [child for child in figure.axes[0].get_children() if isinstance(child, Annotation)]
    boxes = [text.get_window_extent() for text in texts]
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    assert texts[0].get_text() == "1"
    assert min(count, 28) <= len(texts) <= count


def test_no_line_joins_what_was_measured_at_different_angles() -> None:
    axes = drawn(curve_of((-3.0, 40.0), (2.0, 60.0), (5.0, 50.0))).axes[0]
    assert all(len(set(line.get_xdata())) <= 1 or len(set(line.get_ydata())) == 1 for line in axes.lines)


def test_the_axes_show_the_range_of_the_search_and_the_legend_lies_off_them() -> None:
    figure = drawn(curve_of((-3.0, 40.0), (2.0, 60.0)))
    curve, track = figure.axes
    assert curve.get_xlim() == track.get_ylim() == pytest.approx((-36.4, 36.4))
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "simulated rig"
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)
    assert curve.get_ylabel() == "intensity [as recorded]"


def test_a_number_beside_the_confirmation_is_not_under_its_star() -> None:
    figure = drawn(curve_of((-3.0, 200.0), (0.9, 1990.0), confirmation=(0.8, 2000.0), **FOUND))
    axes = figure.axes[0]
    (number,) = [text for text in axes.texts if text.get_text() == "2"]
    x, y = axes.transData.transform((0.8, 2000.0))
    # The star of 110 square points reaches about 6 points, 8.5 pixels, to each side.
    box = number.get_window_extent()
    assert box.x1 < x - 8 or box.y0 > y + 8


def test_the_track_goes_from_the_start_through_all_acquisitions_in_their_order() -> None:
    track = drawn(curve_of((-3.0, 200.0), (2.0, 900.0), confirmation=(0.8, 950.0), **FOUND)).axes[1]
    (way,) = [line for line in track.lines if line.get_drawstyle() == "steps-mid"]
    np.testing.assert_array_equal(way.get_xdata(), [0, 1, 2, 3])
    np.testing.assert_array_equal(way.get_ydata(), [0.0, -3.0, 2.0, 0.8])


def test_without_a_confirmation_the_image_is_that_of_the_strongest_acquisition() -> None:
    image = PaImage(
        envelope=np.ones((4, 3), np.float32), lateral_m=np.linspace(-0.01, 0.01, 3), depth_m=np.linspace(0.01, 0.04, 4)
    )
    pictured = Sample(angle_deg=-2.0, reading=Reading(intensity=60.0, lateral_m=0.0, depth_m=0.02))
    figure = drawn(curve_of((-3.0, 40.0), (-2.0, 60.0)), pictured=pictured, image=image)
    (panel,) = [axes for axes in figure.axes if axes.get_title() == "image of the strongest acquisition, at −2.00°"]
    # Only what is claimed has a ring.
    assert not panel.lines
    claimed = drawn(curve_of((-3.0, 40.0), confirmation=(-2.0, 60.0), **FOUND), pictured=pictured, image=image)
    (panel,) = [axes for axes in claimed.axes if axes.get_title() == "photoacoustic image at −2.00°"]
    assert panel.lines[0].get_xydata().tolist() == [[0.0, 20.0]]


def test_an_angle_is_solid_only_if_it_is_claimed() -> None:
    claimed = drawn(curve_of((2.0, 900.0), **FOUND)).axes[0]
    assert [line.get_xdata()[0] for line in claimed.lines if line.get_linestyle() == "-"] == [0.8]
    either = (DrawnAngle(angle_deg=-12.0, text="−12.00°?"), DrawnAngle(angle_deg=14.0, text="14.00°?"))
    said = "no marker is claimed; it may be at −12.00° or 14.00°"
    others = (DrawnAngle(angle_deg=30.0, text="30.00°?"),)
    figure = drawn(curve_of((-12.0, 900.0), (14.0, 890.0), answers=either, answer_text=said, others=others))
    dashed = [line.get_xdata()[0] for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert dashed == [-12.0, 14.0, 30.0]
    assert {said, "other source"} <= set(legend_of(figure))


def test_what_is_said_where_nothing_was_detected_stands_in_the_legend() -> None:
    figure = drawn(curve_of((-3.0, 40.0), answer_text="no marker was detected", known=None))
    assert "no marker was detected" in legend_of(figure)
    assert {line.get_linestyle() for line in figure.axes[0].lines} == {":", "None"}


def test_the_recorded_curve_and_the_density_of_the_posterior_are_drawn() -> None:
    angles = np.linspace(-35, 35, 141)
    heights = 3000 * np.exp(-((angles - 0.8) ** 2) / 9)
    per_deg = np.exp(-((angles - 0.8) ** 2))
    figure = drawn(
        curve_of(
            (2.0, 60.0),
            recorded_deg=tuple(angles),
            recorded=tuple(heights),
            density_deg=tuple(angles),
            density_per_deg=tuple(per_deg),
        )
    )
    curve, track, density = figure.axes
    assert curve.get_ylim()[1] > 3000
    np.testing.assert_array_equal(curve.lines[0].get_ydata(), heights)
    assert density.get_shared_x_axes().joined(density, curve)
    vertices = density.collections[0].get_paths()[0].vertices
    assert vertices[:, 1].max() == pytest.approx(per_deg.max())
    assert track.get_xlabel() == "acquisition of a search (0: start)"


def test_searches_are_compared_by_what_they_claim() -> None:
    found = curve_of((-3.0, 40.0), (1.0, 800.0), confirmation=(0.8, 900.0), **FOUND)
    unsure = curve_of((5.0, 300.0), answers=(DrawnAngle(angle_deg=5.0, text="5.00°"),))
    nothing = curve_of((7.0, 90.0))
    figure = comparison_figure([("posterior", found), ("ternary", unsure), ("golden", nothing)], title="a rig")
    FigureCanvasAgg(figure).draw()
    assert legend_of(figure) == [
        "posterior, 2 acquisitions: 0.80°",
        "ternary, 1 acquisitions: 5.00° (not claimed)",
        "golden, 1 acquisitions: nothing detected",
        "truth 0.83°",
    ]
