"""Least errors that searches can have: ``python -m benchmarks.bounds [STUDY.toml] [--markers 60] [--out FOLDER]``.

Without a study: Van Trees' bound on the mean error in the benchmark's worlds of one point. With one: each of its
policies against the bound of the first markers, and with ``--out`` its picture with the bound beside the errors.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.bounds.markers import compare_with_bound, mean_bounds
from markerseek.pictures import save_figure
from markerseek.studies import WORLDS, PolicySettings, Study, cells, error_figure, read_study, run_study

ACQUISITIONS = 8, 16
"""Numbers of acquisitions for which the benchmark's bounds are computed."""


def of_benchmark(markers: int) -> None:
    """Print the bounds of the benchmark's worlds of one point; intensities alone have no distances, and no bound."""
    for world in WORLDS:
        if world.name == "one" and world.tier != "intensities":
            study = world.study("bound", (PolicySettings(method="posterior"),), searches=markers)
            errors_deg = mean_bounds(study, cells(study)[0], markers=markers, acquisitions=ACQUISITIONS)
            for count, error_deg in zip(ACQUISITIONS, errors_deg, strict=True):
                print(f"{world.tier}: {count} acquisitions, mean error {error_deg:.3f} deg or more, {markers} markers")


def of_study(study: Study, markers: int, out: Path | None, beside: list[Path]) -> None:
    """Print the errors of each policy beside the bounds, and draw them."""
    bounds = {}
    for cell in cells(study):
        print(f"cell {cell.index}: {', '.join(f'{key} = {value}' for key, value in cell.varied)}")
        for number in range(len(study.policies)):
            each = compare_with_bound(study, cell, policy=number, markers=min(markers, study.trials))
            print(
                f"  {each.label}: {each.markers} markers, rmse {each.rmse_deg:.3g} deg; bound for the best angles "
                f"{each.best_deg:.3g} deg (ratio {each.ratio_to_best:.3g}), for those taken {each.taken_deg:.3g} deg "
                f"(ratio {each.ratio_to_taken:.3g})"
            )
        if out is not None and study.marks:
            bounds[cell.index] = study.marks, mean_bounds(study, cell, markers=markers, acquisitions=study.marks)
    if out is not None:
        others = [(read_study(path), Path("out") / path.stem) for path in beside]
        runs = [(each, run_study(each, folder).summary) for each, folder in ((study, out), *others)]
        figure = error_figure(runs, bounds=bounds)
        for name in ("error.png", "error.svg"):
            save_figure(figure, out / name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, nargs="?")
    parser.add_argument("--markers", type=int, default=60)
    parser.add_argument("--out", type=Path, help="folder of the study")
    parser.add_argument("--beside", type=Path, action="append", default=[], help="another study, drawn too")
    given = parser.parse_args()
    if given.study is None:
        of_benchmark(given.markers)
    else:
        of_study(read_study(given.study), given.markers, given.out, given.beside)
