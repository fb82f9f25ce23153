"""Whether a registration says its error rightly: worlds whose errors are drawn from its own priors, and others.

``python -m benchmarks.registration.prior_worlds --draws 40`` prints both tables as Markdown. Markers lie where sessions
of eight scenes ask for them; each draw has new errors there.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.registration.forged_markers import REACH, SOURCES, STEREO, PriorScene
from markerseek.core import Float64, SpotToSource
from markerseek.registration.choice import choose
from markerseek.registration.poses import Poses
from markerseek.registration.report import DOUBTED, MIN_PROBABILITY, default_target, registered_pairs

SCENES = 8
MOST_MARKERS = 6

Spots = list[Float64[np.ndarray, " 3"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """What is drawn of a world, and what a registration in it believes of spot and source."""

    title: str
    sources: Sequence[str] = SOURCES
    doubt: bool = True
    spot: SpotToSource = field(default_factory=SpotToSource)
    wrong: dict[str, float] = field(default_factory=dict)


NO_OFFSET = tuple(each for each in SOURCES if each != "offset")

WORLDS = (
    World(title="all errors from the priors"),
    World(title="none wider than assumed", doubt=False),
    World(title="spot and source are one point, none wider", sources=NO_OFFSET, doubt=False),
    World(
        title="the same, and the rig says so (`offset_sigma_m = 0`)",
        sources=NO_OFFSET,
        doubt=False,
        spot=SpotToSource(offset_sigma_m=0.0),
    ),
    World(title="focal length 2 % wrong", doubt=False, wrong={"focal length": 0.02}),
    World(title="base 2 % wrong", doubt=False, wrong={"base": 0.02}),
)


def places(seed: int) -> Spots:
    """Spots where a session of a scene asks for them."""
    scene = PriorScene(seed, doubt=False)
    spots_m: Spots = []
    markers = []
    place = None
    for number in range(MOST_MARKERS):
        spots_m.append(scene.lit(place))
        markers.append(scene.seen(str(number + 1), spots_m[-1]))
        spot = SpotToSource()
        poses = Poses.of(markers, choose(markers, spot=spot), REACH, spot=spot, rng=np.random.default_rng(0))
        x, _, z = spots_m[-1].tolist()
        probe_deg = math.degrees(math.atan2(x, z))
        place = None if poses is None else poses.best_place(STEREO, REACH, target_trus_m=None, probe_deg=probe_deg)
    return spots_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """Errors of one registration at its target, in millimetres."""

    true_mm: float
    tre_mm: float
    tre95_mm: float
    fits: bool
    named: bool
    """Whether it says that an error is larger than assumed."""


def draw(world: World, spots: Sequence[Spots], *, markers: int, draws: int) -> list[Drawn]:
    """Register with errors of a world: so many draws for each set of spots."""
    found = []
    for number, spots_m in enumerate(spots):
        for each in range(draws):
            scene = PriorScene(
                1000 * (each + 1) + number,
                sources=world.sources,
                doubt=world.doubt,
                spot=world.spot,
                wrong=world.wrong,
            )
            # The camera stands where the spots were asked for.
            scene.true = PriorScene(number).true
            pairs = [scene.seen(str(place), spot_m).pair(0) for place, spot_m in enumerate(spots_m[:markers], start=1)]
            found_here = registered_pairs(pairs, spot=world.spot)
            target_m = np.array(default_target(np.array([pair.trus_m for pair in pairs])))
            off_m = found_here.transform.apply(scene.true.inverse().apply(target_m)) - target_m
            found.append(
                Drawn(
                    true_mm=1e3 * float(np.linalg.norm(off_m)),
                    tre_mm=1e3 * found_here.tre_m(target_m),
                    tre95_mm=1e3 * found_here.tre95_m(target_m),
                    fits=found_here.probability >= MIN_PROBABILITY,
                    named=sum(doubt.probability for doubt in found_here.doubts) >= DOUBTED,
                )
            )
    return found


def table(spots: Sequence[Spots], *, draws: int) -> str:
    """The table of the worlds."""
    lines = [
        "| world | markers | fit | true TRE: mean, rms, mm | expected, rms, mm | covered | named |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for world in WORLDS:
        for markers in (4, 6):
            drawn = draw(world, spots, markers=markers, draws=draws)
            known = [each for each in drawn if each.fits]
            true_mm = np.array([each.true_mm for each in known])
            said_mm = np.array([each.tre_mm for each in known])
            covered = np.mean([each.true_mm <= each.tre95_mm for each in known])
            lines.append(
                f"| {world.title} | {markers} | {len(known)} of {len(drawn)} | {true_mm.mean():.2f}, "
                f"{np.sqrt(np.mean(true_mm**2)):.2f} | {np.sqrt(np.mean(said_mm**2)):.2f} | {100 * covered:.0f} % | "
                f"{100 * np.mean([each.named for each in drawn]):.0f} % |"
            )
            sys.stderr.write(lines[-1] + "\n")
    return "\n".join(lines) + "\n"


def shares(spots: Sequence[Spots], *, draws: int) -> str:
    """The table of the sources: the true error where each acts alone."""
    lines = ["| the only source | 4 markers, rms, mm | 6 markers |", "|---|---:|---:|"]
    for source in SOURCES:
        cells = []
        for markers in (4, 6):
            world = World(title=source, sources=(source,), doubt=False)
            true_mm = [each.true_mm for each in draw(world, spots, markers=markers, draws=draws) if each.fits]
            cells.append(f"{np.sqrt(np.mean(np.square(true_mm))):.2f}")
        lines.append(f"| {source} | {' | '.join(cells)} |")
        sys.stderr.write(lines[-1] + "\n")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.registration.prior_worlds", description=__doc__)
    parser.add_argument("--draws", type=int, default=40, help="draws of the errors for each set of spots (40)")
    arguments = parser.parse_args()
    spots = [places(seed) for seed in range(SCENES)]
    sys.stdout.write(table(spots, draws=arguments.draws) + "\n" + shares(spots, draws=max(arguments.draws // 2, 1)))


if __name__ == "__main__":
    main()
