"""Layout of pictures: nothing clipped, nothing overlapping, no name rendered as mathematics."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import (
    Ambiguous,
    Estimate,
    Floor,
    Found,
    FrameHeader,
    Interval,
    NotFound,
    PaImage,
    Reading,
    ReadingFrame,
    Sample,
)

pytest.importorskip("matplotlib", reason="needs the extra plot")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from markerseek.show import (
    Curve,
    bank_figure,
    frame_figure,
    png_data_uri,
    search_figure,
    write_page,
)

LONG = (
    r"posterior on a replayed rig: /data/a folder of recordings, " * 4 + r"named $\notacommand$ and $x_1$ by somebody"
)
FLOOR = Floor(level=130.0, source="dark frames")
FOUND = Found(
    mean_deg=0.8,
    sigma_deg=0.1,
    interval95_deg=Interval(low_deg=0.6, high_deg=1.0),
    interval_kind="posterior",
    floor=FLOOR,
)


def sample(angle_deg: float, intensity: float) -> Sample:
    header = FrameHeader(
        sequence=0, token="", pulses=1, commanded_deg=angle_deg, started_s=0.0, ended_s=0.0,
    )  # fmt: skip
    reading = Reading(intensity=intensity)
    return Sample(angle_deg=angle_deg, reading=reading, frame=ReadingFrame(header=header, intensity=intensity))


def figure_of(
    samples: list[Sample],
    *,
    confirmation: Sample | None = None,
    density: Curve | None = None,
    recorded: Curve | None = None,
    estimate: Estimate | None = None,
    image: PaImage | None = None,
) -> Figure:
    unclaimed = NotFound(mean_deg=0.8, reason="made up", floor=FLOOR)
    figure = search_figure(
        samples,
        estimate or (FOUND if confirmation is not None else unclaimed),
        start_deg=0.0,
        truth_deg=0.83,
        reference_deg=None,
        confirmation=confirmation,
        image=image,
        limits=Interval(low_deg=-35.0, high_deg=35.0),
        density=density,
        recorded=recorded,
        stand_in="simulated rig",
    )
    FigureCanvasAgg(figure).draw()
    return figure


def test_a_confirmation_and_a_floor_above_all_acquisitions_are_inside_the_picture() -> None:
    confirmed = figure_of([sample(-3.0, 200.0), sample(2.0, 1000.0)], confirmation=sample(0.8, 2000.0))
    assert confirmed.axes[0].get_ylim()[1] > 2000
    quiet = figure_of([sample(-3.0, 40.0), sample(2.0, 60.0)])
    assert quiet.axes[0].get_ylim()[1] > 130


@pytest.mark.parametrize("count", [6, 28, 141])
def test_numbers_are_not_written_over_one_another_and_the_first_is_there(count: int) -> None:
    angles = np.linspace(-35, 35, count)
    figure = figure_of([sample(float(each), float(2000 * np.exp(-((each - 0.8) ** 2) / 9) + 90)) for each in angles])
    texts = [child for child in figure.axes[0].get_children() if isinstance(child, Annotation)]
    boxes = [text.get_window_extent() for text in texts]
    assert not [pair for pair in combinations(boxes, 2) if pair[0].overlaps(pair[1])]
    assert texts[0].get_text() == "1"
    assert min(count, 28) <= len(texts) <= count


def test_no_line_joins_what_was_measured_at_different_angles() -> None:
    axes = figure_of([sample(-3.0, 40.0), sample(2.0, 60.0), sample(5.0, 50.0)]).axes[0]
    assert all(len(set(line.get_xdata())) == 1 or len(set(line.get_ydata())) == 1 for line in axes.lines)


def test_the_axes_show_the_range_of_the_search_and_the_legend_lies_off_them() -> None:
    figure = figure_of([sample(-3.0, 40.0), sample(2.0, 60.0)])
    curve, track = figure.axes
    assert curve.get_xlim() == track.get_ylim() == pytest.approx((-36.4, 36.4))
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "simulated rig"
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)
    assert curve.get_ylabel().endswith("[as recorded]")


def test_a_number_beside_the_confirmation_is_not_under_its_star() -> None:
    figure = figure_of([sample(-3.0, 200.0), sample(0.9, 1990.0)], confirmation=sample(0.8, 2000.0))
    axes = figure.axes[0]
    (number,) = [text for text in axes.texts if text.get_text() == "2"]
    x, y = axes.transData.transform((0.8, 2000.0))
    # The star of 110 square points reaches about 6 points, 8.5 pixels, to each side.
    box = number.get_window_extent()
    assert box.x1 < x - 8 or box.y0 > y + 8


def test_without_a_confirmation_the_image_is_that_of_the_strongest_acquisition() -> None:
    image = PaImage(
        envelope=np.ones((4, 3), np.float32), lateral_m=np.linspace(-0.01, 0.01, 3), depth_m=np.linspace(0.01, 0.04, 4)
    )
    figure = figure_of([sample(-3.0, 40.0), sample(2.0, 60.0), sample(5.0, 50.0)], image=image)
    assert "image of the strongest acquisition, at 2.00°" in [axes.get_title() for axes in figure.axes]


def test_each_of_two_angles_that_may_be_the_markers_is_drawn_and_named() -> None:
    estimate = Ambiguous(mean_deg=-12.0, modes_deg=(-12.0, 14.0), floor=FLOOR)
    figure = figure_of([sample(-12.0, 900.0), sample(14.0, 890.0)], estimate=estimate)
    drawn = [line.get_xdata()[0] for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert drawn == [-12.0, 14.0]
    (legend,) = figure.legends
    assert "no marker is claimed; it may be at -12.00° or 14.00°" in [text.get_text() for text in legend.get_texts()]


def test_the_recorded_curve_and_the_density_of_the_posterior_are_drawn() -> None:
    angles = np.linspace(-35, 35, 141)
    heights = 3000 * np.exp(-((angles - 0.8) ** 2) / 9)
    per_deg = np.exp(-((angles - 0.8) ** 2))
    figure = figure_of([sample(2.0, 60.0)], recorded=(angles, heights), density=(angles, per_deg))
    curve, track, density = figure.axes
    assert curve.get_ylim()[1] > 3000
    np.testing.assert_array_equal(curve.lines[0].get_ydata(), heights)
    assert density.get_shared_x_axes().joined(density, curve)
    vertices = density.collections[0].get_paths()[0].vertices
    assert vertices[:, 1].max() == pytest.approx(per_deg.max())
    assert track.get_xlabel().startswith("acquisition")


def image() -> PaImage:
    return PaImage(
        envelope=np.ones((30, 20), np.float32), lateral_m=np.linspace(-0.02, 0.02, 20), depth_m=np.linspace(0, 0.08, 30)
    )


def frame_of(title: str) -> Figure:
    return frame_figure(image(), marks_m=[(0.0, 0.04)], title=title)


def bank_of(title: str) -> Figure:
    return bank_figure(
        [1.0, 2.0, 3.0], [1.0, 5.0, 2.0], title=title, max_deg=2.0, com_deg=2.1, cen_deg=2.0, fwhm_deg=1.0,
        reference_deg=None, dark_level=9.0, image=None,
    )  # fmt: skip


def narrow_frame_of(title: str) -> Figure:
    """Of 64 elements, 18 mm wide and 80 mm deep."""
    lateral_m = np.linspace(-0.009, 0.009, 20)
    narrow = PaImage(envelope=np.ones((30, 20), np.float32), lateral_m=lateral_m, depth_m=np.linspace(0, 0.08, 30))
    return frame_figure(narrow, marks_m=[(0.0, 0.04)], title=title)


@pytest.mark.parametrize("draw", [frame_of, narrow_frame_of, bank_of])
def test_a_long_title_is_broken_into_lines_that_fit_and_dollars_are_dollars(draw: object) -> None:
    figure: Figure = draw(LONG)  # type: ignore[operator]
    FigureCanvasAgg(figure).draw()
    heading = figure._suptitle
    box = heading.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width
    assert " ".join(heading.get_text().split()) == LONG


def test_a_page_holds_its_table_and_escapes_what_it_is_given(tmp_path: Path) -> None:
    figure = figure_of([sample(-3.0, 40.0), sample(2.0, 60.0)])
    assert figure._suptitle is None
    write_page(
        tmp_path / "page.html",
        "search.html.jinja",
        title="<b>",
        note=None,
        verdict={"word": "FOUND", "kind": "found", "angle": "−3.0°", "sigma": "", "lead": "", "interval": "<i>"}
        | {"reason": "", "next_step": ""},
        curve="<svg></svg>",
        facts=[("answer", "a < b")],
        picture_uri=png_data_uri(figure),
        alt="picture",
        rows=[("", "angle"), ("1", "2.000")],
        json="{}",
    )
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<h1>&lt;b&gt;</h1>" in text
    assert "<td>a &lt; b</td>" in text
    assert text.index("<strong>FOUND</strong>") < text.index("<table>")
    assert "&lt;i&gt;" in text
    assert "<svg></svg>" in text
    assert "<tr><th></th><th>angle</th></tr>\n<tr><td>1</td><td>2.000</td></tr>" in text
