"""The paper's online analysis (section 2.5 C): the searches drive the rig themselves, in virtual time.

Stage motion, backlash, light, noise and averaging are those of the simulated rig; each acquisition is a frame of
channel data. The probe begins at −35°, and a search ends with a move to the angle found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek import rigs
from markerseek.core import SearchError
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    NAMES,
    ONLINE_STEPS,
    Name,
    published,
    searched,
    shorter,
)
from markerseek.studies.paper.positions import PEAK_COUNTS, grid

LEVELS_DB = (40.0, 60.0)
"""Peak SNR: the default of the physics notes, and the quiet end of what they sweep."""

REPEATS = 4
"""Times that the nine positions are visited, each time with another grid, other spots and other noise."""

TISSUE = "plastisol-phantom"
"""What the online analysis looked at (section 2.5 C), a simulated stand-in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineRun:
    """One search on the rig.

    Attributes
    ----------
    method, peak_snr_db, repeat, position
        What searched, under which noise, and where: the position is counted from 1, the repeat from 0.
    truth_deg
        Angle of the marker in degrees.
    track_deg
        Angles reached, one for each acquisition, in degrees.
    answers_deg
        Angle answered after so many acquisitions, in degrees; of WA the last only.
    travel_deg
        Rotation from −35° to the angle found, in degrees.
    elapsed_s, acquiring_s
        Virtual time from the first move to the end, and the part of it that went into acquisitions, in seconds.
    """

    method: Name
    peak_snr_db: float
    repeat: int
    position: int
    truth_deg: float
    track_deg: tuple[float, ...]
    answers_deg: dict[int, float]
    travel_deg: float
    elapsed_s: float
    acquiring_s: float

    def error_deg(self, acquisitions: int) -> float:
        """Absolute error of the answer after so many acquisitions, in degrees."""
        return abs(self.answers_deg[acquisitions] - self.truth_deg)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    method: Name
    peak_snr_db: float
    repeat: int
    position: int
    marker: MarkerSettings
    seed: int


def online_runs(effort: Effort, *, levels_db: Sequence[float] = LEVELS_DB) -> list[OnlineRun]:
    """Searches of TS, GSS (28 acquisitions) and WA (5° steps, early end) at the nine positions under each noise.

    All methods and all noises meet the same markers. An effort of fewer markers than the paper's repeats less often.

    Parameters
    ----------
    effort
        What may be used.
    levels_db
        Peak SNR in dB.
    """
    jobs = []
    for repeat in range(max(1, round(REPEATS * effort.share))):
        seeds = np.random.SeedSequence([effort.seed, 77, repeat])
        for position, marker in enumerate(grid(np.random.Generator(np.random.PCG64(seeds))), start=1):
            seed = int(seeds.generate_state(1)[0]) + position
            jobs += [
                _Job(method=name, peak_snr_db=level_db, repeat=repeat, position=position, marker=marker, seed=seed)
                for level_db in levels_db
                for name in NAMES
            ]
    return effort.each(_run, jobs, what="online searches, from channel data")


def _run(job: _Job) -> OnlineRun:
    settings = SimulatedSettings(
        tissue=TISSUE,
        marker=job.marker,
        noise=NoiseSettings(peak_snr_db=job.peak_snr_db),
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        start_deg=-35.0,
    )
    rig = rigs.simulated(seed=job.seed, settings=settings)
    if rig.facts.truth_deg is None:
        raise SearchError("online: the rig has no marker, so there is no error to be told")
    bracket = job.method in BRACKETS
    policy = published(
        job.method, acquisitions=max(BRACKET_ACQUISITIONS) if bracket else ONLINE_STEPS, early_end=not bracket
    )
    samples, finished = searched(policy, rig.scanner, stay=False)
    last = {len(samples): finished.estimate.mean_deg}
    # The confirmation at the end is one acquisition more on the clock.
    each_s = settings.receiver.readout_s + settings.laser.pulses / settings.laser.rate_hz
    return OnlineRun(
        method=job.method,
        peak_snr_db=job.peak_snr_db,
        repeat=job.repeat,
        position=job.position,
        truth_deg=rig.facts.truth_deg,
        track_deg=tuple(sample.angle_deg for sample in samples),
        answers_deg=dict(shorter(job.method, samples)) if bracket else last,
        travel_deg=finished.travel_deg,
        elapsed_s=finished.elapsed_s,
        acquiring_s=each_s * (len(samples) + 1),
    )
