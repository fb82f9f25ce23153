"""``markerseek reproduce`` as a user types it: files, numbers, progress, and messages for wrong input."""

from __future__ import annotations

import csv
import html
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from markerseek.records.banks import IntensityBank, read_bank
from markerseek.records.banks.table import write_bank
from markerseek.wire.sonixdaq import encode_file

pytest.importorskip("matplotlib")


Shell = Callable[..., tuple[int, str, str]]


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


EXAMPLE = Path(__file__).parents[2] / "examples" / "simulated_scan.csv"


def test_a_users_own_bank_takes_the_place_of_the_simulated_ones(shell: Shell, tmp_path: Path) -> None:
    """A symmetric curve without noise: TS and GSS answer as without noise, WA as NumPy's average.

    Its tails are no wider than a usual curve's: those of 16° fill the range, and pass for the noise floor of a bank
    without dark frames.
    """
    angles = np.linspace(-35, 35, 141)
    intensities = 1 / (1 + ((angles - 6.2) / 4) ** 2)
    bank = tmp_path / "mine.csv"
    write_bank(IntensityBank(angles_deg=tuple(angles.tolist()), intensities=tuple(intensities.tolist())), bank)
    assert read_bank(bank).angles_deg == tuple(angles.tolist())
    words = ("reproduce", "fig6", "--bank", bank, "--reference-deg", 6.2, "--out", tmp_path, "--workers", 1)
    code, said, _ = shell(*words)
    assert "TS after 16 acquisitions, error" in " ".join(said.split())
    assert max(map(len, said.splitlines()[:-1])) <= 80
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"Searches on your own bank {bank}" in page
    assert "Simulated" not in page
    (made,) = json.loads(shell(*words, "--json")[1])["sections"]
    assert {row["number"].split()[0] for row in made["numbers"]} == {"TS", "GSS", "WA"}
    assert all(row["ours"] >= 0 and row["paper"] is None for row in made["numbers"])
    assert code == 0
    errors = {(row["method"], int(row["acquisitions"])): row for row in rows_of(tmp_path / "fig6_searches.csv")}
    assert float(errors["TS", 28]["error_deg"]) < 70 * (2 / 3) ** 14
    assert float(errors["GSS", 28]["error_deg"]) < 0.3
    asked = np.round(np.linspace(-35, 35, 16) * 1919.6418578623391) / 1919.6418578623391
    at = np.interp(asked, angles, intensities)
    kept = at >= 0.2 * at.max()
    expected = np.average(asked[kept], weights=at[kept])
    assert float(errors["WA", 16]["angle_deg"]) == pytest.approx(expected, abs=1e-6)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the user's own" in html.unescape(page)


def make_frames(folder: Path) -> None:
    """A folder of channel data, of three angles."""
    for angle_deg in (1, 2, 3):
        here = folder / f"angle_{angle_deg}deg"
        here.mkdir(parents=True)
        for number in range(128):
            (here / f"CH{number:03d}.daq").write_bytes(encode_file(np.zeros((1, 2080), np.int16), number=number))


@pytest.mark.long
@pytest.mark.usefixtures("unchecked_shapes")
def test_fig_5_has_all_numbers_of_acquisitions(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("reproduce", "fig5", "--markers", 16, "--workers", 1, "--out", tmp_path, "--json")
    assert code == 0
    (section,) = json.loads(out)["sections"]
    assert [number["paper"] is not None for number in section["numbers"]] == 2 * 3 * [True]
    rows = rows_of(tmp_path / "fig5.csv")
    assert len(rows) == 2 * (14 + 14 + 21)


@pytest.mark.long
def test_fig_9_stands_beside_the_paper_with_strip_and_curve(shell: Shell, tmp_path: Path) -> None:
    code, out, _ = shell("reproduce", "fig9", "--markers", 10, "--workers", 1, "--out", tmp_path, "--json")
    assert code == 0
    (section,) = json.loads(out)["sections"]
    ours = {number["condition"]: number["ours"] for number in section["numbers"]}
    assert all(number["paper"] == 4.33 for number in section["numbers"])
    halves = [ours[f"tip {level} dB over the tissue"] for level in (20, 30, 40)]
    # A stronger echo is seen farther; all stay below the angle at which the beam is at -50 dB.
    assert 0 < halves[0] < halves[1] < halves[2] < 8
    with (tmp_path / "fig9.csv").open() as file:
        middle = [row for row in csv.DictReader(file) if float(row["x_mm"]) == 0]
    grey = [float(row["grey_value"]) for row in middle if row["seen"] == "yes"]
    assert grey == sorted(grey, reverse=True)
    assert middle[-1]["seen"] == middle[-2]["seen"] == "no"
    assert (tmp_path / "fig9.png").exists()
    assert (tmp_path / "fig9.svg").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fig10",), "'fig10' is unknown; there are: fig5, fig6"),
        (("fig5", "--markers", 3), "between 10 and"),
        (("fig5", "--seed", -1), "seed is -1, it must be 0 or more"),
        (("fig5", "--workers", 0), "--workers is '0'"),
        (("fig7", "--bank", EXAMPLE), "uses no bank"),
        (("fig6", "--reference-deg", 3), "give --bank too"),
        (("fig6", "--bank", "missing.csv"), "there is no such file"),
        (("fig6", "--bank", "frames"), "the bank holds frames, and intensities are needed; 'markerseek bank export"),
    ],
)
def test_wrong_usage_is_met_with_a_sentence(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if "frames" in words:
        make_frames(Path("frames"))
    code, out, err = shell("reproduce", *words, "--out", tmp_path / "out", "--json")
    assert code == 2
    assert said in json.loads(out)["error"]
    assert said in " ".join(err.split())
    if "missing.csv" not in words:
        assert "into" not in err, "work was announced that is not done"


def test_an_out_that_cannot_be_written_is_met_with_a_sentence(shell: Shell, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    code, _, err = shell("reproduce", "fig5", "--markers", 10, "--workers", 1, "--out", blocked)
    assert code == 2
    assert "choose another folder" in err
