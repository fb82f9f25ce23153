"""Leave parts of the posterior search out in turn, and print the tables of ``ablation.md``.

``python docs/validation/measure_ablation.py readings 60``: the heights of a spot in so many searches of each tissue,
and the laser's energy without its meter. ``python docs/validation/measure_ablation.py layers 12``: the layers of the
decision in so many searches of each world, and up to eight times as many where most of them count.
``python docs/validation/measure_ablation.py made 40``: the same layers in worlds that are made for some of them.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np
from measure_spots import percent
from msgspec import structs

from markerseek.core import SpotEnergy
from markerseek.signals import beamform, features, focus, spot
from markerseek.signals._kernel import PAD, aligned_energies
from markerseek.sim.world import World, digitise
from markerseek.studies import Cell, Mean, Row, Study, cells, default_workers, read_study, run_trial, summarise

SEED = 77124  # of no study's file
HERE, READER, AS_IT_IS = "markerseek.search.posterior.", "markerseek.signals.reader.", "as it is"

# By the name under which the search looks it up, with what it says where there is nothing to say.
FUNCTIONS: dict[str, tuple[str, object]] = {
    "a source not resolved yet comes first (`unresolved_rival`)": ("answer.unresolved_rival", None),
    "a top hidden in a gap (`missed_peak_deg`)": ("answer.missed_peak_deg", None),
    "a sample stronger than one nearer to the answer (`asymmetric_sample`)": ("answer.asymmetric_sample", None),
    "the dip between two peaks (`dip_deg`)": ("answer.dip_deg", None),
    "the predictive check (`predictive_check`)": ("answer.predictive_check", None),
    "bursts (`is_burst`)": ("answer.is_burst", False),
    "flat background (`is_background`)": ("answer.is_background", False),
    "the confirmation (`weaker_than_predicted`)": ("policy.weaker_than_predicted", None),
}


class Channels:
    """Energy along the wavefront over the channels, added without phase; its share in the mean with the image's."""

    def __init__(self, share: float) -> None:
        self.share = share

    def coherence(self, signals: Any, preset: Any, **place: Any) -> float | None:
        """The coherence as it is, which is computed first; keeps the signals."""
        self.signals, self.preset = signals, preset
        return focus.focused_coherence(signals, preset, **place)

    def energy(self, envelope: Any, **image: Any) -> SpotEnergy | None:
        """The energy about the centroid of that in the image, less what noise gives."""
        of_image, preset, signals = spot.spot_energy(envelope, **image), self.preset, self.signals
        if of_image is None:
            return None
        depth_m, (per_metre, origin) = of_image.depth_m, beamform.path_delay(preset)
        half = 2 * round(spot.HALF_DEPTH_M * per_metre / 2)
        aperture_m = beamform.half_aperture_m(preset, np.array([depth_m]), at_least=features.MIN_CHANNELS / 2)[0]
        wave = np.array([of_image.lateral_m]), np.array([per_metre]), (depth_m * per_metre, origin)
        of_sum, whole, used = np.empty(1), np.empty(1), np.empty(1, np.int64)
        aligned_energies(signals, preset.array.lateral_m, *wave, half, float(aperture_m), of_sum, whole, used)
        sigma = float(np.median(np.abs(signals[::8, PAD : PAD + preset.array.elements : 4]))) / 0.6745
        noise = (half + 1) * int(used[0]) * sigma**2
        power = float(whole[0]) - noise
        # Every second sample counts, and noise changes in one over twice the bandwidth.
        alike = max(1.0, preset.sampling_hz / 4 / (preset.high_hz - preset.low_hz))
        relative = sigma * math.sqrt(alike * (power + noise / 2)) / power if power > 0 else math.inf
        if relative > spot.LARGEST_RELATIVE_SIGMA:
            return None
        height = power ** (self.share / 2) * of_image.amplitude ** (1 - self.share)
        return structs.replace(of_image, amplitude=height, relative_sigma=relative)


