"""Table 2's setting on the tissues: every tissue and method, in degrees and millimetres, beside the paper's numbers."""

from __future__ import annotations

import math
from itertools import islice

import pytest

from markerseek.studies.paper import RunOptions, paper_number
from markerseek.studies.paper import tissues as module
from markerseek.studies.paper.online import visits

TISSUES = ("Bovine Liver", "Bovine Muscle", "Chicken Breast", "Bovine Muscle +ICG")


def test_each_tissue_has_the_paper_s_methods_and_the_posterior_as_the_command_runs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "visits", lambda options: islice(visits(options), 2))
    section = module.tissues(RunOptions(markers=10))
    (table,) = section.tables
    rows = {row[:2]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert list(rows) == [(tissue, method) for tissue in TISSUES for method in module.METHODS]
    for (_, method), row in rows.items():
        assert row["searches"] == 2
        # A degree is about a millimetre at the marker, 60 mm and a little more from the axis.
        assert row["mean_error_mm"] == pytest.approx(math.radians(row["mean_error_deg"]) * 62, rel=0.15)
        assert row["rms_error_mm"] >= 0.999 * row["mean_error_mm"]
        if method == "posterior, survey":
            assert row["found"] == 1 - row["share_without_a_claim"]
            assert row["mean_error_mm"] < 0.6
            assert row["acquisitions"] < 16
            assert row["intervals_that_cover"] in (0.0, 0.5, 1.0)
        else:
            assert row["found"] == 1.0
            assert row["acquisitions"] == (16 if method in ("TS", "GSS") else pytest.approx(10, abs=5))
    beside = [each.paper for each in section.comparisons if each.paper.value is not None]
    assert beside == [paper_number(f"table1/{name}/{tissue}") for tissue in TISSUES for name in ("TS", "GSS", "WA")]
