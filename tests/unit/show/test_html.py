"""What a notebook shows and takes of results and banks: HTML with a picture, a DataFrame, a data set."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import markerseek
from markerseek.records.banks import read_arrays, read_bank
from markerseek.show import SearchResult, as_html, drawn_curve, with_minus

SCAN = Path(__file__).parents[3] / "examples" / "simulated_scan.csv"
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def result() -> SearchResult:
    return markerseek.find_marker(markerseek.replayed(SCAN, reference_deg=-8.25))


def test_a_result_shows_its_answer_and_every_acquisition(result: SearchResult) -> None:
    tree = ET.fromstring(result._repr_html_())
    cells = [cell.text for cell in tree.iter("td")]
    assert result.answer == "found"
    assert cells[:2] == ["found", f"{result.angle_deg:.3f}° ± {result.sigma_deg:.3f}°"]
    # Those of the search are dots, and of all angles of the recording there is a line.
    inset = tree.find(f".//{SVG}g[@class='ms-inset']")
    near = sum(abs(each.angle_deg - result.angle_deg) <= 2.0 for each in result.search.samples)
    assert len(list(inset.iter(f"{SVG}circle"))) == near > 1
    assert len(list(tree.iter(f"{SVG}circle"))) == result.search.acquisitions + near
    (recorded, _) = tree.iter(f"{SVG}polyline")
    assert len(recorded.get("points").split()) == result.acquisitions == 141
    assert tree.find("strong").text == "recording of 141 angles"


def test_the_search_of_a_recording_is_a_result_of_its_own(result: SearchResult) -> None:
    search = result.search
    assert search.search is None
    assert search.angle_deg != result.angle_deg
    curve = drawn_curve(search.run, reveal=False)
    assert [each.angle_deg for each in curve.answers] == [search.angle_deg]
    assert [each.angle_deg for each in curve.marks] == [each.angle_deg for each in search.samples]
    # The density at the end of the run is that of all angles.
    assert (curve.density_deg, curve.recorded_deg) == ((), ())
    assert f"acquisitions: {search.acquisitions}" in str(search).splitlines()


def test_a_result_that_is_printed_is_what_the_terminal_prints(result: SearchResult) -> None:
    heading, answer, angle, *_ = str(result).splitlines()
    assert heading == "recording of 141 angles"
    assert answer == "answer: found"
    assert angle == f"marker angle: {result.angle_deg:.3f}° ± {result.sigma_deg:.3f}°"
    assert str(result).splitlines()[1:] == [f"{name}: {value}" for name, value in result.rows]
    assert "None" not in str(result)


def test_markup_in_rows_is_escaped() -> None:
    tree = ET.fromstring(as_html("a & b", [("scanned", "<b>liver & co</b>"), ("nothing", None)], ""))
    assert [cell.text for cell in tree.iter("td")] == ["<b>liver & co</b>"]


def test_a_result_as_a_dataframe(result: SearchResult) -> None:
    pytest.importorskip("pandas", reason="needs the extra notebook")
    table = result.to_dataframe()
    assert table["angle_deg"].tolist() == [each.angle_deg for each in result.samples]
    assert table["intensity"].max() == max(each.reading.intensity for each in result.samples)
    assert (table.index.name, table.index[0], set(table["role"])) == ("acquisition", 1, {"search"})
    assert table.attrs["angle_deg"] == result.angle_deg


def test_banks_as_data_sets(tmp_path: Path) -> None:
    pytest.importorskip("xarray", reason="needs the extra notebook")
    bank = read_bank(SCAN)
    held = bank.to_xarray()
    assert held["intensity"].sel(angle_deg=-35.0).item() == bank.intensities[0]
    assert float(held["intensity"].idxmax()) == bank.angles_deg[int(np.argmax(bank.intensities))]
    frames = np.random.default_rng(1).integers(-9, 9, (3, 4, 20)).astype(np.int16)
    np.savez(tmp_path / "a.npz", angle_deg=[3.0, 1.0, 2.0], frames=frames, sampling_hz=40e6)
    of_frames = read_arrays(tmp_path / "a.npz").to_xarray()
    assert of_frames["frames"].dims == ("angle_deg", "channel", "time_s")
    np.testing.assert_array_equal(of_frames["frames"].sel(angle_deg=3.0), frames[0])
    assert of_frames["time_s"].values[-1] == pytest.approx(19 / 40e6)
    assert (of_frames.attrs["sampling_hz"], "intensity" in of_frames) == (40e6, False)


def test_progress_is_one_line_an_acquisition_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    rig = markerseek.replayed(SCAN)
    result = markerseek.find_marker(rig, method="ternary", progress=True)
    printed = capsys.readouterr()
    assert result.search is not None
    assert (printed.out, result.search.method) == ("", "ternary")
    lines = [line for line in printed.err.splitlines() if line.startswith("acquisition ")]
    # Those of the search, then the angles that it left.
    left = {each.angle_deg for each in result.samples} - {each.angle_deg for each in result.search.samples}
    assert len(lines) == result.search.acquisitions + len(left)
    assert with_minus(f"{result.search.samples[0].angle_deg:.3f}°") in lines[0]
