"""Search where the probe's coupling changes with its angle, and print "Uneven coupling" of ``answers.md``.

``python docs/validation/measure_coupling.py 300``: so many searches for each kind. Gel that is thicker on one side, or
a bubble, makes all sound fainter at some angles: the curve is no longer symmetric about the marker. No search knows it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from measure_spots import percent

from markerseek import find_marker
from markerseek.acoustics import Probe
from markerseek.core import Frame, FrameHeader
from markerseek.rigs import Rig, draw_scene, rig_in_world
from markerseek.sim import Flash, MarkerSettings, NoiseSettings, SimulatedSettings, SimulatedWorld
from markerseek.studies import Share

SEED = 20261127
Coupling = Callable[[float], float]
"""Share of the sound that arrives with the probe at an angle in degrees."""


def even(_: np.random.Generator) -> Coupling:
    """The same at every angle."""
    return lambda _: 1.0


def slope(rng: np.random.Generator) -> Coupling:
    """Up to 30 % more at one end of the range, and as much less at the other."""
    change = rng.uniform(-0.3, 0.3)
    return lambda angle_deg: 1 + change * angle_deg / 35


def ripple(rng: np.random.Generator) -> Coupling:
    """Waves of 5 % over the angle, 5 to 20 degrees long."""
    length_deg, begin_deg = rng.uniform(5, 20), rng.uniform(0, 20)
    return lambda angle_deg: 1 + 0.05 * math.sin(2 * math.pi * (angle_deg - begin_deg) / length_deg)


def shadow(rng: np.random.Generator) -> Coupling:
    """A bubble, 4 to 10 degrees wide, that takes up to 70 % away."""
    middle_deg, width_deg, lost = rng.uniform(-35, 35), rng.uniform(4, 10), rng.uniform(0, 0.7)
    return lambda angle_deg: 1 - lost * math.exp(-4 * math.log(2) * ((angle_deg - middle_deg) / width_deg) ** 2)


KINDS = {"even": even, "a slope of up to 30 % to either end": slope, "ripple of 5 %": ripple, "a shadow": shadow}


@dataclass
class CoupledWorld:
    """A simulated world whose sound passes through a coupling."""

    world: SimulatedWorld
    coupling: Coupling

    def __post_init__(self) -> None:
        self.angle_deg = self.world.angle_deg
        self.flashes = self.world.flashes

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue."""
        self.world.flash(pulses=pulses, at_s=at_s)

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> Frame:
        """Frame after a flash, or without one."""
        self.world.angle_deg = self.angle_deg
        if flash is not None:
            flash = replace(flash, energy=flash.energy * self.coupling(self.angle_deg))
        return self.world.frame(flash, header=header)


def drawn_rig(kind: str, number: int) -> Rig:
    """The simulated rig, with marker, probe and noise drawn: the same for each kind, but for the noise's samples."""
    rng = np.random.Generator(np.random.PCG64([SEED, number]))
    coupling = KINDS[kind](np.random.Generator(np.random.PCG64([SEED, number, 1])))
    focus_m = None if rng.random() < 0.2 else rng.uniform(20e-3, 40e-3)
    settings = SimulatedSettings(
        start_deg=-35.0,
        marker=MarkerSettings(radius_m=rng.uniform(40e-3, 70e-3), source_radius_m=rng.uniform(0.05e-3, 0.4e-3)),
        probe=Probe(element_height_m=rng.uniform(3e-3, 6e-3), elevation_focus_m=focus_m),
        noise=NoiseSettings(peak_snr_db=rng.uniform(30.0, 42.0)),
    )
    scene = draw_scene(settings, rng)
    return rig_in_world(
        CoupledWorld(scene.world(settings, rng), coupling),
        settings,
        kind,
        truth_deg=scene.marker.angle_deg,
        rng=rng,
    )


class Outcome(NamedTuple):
    """One search, by the default command."""

    found: bool
    error_deg: float
    covered: bool | None
    """Whether the 95 % interval holds the truth; None if there is no interval."""
    acquisitions: int


def searched(number: int, kind: str) -> Outcome:
    """Search once."""
    result = find_marker(drawn_rig(kind, number))
    interval = result.interval95_deg
    truth_deg = result.run.facts.truth_deg
    true_deg = math.nan if truth_deg is None else truth_deg
    return Outcome(
        found=result.answer == "found",
        error_deg=abs(result.angle_deg - true_deg),
        covered=None if interval is None else interval[0] <= true_deg <= interval[1],
        acquisitions=result.acquisitions,
    )


def line(kind: str, outcomes: list[Outcome]) -> str:
    """One row of the table."""
    found_deg = [each.error_deg for each in outcomes if each.found]
    covered = [each.covered for each in outcomes if each.covered is not None]
    return (
        f"| {kind} | {percent(Share.of(len(found_deg), len(outcomes)))} "
        f"| {np.mean(found_deg):.3f}°; {np.max(found_deg):.2f}° "
        f"| {percent(Share.of(sum(covered), len(covered)))} of {len(covered)} "
        f"| {np.mean([each.acquisitions for each in outcomes]):.1f} |\n"
    )


def main() -> None:
    """Print the table, row by row."""
    searches = range(int(sys.argv[1]))
    sys.stdout.write("| coupling | `Found` | mean error of these; largest | interval covers | acquisitions |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    with ProcessPoolExecutor(2) as pool:
        for kind in KINDS:
            sys.stdout.write(line(kind, list(pool.map(partial(searched, kind=kind), searches))))
            sys.stdout.flush()


if __name__ == "__main__":
    main()
