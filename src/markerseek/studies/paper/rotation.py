"""Angles that the searches ask for without noise, and how far and how long a stage turns for them.

Without noise the angles that TS and GSS ask for follow from the marker's angle alone: of two angles the one nearer to
the marker is the stronger, whatever symmetric unimodal curve is searched.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from markerseek.core import Reading, Sample
from markerseek.sim import StageMotion
from markerseek.studies.paper.methods import Name, published


def quiet_track(name: Name, marker_deg: float, *, acquisitions: int) -> tuple[list[float], float]:
    """Angles that a method asks for without noise, in order, and the angle that it answers, in degrees.

    Parameters
    ----------
    name
        The method; a full scan for WA.
    marker_deg
        Angle of the marker in degrees.
    acquisitions
        Number N of acquisitions.
    """
    policy = published(name, acquisitions=acquisitions)
    track: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        track.append(angle_deg)
        reading = Reading(intensity=1.0 / (1.0 + (angle_deg - marker_deg) ** 2))
        policy.tell(Sample(angle_deg=angle_deg, reading=reading))
    return track, policy.estimate().mean_deg


def shortest_order(track_deg: Sequence[float], *, start_deg: float) -> list[float]:
    """The same pairs of angles, each in the order that makes the whole way shortest.

    A program cannot travel so, because it would have to know the later pairs; none that measures the same pairs
    travels less.

    Parameters
    ----------
    track_deg
        Angles of a bracket search in degrees, two for each iteration.
    start_deg
        Where the probe stands at first, in degrees.
    """
    ways: list[tuple[float, list[float]]] = [(0.0, [start_deg])]
    for left_deg, right_deg in zip(track_deg[::2], track_deg[1::2], strict=True):
        # Of all ways that end at the same angle only the shortest can be part of the shortest whole.
        ways = [
            min(
                ((length + abs(first - way[-1]) + abs(last - first), [*way, first, last]) for length, way in ways),
                key=lambda way: way[0],
            )
            for first, last in ((left_deg, right_deg), (right_deg, left_deg))
        ]
    return min(ways, key=lambda way: way[0])[1][1:]


def travel_deg(track_deg: Sequence[float]) -> float:
    """Rotation from the first angle of a track to its last, in degrees."""
    return float(np.abs(np.diff(track_deg)).sum())


def rotation_s(track_deg: Sequence[float], *, motion: StageMotion) -> float:
    """Time that the stage takes from the first angle of a track to its last, resting at each, in seconds.

    A move downwards goes beyond its target and comes back from below, as `markerseek.sim.SimulatedStage` does.

    Parameters
    ----------
    track_deg
        Angles in degrees, the first of them where the probe stands.
    motion
        How the stage moves.
    """
    total_s = 0.0
    for here_deg, there_deg in itertools.pairwise(track_deg):
        below_deg = motion.approach_deg if there_deg < here_deg else 0.0
        moved_s = motion.duration_s(abs(there_deg - here_deg) + below_deg) + motion.duration_s(below_deg)
        total_s += moved_s + motion.settle_s
    return total_s