LAYERS: dict[str, dict[str, object]] = {
    part: {HERE + name: lambda *_, said=said, **__: said} for part, (name, said) in FUNCTIONS.items()
}
LAYERS |= {
    "the survey below 2 % of what may hide (`WORTH`)": {HERE + "policy.WORTH": math.inf},
    "the survey, and the veto of what may hide": {
        HERE + "answer.STATED": 1.0,
        HERE + "policy.Posterior._is_surveyed_further": lambda *_: False,
    },
}
HEIGHTS: dict[str, dict[str, object]] = {
    f"the energy in the image: {name}": {READER + "focused_coherence": by.coherence, READER + "spot_energy": by.energy}
    for name, by in (("that over the channels", Channels(1.0)), ("the mean of both", Channels(0.5)))
}
HEIGHTS["the energy of a spot: its peak"] = {HERE + "centre.with_energies": lambda samples: (samples, None)}
METER: dict[str, dict[str, object]] = {"the meter": {"markerseek.scan.scanner.per_energy": lambda reading, _: reading}}
# By study: parts, how many times as many searches, every which cell: one energy of four is steady, and has a meter.
GROUPS = {
    "readings": {"tissues": (HEIGHTS, 1, 1), "energy": (METER, 1, 4)},
    "layers": dict.fromkeys(("points", "tissues", "repeats", "nothing"), (LAYERS, 1, 1))
    | {"clutter": (LAYERS, 3, 1), "two-sources": (LAYERS, 8, 1), "humps": (LAYERS, 6, 1)},
}


class MadeWorld:
    """Channel data of a world that is made for a part: bursts, a flat background, or a marker that moves."""

    def __init__(self, kind: str) -> None:
        self.kind, self.counts = kind, World.counts

    def __get__(self, world: Any, _: type) -> Callable[[Any], Any]:
        return partial(self.frame, world)

    def frame(self, world: Any, flash: Any) -> Any:
        """A frame as it is, with the echo of an interference or an artefact, or of the marker where it then is."""
        seen = vars(world)
        if self.kind == "moved":
            seen["lit"] = seen.get("lit", 0) + (flash is not None)
            moved_deg = 3.0 * (seen["lit"] > 6)
            world.angle_deg -= moved_deg
            data = self.counts(world, flash)
            world.angle_deg += moved_deg
            return data
        data, absorbers = self.counts(world, flash), seen["_absorbers"]
        if "echo" not in seen:
            rng = np.random.Generator(np.random.PCG64([int(abs(absorbers[0].angle_deg) * 1e6), 5]))
            top = np.abs(world.model.channel_data(absorbers, angle_deg=absorbers[0].angle_deg)).max()
            seen["echo"] = rng, top, rng.uniform(-15e-3, 15e-3), rng.uniform(15e-3, 40e-3), rng.uniform(0.2, 1.2)
        rng, top, lateral_m, depth_m, share = seen["echo"]
        if self.kind == "bursts":
            hit = rng.random() < 0.12
            lateral_m, depth_m, share = rng.uniform(-15e-3, 15e-3), rng.uniform(15e-3, 40e-3), rng.uniform(0.2, 1.0)
        else:
            hit, share = flash is not None, share * (1.0 if flash is None else flash.energy)
        if not hit:
            return data
        way_m = np.hypot(np.asarray(world.model.probe.array.lateral_m) - lateral_m, depth_m)
        late_s = np.arange(data.shape[1]) / world.model.sampling_hz - way_m[:, None] / 1500
        wave = np.exp(-((late_s / 0.12e-6) ** 2)) * np.cos(2 * np.pi * 5e6 * late_s)
        return digitise((data + top * share * wave).astype(np.float32))


def noting(part: str, function: Callable[..., object], nothing: object, spoke: set[str]) -> Callable[..., object]:
    """The function, which notes that it said something."""

    def call(*args: object, **named: object) -> object:
        said = function(*args, **named)
        if said != nothing:
            spoke.add(part)
        return said

    return call


def repeated(trial: int, study: Study, cell: Cell, group: str, made: str = "") -> tuple[dict[str, Row], set[str]]:
    """One search as it is and without each part, and the functions that said something; others need no search."""
    if made:
        with patch.object(World, "counts", MadeWorld(made)):
            return repeated(trial, study, cell, group)
    spoke: set[str] = set()
    with ExitStack() as stack:
        for part, (name, nothing) in FUNCTIONS.items():
            stack.enter_context(patch(HERE + name, noting(part, resolve_name(HERE + name), nothing, spoke)))
        rows = {AS_IT_IS: run_trial(study, cell, trial, 0)}
    for part, instead in GROUPS[group][study.name.removeprefix("answers-")][0].items():
        rows[part] = rows[AS_IT_IS]
        if part in spoke or part not in FUNCTIONS:
            with ExitStack() as stack:
                for name, other in instead.items():
                    stack.enter_context(patch(name, other))
                rows[part] = run_trial(study, cell, trial, 0)
    return rows, spoke


