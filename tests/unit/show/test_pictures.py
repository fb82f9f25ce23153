"""Figures of frames and banks, and pages: nothing clipped, no name rendered as mathematics, everything escaped."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import PaImage

pytest.importorskip("matplotlib", reason="needs the extra plot")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from markerseek.show import frame_figure, peak_figure, png_data_uri, write_page

LONG = (
    r"posterior on a replayed rig: /data/a folder of recordings, " * 4 + r"named $\notacommand$ and $x_1$ by somebody"
)


def image() -> PaImage:
    return PaImage(
        envelope=np.ones((30, 20), np.float32), lateral_m=np.linspace(-0.02, 0.02, 20), depth_m=np.linspace(0, 0.08, 30)
    )


def frame_of(title: str) -> Figure:
    return frame_figure(image(), marks_m=[(0.0, 0.04)], title=title)


def bank_of(title: str) -> Figure:
    return peak_figure(
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
    figure = frame_of("a frame")
    write_page(
        tmp_path / "page.html",
        "search.html.jinja",
        title="<b>",
        note=None,
        verdict={"word": "FOUND", "kind": "found", "angle": "−3.0°", "sigma": "", "lead": "", "interval": "<i>"}
        | {"reason": "why", "next_step": ""},
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
    # A sentence each, and none that is empty.
    assert re.findall(r"<p>(.*)</p>", text) == ["&lt;i&gt;", "why"]
    assert "<svg></svg>" in text
    assert "<tr><th></th><th>angle</th></tr>\n<tr><td>1</td><td>2.000</td></tr>" in text