def right(row: Row) -> bool:
    """Whether a marker was found within twice the tolerance."""
    return row.answer == "found" and row.error_deg is not None and row.error_deg <= 2 * row.tolerance_deg


def line(study: Study, head: str, rows: Sequence[Row], base: Sequence[Row]) -> str:
    """One row of a table, beside the same searches as they are; errors of those right in both, in mm or degrees."""
    of = summarise(study, [msgspec.structs.replace(row, cell=0) for row in rows]).policies[0]
    pairs = list(zip(rows, base, strict=True))
    mm = [[(row.error_deg or 0.0) / row.tolerance_deg for row in pair] for pair in pairs if all(map(right, pair))]
    errors, before = np.array(mm).reshape(-1, 2).T
    more = [float(row.acquisitions or 0) - (old.acquisitions or 0) for row, old in pairs]
    further, longer = (
        "" if rows is base or each.half is None else f" ({each.mean:+.3f} ± {each.half:.3f})"
        for each in (Mean.of((errors - before).tolist()), Mean.of(more))
    )
    covered = f"{percent(of.covered)} of {of.covered.count}" if of.covered.count else ""
    error = f"{np.sqrt(np.mean(errors**2)):.3f}; {np.median(errors):.3f}{further} of {len(mm)}" if mm else ""
    return (
        f"| {head} | {percent(of.answers['found'])} | {of.wrong_claims.hits + of.false_found.hits} "
        f"| {of.answers['ambiguous'].hits}; {of.answers['unsure'].hits} | {covered} "
        f"| {error} | {of.acquisitions.mean or 0.0:.1f}{longer} |\n"
    )


def table(study: Study, world: str, searches: Sequence[tuple[dict[str, Row], set[str]]]) -> Iterator[str]:
    """Rows of one world: as it is, and without each part that changes something, or said something."""
    base = [rows[AS_IT_IS] for rows, _ in searches]
    yield line(study, f"{world} | {AS_IT_IS}, of {len(base)}", base, base)
    for part in [part for part in searches[0][0] if part != AS_IT_IS]:
        rows, spoken = [rows[part] for rows, _ in searches], sum(part in spoke for _, spoke in searches)
        if rows != base or spoken:
            yield line(study, f"{world} | {part}" + f", in {spoken}" * (part in FUNCTIONS), rows, base)


def main() -> None:
    """Print the table, world by world."""
    parser = argparse.ArgumentParser()
    parser.add_argument("group", choices=(*GROUPS, "made"))
    parser.add_argument("searches", type=int, nargs="?", default=12)
    parser.add_argument("--workers", type=int, default=default_workers())
    given = parser.parse_args()
    sys.stdout.write("| world | without | `Found` | wrong | `Ambiguous`; `Unsure` | covered | error | acquisitions |\n")
    sys.stdout.write("|---|---|---|---|---|---|---|---|\n")
    with ProcessPoolExecutor(given.workers) as pool:
        if given.group == "made":
            study = read_study(Path(__file__).parents[2] / "examples/studies/answers-points.toml")
            for made in ("bursts", "background", "moved"):
                job = partial(repeated, study=study, cell=cells(study)[2], group="layers", made=made)
                sys.stdout.writelines(table(study, made, list(pool.map(job, range(given.searches)))))
                sys.stdout.flush()
            return
        for name, (_, factor, step) in GROUPS[given.group].items():
            study = read_study(Path(__file__).parents[2] / f"examples/studies/answers-{name}.toml")
            study = structs.replace(study, seed=SEED, policies=study.policies[-1:])
            of_study = []
            for cell in cells(study)[::step]:
                world = " ".join([name, *(str(value) for _, value in cell.varied)])
                sys.stderr.write(f"{world}\n")
                job = partial(repeated, study=study, cell=cell, group=given.group)
                of_study.append(list(pool.map(job, range(factor * given.searches))))
                sys.stdout.writelines(table(study, world, of_study[-1]))
                sys.stdout.flush()
            if len(of_study) > 1:
                sys.stdout.writelines(table(study, f"{name}, all", [each for one in of_study for each in one]))


if __name__ == "__main__":
    main()
